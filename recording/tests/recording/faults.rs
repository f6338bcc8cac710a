//! After a crash, a recording can be read to the last commit; damage and foreign files are reported.

use depthloom_graphs::plan::{FrameIndex, RunId};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use depthloom_graphs::Remedied;
use depthloom_graphs::contracts::Sink;
use depthloom_recording::{Condition, Disk, FileError, Recorder, Recording, RecordingError, recover};
use proptest::prelude::{ProptestConfig, Strategy, proptest};
use proptest::{prop_assert, prop_assert_eq};

use crate::digest::digest;
use crate::fixture::{CURVE, Noise, curve, frame, plan, record, record_aggregate_values, record_frame, values};

const FRAMES: u64 = 6;
/// The message index behind a commit's chunk: without it the commit is whole, and read.
const COMMIT_INDEX: u64 = 9 + 2 + 4 + 16;
const TOPICS: [&str; 3] = ["/compare/fused/depth", "/compare/stereo/disparity", "/compare/score_fused/scores"];

/// A finished file, where each of its frames ends, and where its aggregate values do.
fn recorded() -> &'static (Vec<u8>, Vec<u64>, u64) {
    static RECORDED: OnceLock<(Vec<u8>, Vec<u64>, u64)> = OnceLock::new();
    RECORDED.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("recording.mcap");
        let recorder = Recorder::create(&path, &plan()).expect("a recorder");
        let mut ends = Vec::new();
        for index in 0..FRAMES {
            record_frame(&recorder, RunId(0), &frame(index), &values(&frame(index), 20, 12), false);
            ends.push(std::fs::metadata(&path).expect("the file").len());
        }
        record_aggregate_values(&recorder, RunId(0));
        let aggregate_end = std::fs::metadata(&path).expect("the file").len();
        recorder.finish(&[]).expect("a finished file");
        (std::fs::read(&path).expect("the file"), ends, aggregate_end)
    })
}

fn written(folder: &Path, bytes: &[u8]) -> PathBuf {
    let path = folder.join("recording.mcap");
    std::fs::write(&path, bytes).unwrap_or_else(|error| panic!("{error}"));
    path
}

/// Opens and reads everything.
fn read_all(path: &Path) -> Result<usize, RecordingError> {
    let recording = Recording::open(path)?;
    let mut reader = recording.reader(RunId(0), &TOPICS)?;
    for position in 0..recording.frames(RunId(0)).len() {
        reader.read(FrameIndex(position))?;
    }
    for once in recording.aggregate_values() {
        recording.aggregate_value(once)?;
    }
    Ok(recording.frames(RunId(0)).len())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_file_cut_anywhere_is_readable_up_to_its_last_commit(cut in (0..=recorded().0.len()).prop_map(|cut| cut as u64)) {
        let (bytes, ends, aggregate_end) = recorded();
        let folder = tempfile::tempdir()?;
        let path = written(folder.path(), &bytes[..cut as usize]);
        let committed = ends.iter().filter(|end| **end <= cut + COMMIT_INDEX).count();
        match Recording::open(&path) {
            Ok(recording) => {
                prop_assert_eq!(recording.frames(RunId(0)).len(), committed);
                if cut == bytes.len() as u64 {
                    prop_assert_eq!(recording.condition(), &Condition::Complete);
                } else {
                    prop_assert!(matches!(recording.condition(), Condition::Unfinished { .. }), "{}", recording.condition());
                }
                if let Some(last) = committed.checked_sub(1) {
                    prop_assert!((ends[last] - COMMIT_INDEX..=ends[last]).contains(&recording.committed_bytes()));
                }
                let curves = recording.aggregate_values().iter().filter(|once| once.value_type == "curve").count();
                prop_assert_eq!(curves == 1, cut >= *aggregate_end);
                prop_assert!(recording.aggregate_values().iter().all(|once| recording.aggregate_value(once).is_ok()));
                let read = read_all(&path);
                prop_assert!(committed == 0 || read.is_ok_and(|frames| frames == committed));
            }
            // Cut within what comes before the frames: there is no plan yet.
            Err(RecordingError::NotMcap { .. }) => prop_assert!(cut < 8),
            Err(RecordingError::NotARecording { .. }) => prop_assert_eq!(committed, 0),
            Err(error) => prop_assert!(false, "{}", error),
        }
    }
}

/// All that can be read of a recording, as text that tells every bit.
fn everything(path: &Path) -> Result<String, RecordingError> {
    let recording = Recording::open(path)?;
    let frames: Vec<_> =
        recording.plan().runs.iter().enumerate().map(|(run, _)| recording.frames(RunId(run))).collect();
    let frames = frames
        .iter()
        .flat_map(|of| of.iter())
        .map(|of| (&of.id, of.index, of.time_ns, of.source_key, &of.keys, &of.failures));
    let mut content = format!("{:?}\n{:?}\n", recording.plan(), frames.collect::<Vec<_>>());
    content += &format!("{:?}\n", recording.aggregate_values());
    for once in recording.aggregate_values() {
        content += &format!("{:?}\n", recording.aggregate_value(once)?);
    }
    let topics = recording.plan().outputs(RunId(0)).filter(|(_, output)| output.recorded && !output.once);
    let topics: Vec<&str> = topics.map(|(_, output)| output.topic.as_str()).collect();
    let mut reader = recording.reader(RunId(0), &topics)?;
    for position in 0..recording.frames(RunId(0)).len() {
        content += &format!("{:?}\n", reader.read(FrameIndex(position))?);
    }
    Ok(content)
}

/// How many bits are flipped: `DEPTHLOOM_FLIPS`, or few enough for every day.
fn flips() -> u32 {
    let default = if depthloom_test_needs::is_full() { 300 } else { 60 };
    std::env::var("DEPTHLOOM_FLIPS").map_or(default, |flips| flips.parse().expect("DEPTHLOOM_FLIPS is a number"))
}

/// The distance of the places that are tried: a larger one in the hermetic suite.
fn sparse(distance: usize) -> usize {
    if depthloom_test_needs::is_full() { distance } else { distance * 7 }
}

/// Flips one bit after the other among the first `reach` bytes, and reads everything: it is the same, or an error, or
/// reported to be damaged.
fn flip_bits(bytes: &[u8], reach: usize, seed: u64) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = written(folder.path(), bytes);
    let expected = everything(&path).expect("what was recorded can be read");
    let condition = Recording::open(&path).expect("what was recorded can be read").condition().clone();
    let (mut noise, mut bytes) = (Noise(seed), bytes.to_vec());
    let (mut same, mut refused, mut reported) = (0, 0, 0);
    for _ in 0..flips() {
        let (place, bit) = (noise.bits() as usize % reach.min(bytes.len()), noise.bits() % 8);
        bytes[place] ^= 1 << bit;
        std::fs::write(&path, &bytes).expect("a file");
        match everything(&path) {
            Err(_) => refused += 1,
            Ok(told) => {
                let recording = Recording::open(&path).expect("it was read before");
                match recording.condition() {
                    Condition::Damaged { .. } => reported += 1,
                    now => {
                        let differs = told.bytes().zip(expected.bytes()).position(|(a, b)| a != b).unwrap_or_default();
                        let around = |text: &str| text.get(differs.saturating_sub(80)..differs + 80).map(str::to_owned);
                        let (is, was) = (around(&told), around(&expected));
                        assert!(
                            told == expected,
                            "bit {bit} of byte {place} silently changes what is read: {is:?} was {was:?}"
                        );
                        assert_eq!(*now, condition, "bit {bit} of byte {place}");
                        same += 1;
                    }
                }
            }
        }
        bytes[place] ^= 1 << bit;
    }
    println!("{} bits flipped: {same} change nothing, {refused} are refused, {reported} are reported", flips());
}

#[test]
fn fault_48_a_flipped_bit_of_a_whole_recording_is_refused_said_or_changes_nothing() {
    let (bytes, ..) = recorded();
    flip_bits(bytes, bytes.len(), 1);
    flip_bits(bytes, 6000, 2);
}

#[test]
fn fault_48_a_flipped_bit_of_an_unfinished_recording_is_refused_said_or_changes_nothing() {
    let (bytes, ends, aggregate_end) = recorded();
    for end in [ends[FRAMES as usize - 1], *aggregate_end] {
        flip_bits(&bytes[..end as usize], end as usize, 3);
        flip_bits(&bytes[..end as usize], 6000, 4);
    }
    // Within a frame, as a kill leaves it.
    let middle = usize::midpoint(ends[3] as usize, ends[4] as usize);
    flip_bits(&bytes[..middle], middle, 5);
    // The last commit of a file that ends with it has nothing behind it that vouches for it.
    let end = ends[FRAMES as usize - 1] as usize;
    let last = &bytes[..end];
    let folder = tempfile::tempdir().unwrap();
    for place in (ends[FRAMES as usize - 2] as usize..end).step_by(sparse(1)) {
        let mut flipped = last.to_vec();
        flipped[place] ^= 1 << (place % 8);
        let path = written(folder.path(), &flipped);
        let Ok(recording) = Recording::open(&path) else { continue };
        let damaged = matches!(recording.condition(), Condition::Damaged { .. });
        assert!(
            damaged || recording.frames(RunId(0)).len() == FRAMES as usize,
            "byte {place}: {}",
            recording.condition()
        );
    }
}

#[test]
fn fault_07_a_damaged_frame_of_an_unfinished_file_cuts_it_at_the_commit_before() {
    let (bytes, ends, _) = recorded();
    let folder = tempfile::tempdir().unwrap();
    let end = ends[FRAMES as usize - 1] as usize;
    for (frame, from) in [(3, ends[2] as usize), (5, ends[4] as usize)] {
        // A hole, as a power cut leaves it: of a whole frame, and within one.
        for (start, length) in [(from, ends[frame] as usize - from), (from + 700, 64)] {
            let mut holed = bytes[..end].to_vec();
            holed[start..start + length].fill(0);
            let recording = Recording::open(written(folder.path(), &holed)).unwrap();
            assert_eq!(recording.frames(RunId(0)).len(), frame);
            assert!(matches!(recording.condition(), Condition::Damaged { cut: true, .. }), "{}", recording.condition());
            assert_eq!(read_all(recording.path()).unwrap(), frame);
        }
    }
}

#[test]
fn fault_49_a_recording_says_in_what_condition_it_is() {
    let (bytes, ends, _) = recorded();
    let folder = tempfile::tempdir().unwrap();
    let condition_of = |bytes: &[u8]| Recording::open(written(folder.path(), bytes)).unwrap().condition().clone();
    assert_eq!(condition_of(bytes), Condition::Complete);
    assert_eq!(condition_of(&bytes[..ends[3] as usize]), Condition::Unfinished { rest_bytes: 0 });
    let cut = condition_of(&bytes[..ends[3] as usize + 500]);
    assert_eq!(cut, Condition::Unfinished { rest_bytes: 500 });
    assert_eq!(cut.to_string(), "unfinished: its last 500 bytes are not part of a complete frame");
    // A record of the fourth frame that is reported to have no end: what follows shows that it had one.
    let mut endless = bytes[..ends[4] as usize].to_vec();
    endless[ends[2] as usize + 4] ^= 1;
    let Condition::Damaged { offset, what, cut: true } = condition_of(&endless) else { panic!("not seen") };
    assert_eq!(offset, ends[2]);
    assert_eq!(what, "the sizes of a chunk contradict each other");
    // A summary that is damaged costs nothing but time.
    let mut flipped = bytes.clone();
    let place = bytes.len() - 100;
    flipped[place] ^= 1;
    let Condition::Damaged { what, cut: false, .. } = condition_of(&flipped) else { panic!("not seen") };
    assert_eq!(what, "the summary's checksum differs");
    assert_eq!(everything(&folder.path().join("recording.mcap")).unwrap(), {
        everything(&written(folder.path(), bytes)).unwrap()
    });
}

#[test]
fn recover_copies_the_complete_frames_of_finished_and_unfinished_files() {
    let (bytes, ends, _) = recorded();
    let folder = tempfile::tempdir().unwrap();
    let recovered = |bytes: &[u8]| {
        let from = Recording::open(written(folder.path(), bytes)).unwrap();
        let to = folder.path().join("recovered.mcap");
        let _ = std::fs::remove_file(&to);
        let recovered = recover(&from, &to).unwrap();
        assert_eq!(read_all(&to).unwrap() as u64, recovered.frames);
        let damage = recovered.damage.map(|damage| damage.to_string());
        (recovered.frames, damage, std::fs::read(to).unwrap())
    };
    assert!(recovered(bytes) == (FRAMES, None, bytes.clone()), "a good file is copied unchanged");
    let (frames, damage, _) = recovered(&bytes[..ends[3] as usize + 500]);
    assert_eq!((frames, damage), (4, None));
    let mut flipped = bytes.clone();
    let place = bytes.len() - 100;
    flipped[place] ^= 1;
    let (frames, damage, _) = recovered(&flipped);
    let damage = damage.unwrap();
    assert!(frames == FRAMES && damage.contains("the summary's checksum differs"), "{frames} {damage}");
}

#[test]
fn a_recording_of_another_format_is_refused_with_the_remedy() {
    let (bytes, ends, _) = recorded();
    let folder = tempfile::tempdir().unwrap();
    let format_entry = b"\x06\0\0\0format\x02\0\0\x0010";
    let place = bytes.windows(format_entry.len()).position(|window| window == format_entry).unwrap();
    for bytes in [&bytes[..], &bytes[..ends[1] as usize]] {
        let mut other = bytes.to_vec();
        other[place + format_entry.len() - 1] = b'1';
        let error = Recording::open(written(folder.path(), &other)).unwrap_err();
        let expected = "has recording format 11, but this version of depthloom reads format 10 only";
        assert!(error.to_string().ends_with(expected), "{error}");
        assert!(!error.remedy().unwrap().contains("depthloom 0.1"));
    }
    let of_0_1 = RecordingError::Format { path: folder.path().to_owned(), found: "5".to_owned() };
    assert!(of_0_1.remedy().unwrap().contains("depthloom 0.1"));
}

#[test]
fn a_flipped_pixel_is_found() {
    let (bytes, ..) = recorded();
    let folder = tempfile::tempdir().unwrap();
    // A noisy map has its own chunk, uncompressed.
    let summary = mcap::Summary::read(bytes).unwrap().expect("a summary");
    let channel = summary.channels.values().find(|channel| channel.topic == TOPICS[0]).unwrap().id;
    let mut chunks = summary.chunk_indexes.iter();
    let chunk = chunks.find(|chunk| chunk.message_index_offsets.contains_key(&channel)).unwrap();
    assert_eq!(chunk.compression, "");
    let place = (chunk.chunk_start_offset + chunk.chunk_length - 100) as usize;
    let mut flipped = bytes.clone();
    flipped[place] ^= 1;
    let path = written(folder.path(), &flipped);
    let Err(error) = read_all(&path) else { panic!("the flip was not found") };
    assert!(matches!(error, RecordingError::File(FileError::Damaged { .. })), "{error}");
    assert!(error.to_string().contains("recording.mcap is damaged at byte"), "{error}");
    let content = "it contained /compare/fused/depth of frame `000000_10` (position 0 of stage `compare`)";
    assert!(error.to_string().ends_with(&format!("a chunk's checksum differs; {content}")), "{error}");
    assert_eq!(error.remedy().unwrap(), "copy the file again, or run the experiment again");
    // Only readers of the damaged topics read their chunk.
    let recording = Recording::open(&path).unwrap();
    let stereo = recording
        .reader(RunId(0), &["/compare/stereo/disparity", "/compare/source/left"])
        .unwrap()
        .read(FrameIndex(0))
        .unwrap();
    assert!(stereo.iter().all(Option::is_some));
}

#[test]
fn every_damaged_byte_of_a_finished_file_is_found_without_reading_its_values() {
    let (bytes, ..) = recorded();
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), bytes);
    assert_eq!(Recording::open(&path).unwrap().damage(&|| false), []);
    let (mut found, mut seen_when_opened) = (0, 0);
    let mut flipped = bytes.clone();
    for place in (0..bytes.len()).step_by(sparse(37)) {
        flipped[place] ^= 1 << (place % 8);
        std::fs::write(&path, &flipped).unwrap();
        match Recording::open(&path) {
            Ok(recording) if *recording.condition() == Condition::Complete => {
                let [damage] = &recording.damage(&|| false)[..] else { panic!("byte {place}") };
                let stretch = damage.offset..damage.offset + damage.bytes;
                assert!(stretch.contains(&(place as u64)), "byte {place} is not in {damage:?}");
                found += 1;
            }
            _ => seen_when_opened += 1,
        }
        flipped[place] ^= 1 << (place % 8);
    }
    assert!(found > 2 * seen_when_opened && seen_when_opened > 0, "{found} {seen_when_opened}");
}

#[test]
fn damage_is_named_by_what_it_held() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan();
    plan.record.view = false;
    record(&path, &plan, 0..4, 64, 48);
    let mut bytes = std::fs::read(&path).unwrap();
    let place_of = |bytes: &[u8], text: &[u8]| bytes.windows(text.len()).position(|window| window == text).unwrap();
    // A PNG file of the second frame, the model, and the attached note; the first frame's PNG is whole.
    let first = place_of(&bytes, b"IDAT");
    let png = first + 1 + place_of(&bytes[first + 1..], b"IDAT");
    let places = [png, place_of(&bytes, &[7; 100]), place_of(&bytes, b"text/plain") + 20];
    places.iter().for_each(|place| bytes[*place] ^= 1);
    let recording = Recording::open(written(folder.path(), &bytes)).unwrap();
    assert_eq!(*recording.condition(), Condition::Complete);
    let damage = recording.damage(&|| false);
    let contents: Vec<String> = damage.iter().map(|damage| damage.content.to_string()).collect();
    let [image, model, note] = &contents[..] else { panic!("{contents:?}") };
    assert!(image.contains("/compare/source/left"), "{image}");
    assert!(image.ends_with("of frame `000001_10` (position 1 of stage `compare`)"), "{image}");
    assert!(model.starts_with("the attachment `artifacts/"), "{model}");
    assert_eq!(note, "the attachment `note.txt`");
    for (damage, place) in damage.iter().zip(places) {
        assert!((damage.offset..damage.offset + damage.bytes).contains(&(place as u64)), "{damage:?}");
    }
    let error = recording.attachment("note.txt").unwrap_err();
    assert!(error.to_string().ends_with("it contained the attachment `note.txt`"), "{error}");
}

#[test]
fn points_of_a_curve_that_was_not_finished_belong_to_nothing() {
    let (bytes, ends, aggregate_end) = recorded();
    let folder = tempfile::tempdir().unwrap();
    let digest_of = |end: u64| {
        let path = written(folder.path(), &bytes[..end as usize]);
        digest(&path)["topics"].as_object().unwrap().clone()
    };
    let whole = digest_of(*aggregate_end);
    assert_eq!(whole[CURVE]["count"], curve().points.len());
    // The last byte cut is one of the record that would commit the curve: its messages are all there.
    let cut = digest_of(aggregate_end - 1);
    assert!(!cut.contains_key(CURVE));
    assert_eq!(cut.len() + 1, whole.len());
    assert_eq!(digest_of(ends[FRAMES as usize - 1]), cut);
}

#[test]
fn a_changed_record_of_an_aggregate_value_is_detected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), 0..1, 16, 16);
    let mut bytes = std::fs::read(&path).unwrap();
    // The number of messages in the record that commits the curve, as text with its length.
    let entry = b"\x08\0\0\0messages\x01\0\0\x004";
    let place = bytes.windows(entry.len()).position(|window| window == entry).unwrap();
    bytes[place + entry.len() - 1] = b'5';
    let recording = Recording::open(written(folder.path(), &bytes)).unwrap();
    assert!(recording.condition().to_string().contains("a metadata record is damaged"));
    let [model] = recording.aggregate_values() else { panic!("the curve is left out") };
    let model = recording.aggregate_value(model).unwrap();
    assert!(matches!(model, depthloom_graphs::Value::Model(_)), "the model is whole");
}

#[test]
fn other_files_are_named_for_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let text = written(folder.path(), b"experiment: table1\n");
    assert!(matches!(Recording::open(&text), Err(RecordingError::NotMcap { .. })));
    // What ends as an MCAP file and does not begin as one is a damaged one.
    let damaged = text.with_file_name("damaged.mcap");
    let bytes = [b"\x88MCAP0\r\n".as_slice(), &[0; 64], mcap::MAGIC].concat();
    std::fs::write(&damaged, bytes).unwrap();
    assert!(matches!(Recording::open(&damaged), Err(RecordingError::File(FileError::Damaged { offset: 0, .. }))));
    let path = folder.path().join("other.mcap");
    mcap::Writer::new(File::create(&path).unwrap()).unwrap().finish().unwrap();
    let error = Recording::open(&path).unwrap_err();
    assert!(matches!(error, RecordingError::NotARecording { .. }));
    assert!(error.remedy().unwrap().starts_with("give a recording that `depthloom run` made; if it is one"));
    // The same without a summary: its program was killed.
    let mut writer = mcap::Writer::new(File::create(&path).unwrap()).unwrap();
    let channel_id = writer.add_channel(0, "/a", "json", &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    drop(writer);
    let bytes = std::fs::read(&path).unwrap();
    let killed = written(folder.path(), &bytes[..bytes.len() - 50]);
    let error = Recording::open(&killed).unwrap_err();
    assert!(matches!(error, RecordingError::NotARecording { .. }), "{error}");
    assert!(matches!(Recording::open(folder.path().join("absent")), Err(RecordingError::File(FileError::Open { .. }))));
}

#[test]
fn nothing_is_written_after_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan()).unwrap();
    recorder.finish(&[]).unwrap();
    let size = std::fs::metadata(&path).unwrap().len();
    let commit = depthloom_graphs::contracts::Commit {
        run: RunId(0),
        frame: &frame(0),
        source_key: None,
        keys: &[],
        failures: &[],
        absent: &[],
        warnings: &[],
        live: None,
    };
    let error = recorder.write(&commit, Vec::new()).unwrap_err();
    assert!(error.to_string().ends_with("cannot be written any more: it is finished"), "{error}");
    assert!(recorder.finish(&[]).is_err());
    assert_eq!(std::fs::metadata(&path).unwrap().len(), size);
    assert_eq!(Recording::open(&path).unwrap().frames(RunId(0)).len(), 0);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_said_to_be_full() {
    let folder = tempfile::tempdir().unwrap();
    let full = |_: File| -> Arc<dyn Disk> { Arc::new(File::options().write(true).open("/dev/full").unwrap()) };
    let created = Recorder::create_through(folder.path().join("recording.mcap"), &plan(), &full);
    let Err(error) = created else { panic!("/dev/full took bytes") };
    assert!(matches!(&error, RecordingError::Write { offset: 0, .. }), "{error}");
    assert!(error.remedy().unwrap().starts_with("free some space"), "{error}");
}

#[test]
#[cfg(unix)]
fn a_recording_is_never_written_through_a_link_or_into_a_device() {
    let folder = tempfile::tempdir().unwrap();
    let (path, precious) = (folder.path().join("recording.mcap"), folder.path().join("precious"));
    std::fs::write(&precious, "years").unwrap();
    std::os::unix::fs::symlink(&precious, &path).unwrap();
    Recorder::create(&path, &plan()).unwrap().finish(&[]).unwrap();
    assert!(!path.is_symlink());
    // A link in place of the recording that is to be continued.
    let elsewhere = folder.path().join("elsewhere.mcap");
    let (bytes, ends, _) = recorded();
    let before = &bytes[..usize::try_from(ends[2]).unwrap()];
    std::fs::write(&elsewhere, before).unwrap();
    std::fs::remove_file(&path).unwrap();
    std::os::unix::fs::symlink(&elsewhere, &path).unwrap();
    let resumed = |path: &Path| Recorder::resume(&Recording::open(path).unwrap(), &plan());
    assert!(resumed(&path).is_err());
    assert!(std::fs::read(&elsewhere).unwrap() == before);
    assert!(resumed(&elsewhere).is_ok());
    assert_eq!(std::fs::read_to_string(&precious).unwrap(), "years");
    assert!(Recorder::create("/dev/null", &plan()).is_err());
}

#[test]
fn equal_topics_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan();
    plan.runs[0].nodes[3].outputs[0].topic = "/compare/depth/depth".to_owned();
    let Err(error) = Recorder::create(&path, &plan) else { panic!("two outputs share a topic") };
    assert_eq!(error.to_string(), "topic /compare/depth/depth: two outputs have this topic");
    assert!(!path.exists());
    plan.runs[0].nodes[3].outputs[0].recorded = false;
    record(&path, &plan, 0..1, 16, 16);
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.plan().runs[0].estimates[0].estimate_topic, None);
}

#[test]
fn fault_49_a_run_that_ended_before_its_end_says_so_in_a_closed_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan()).unwrap();
    record_frame(&recorder, RunId(0), &frame(0), &values(&frame(0), 20, 12), false);
    recorder.finish_early().unwrap();
    let recording = Recording::open(&path).unwrap();
    assert_eq!(*recording.condition(), Condition::Unfinished { rest_bytes: 0 });
    assert_eq!(read_all(&path).unwrap(), 1);
    // Other readers find the summary: the file is closed.
    let bytes = std::fs::read(&path).unwrap();
    assert!(mcap::Summary::read(&bytes).unwrap().is_some());
}

#[test]
fn a_damaged_message_index_makes_topic_sizes_fail() {
    let (bytes, ..) = recorded();
    let folder = tempfile::tempdir().unwrap();
    // A message index with one entry: its opcode and length; the channel follows.
    let head = [7, 22, 0, 0, 0, 0, 0, 0, 0];
    let place = bytes.windows(head.len()).position(|window| window == head).expect("a message index");
    let mut flipped = bytes.clone();
    flipped[place + head.len()] ^= 1;
    let recording = Recording::open(written(folder.path(), &flipped)).unwrap();
    assert_eq!(*recording.condition(), Condition::Complete);
    let error = recording.topic_sizes(&|| false).unwrap_err();
    assert!(error.is_damage(), "{error}");
    assert!(error.to_string().contains("the message indexes contradict the counts in the summary"), "{error}");
}
