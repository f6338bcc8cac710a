//! The `mcap` crate's own readers find everything, by every way in.

use depthloom_graphs::plan::{NodeId, PortId};
use std::collections::BTreeMap;

use depthloom_graphs::contracts::Slot;
use foxglove::Decode;
use foxglove::messages::{CameraCalibration, RawImage};
use mcap::sans_io::indexed_reader::{IndexedReadEvent, IndexedReader, IndexedReaderOptions};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MessageStream, Summary};

use crate::fixture::{BEGINNING_NS, CURVE, curve, frame, plan, record, values};

fn recorded(frames: std::ops::Range<u64>) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), frames, 70, 40);
    std::fs::read(path).expect("a recording")
}

#[test]
fn every_checksum_holds() {
    let bytes = recorded(0..3);
    let options = LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true);
    let mut reader = LinearReader::new_with_options(options);
    let (mut at, mut records) = (0, 0);
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            LinearReadEvent::ReadRequest(wanted) => {
                let given = wanted.min(bytes.len() - at);
                reader.insert(given).copy_from_slice(&bytes[at..at + given]);
                reader.notify_read(given);
                at += given;
            }
            LinearReadEvent::Record { data, opcode } => {
                mcap::parse_record(opcode, data).unwrap();
                records += 1;
            }
        }
    }
    assert!(records > 30);
}

#[test]
fn what_topics_are_said_to_hold_is_what_a_stream_of_them_has() {
    /// A message's record: opcode, length, and what stands before the data.
    const HEAD: u64 = 1 + 8 + 2 + 4 + 8 + 8;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), 0..4, 70, 40);
    let bytes = std::fs::read(&path).expect("a recording");
    let reported_sizes = |path: &std::path::Path| {
        let recording = depthloom_recording::Recording::open(path).expect("a recording");
        let sizes = recording.topic_sizes(&|| false).expect("sizes");
        let stored: u64 = sizes.iter().map(|of| of.stored_bytes).sum();
        let counts = |size: depthloom_recording::TopicSize| (size.topic, (size.messages, size.raw_bytes));
        (sizes.into_iter().map(counts).collect::<BTreeMap<_, _>>(), stored)
    };
    let mut counted: BTreeMap<String, (u64, u64)> = BTreeMap::new();
    for message in MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let in_plan = message.channel.metadata.get("topic_in_plan").unwrap_or(&message.channel.topic);
        let (count, size) = counted.entry(in_plan.clone()).or_default();
        *count += 1;
        *size += HEAD + message.data.len() as u64;
    }
    let (reported, stored) = reported_sizes(&path);
    assert_eq!(reported, counted);
    let chunks = Summary::read(&bytes).unwrap().expect("a summary").chunk_indexes;
    assert_eq!(stored, chunks.iter().map(|chunk| chunk.compressed_size).sum::<u64>());
    // Of a file without an end, the same of its whole frames.
    let cut = folder.path().join("cut.mcap");
    let last = chunks.iter().map(|chunk| chunk.chunk_start_offset + chunk.chunk_length).max().expect("chunks");
    std::fs::write(&cut, &bytes[..last as usize]).expect("written");
    let (reported, _) = reported_sizes(&cut);
    assert!(reported.iter().all(|(topic, counts)| counted[topic] == *counts), "{reported:?} {counted:?}");
    assert!(reported.len() > 5);
}

#[test]
fn the_summary_tells_what_the_stream_holds() {
    let bytes = recorded(0..4);
    let mut counted: BTreeMap<String, u64> = BTreeMap::new();
    let mut last = 0;
    for message in MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert_eq!(message.log_time, message.publish_time);
        if message.channel.topic == CURVE {
            let point = counted.entry(CURVE.to_owned()).or_default();
            assert_eq!(message.log_time, BEGINNING_NS + 1_000_000 * curve().points[*point as usize].step);
            *point += 1;
            continue;
        }
        assert_eq!(BEGINNING_NS + u64::from(message.sequence) * 100_000_000, message.log_time);
        assert!(message.log_time >= last);
        last = message.log_time;
        assert_eq!(message.channel.message_encoding, "protobuf");
        *counted.entry(message.channel.topic.clone()).or_default() += 1;
    }
    assert_eq!(counted["/compare/commit"], 4);
    assert_eq!(counted["/compare/fused/depth"], 4);
    assert_eq!(counted["/compare/source/depth"], 3);
    assert_eq!(counted[CURVE], 4);
    let summary = Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.unwrap();
    let reported: BTreeMap<String, u64> =
        stats.channel_message_counts.iter().map(|(id, count)| (summary.channels[id].topic.clone(), *count)).collect();
    assert_eq!(reported, counted);
    assert_eq!(stats.message_count, counted.values().sum::<u64>());
    assert_eq!((stats.message_start_time, stats.message_end_time), (BEGINNING_NS, BEGINNING_NS + 300_000_000));
    assert_eq!(stats.chunk_count as usize, summary.chunk_indexes.len());
    assert_eq!(stats.attachment_count as usize, summary.attachment_indexes.len());
    assert_eq!(stats.metadata_count as usize, summary.metadata_indexes.len());
    assert_eq!(usize::from(stats.schema_count), summary.schemas.len());
    for index in &summary.attachment_indexes {
        mcap::read::attachment(&bytes, index).unwrap();
    }
    for index in &summary.metadata_indexes {
        mcap::read::metadata(&bytes, index).unwrap();
    }
}

#[test]
fn message_indexes_lead_to_their_messages() {
    let bytes = recorded(0..2);
    let summary = Summary::read(&bytes).unwrap().unwrap();
    for chunk in &summary.chunk_indexes {
        for (channel, entries) in summary.read_message_indexes(&bytes, chunk).unwrap() {
            for entry in entries {
                let message = summary.seek_message(&bytes, chunk, &entry).unwrap();
                assert_eq!(message.channel.id, channel.id);
                assert_eq!(message.log_time, entry.log_time);
            }
        }
    }
}

#[test]
fn one_topic_is_sought_through_the_indexes() {
    let bytes = recorded(0..5);
    let summary = Summary::read(&bytes).unwrap().unwrap();
    let options =
        IndexedReaderOptions::new().include_topics(["/compare/fused/depth"]).starting_at(BEGINNING_NS + 200_000_000);
    let mut reader = IndexedReader::new_with_options(&summary, options).unwrap();
    let mut times = Vec::new();
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            IndexedReadEvent::ReadChunkRequest { offset, length } => {
                let chunk = &bytes[offset as usize..offset as usize + length];
                reader.insert_chunk_record_data(offset, chunk).unwrap();
            }
            IndexedReadEvent::Message { header, .. } => times.push(header.log_time),
        }
    }
    assert_eq!(times, [2, 3, 4].map(|frame| BEGINNING_NS + frame * 100_000_000));
}

#[test]
fn foxglove_decodes_its_own_messages() {
    let bytes = recorded(0..1);
    let expected = values(&frame(0), 70, 40);
    let of_slot = |slot| expected.iter().find(|(of, _)| *of == slot).map(|(_, value)| value.clone()).unwrap();
    let mut seen = 0;
    for message in MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        match message.channel.topic.as_str() {
            "/compare/edges/mask" => {
                let image = RawImage::decode(&*message.data).unwrap();
                let timestamp = image.timestamp.unwrap();
                assert_eq!(u64::from(timestamp.sec()) * 1_000_000_000, BEGINNING_NS);
                assert_eq!((image.width, image.height, image.step), (70, 40, 70));
                assert_eq!((image.encoding.as_str(), image.frame_id.as_str()), ("mono8", "compare/left"));
                let depthloom_graphs::Value::Mask(mask) = of_slot(Slot::Node { node: NodeId(2), port: PortId(1) })
                else {
                    panic!()
                };
                assert_eq!(image.data, *mask.set.as_raw());
                seen += 1;
            }
            "/compare/source/left/calibration" => {
                let read = CameraCalibration::decode(&*message.data).unwrap();
                let depthloom_graphs::Value::Calibration(calibration) = of_slot(Slot::Source { port: PortId(3) })
                else {
                    panic!()
                };
                assert_eq!((&read.k[..], &read.p[..]), (&calibration.k()[..], &calibration.p()[..]));
                assert_eq!((read.width, read.height, read.frame_id.as_str()), (70, 40, "compare/left"));
                seen += 1;
            }
            _ => {}
        }
    }
    assert_eq!(seen, 2);
}
