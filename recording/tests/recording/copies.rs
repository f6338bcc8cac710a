//! Values of an earlier run are copied unchanged.

use std::sync::Arc;

use depthloom_graphs::contracts::{Commit, Sink, Slot, SlotKey, Store as _, StoredValue};
use depthloom_graphs::plan::{FrameIndex, NodeId, OutputPattern, PartId, PortId, RunId};
use depthloom_graphs::{Key, Value};
use depthloom_recording::{EarlierRuns, Recorder};
use mcap::Summary;

use crate::fixture::{frame, key, plan, record_frame, values};

const WIDTH: u32 = 70;
const HEIGHT: u32 = 40;

#[test]
fn every_raster_has_a_chunk_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan()).unwrap();
    let frame = frame(0);
    record_frame(&recorder, RunId(0), &frame, &values(&frame, WIDTH, HEIGHT), false);
    recorder.finish(&[]).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let summary = Summary::read(&bytes).unwrap().expect("a summary");
    let is_of_rasters = |id: &u16| {
        summary.channels[id]
            .schema
            .as_ref()
            .is_some_and(|schema| ["Image", "FloatMap"].iter().any(|of| schema.name.ends_with(of)))
    };
    let mut rasters = 0;
    for chunk in &summary.chunk_indexes {
        let channels: Vec<u16> = chunk.message_index_offsets.keys().copied().collect();
        rasters += usize::from(channels.iter().any(is_of_rasters));
        assert!(channels.len() == 1 || !channels.iter().any(is_of_rasters), "{channels:?}");
    }
    assert_eq!(rasters, 8 + 5, "with pictures of four maps and the truth");
}

#[test]
fn values_of_an_earlier_run_and_made_ones_give_the_bytes_of_made_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (frame, mut plan) = (frame(0), plan());
    let any = || "*".to_owned();
    plan.record.points = vec![OutputPattern { stage: any(), node: any(), port: any() }];
    let of_frame = values(&frame, WIDTH, HEIGHT);
    let made = Recorder::create(path("made.mcap"), &plan).unwrap();
    record_frame(&made, RunId(0), &frame, &of_frame, false);
    made.finish(&[]).unwrap();
    let expected = std::fs::read(path("made.mcap")).unwrap();

    let source_key = Key::build("source").number(frame.index).finish();
    let key_of = |slot: Slot| match slot {
        Slot::Source { .. } => source_key,
        Slot::Node { node, .. } => key(&frame, node),
    };
    let port_of = |slot: Slot| match slot {
        Slot::Source { port } => plan.runs[0].source.outputs[port].port.name,
        Slot::Node { node, port } => plan.runs[0].nodes[node].outputs[port].port.name,
    };
    let slots: Vec<Slot> = of_frame.iter().map(|(slot, _)| *slot).collect();
    // Which of the values are recomputed: each alone, none, and all except one that was read for a node.
    for again in 0..slots.len() + 2 {
        let earlier = Arc::new(EarlierRuns::new([path("made.mcap")], &plan));
        let recorder = Recorder::create(path("taken.mcap"), &plan).unwrap().with_earlier(earlier);
        let mut of_parts: Vec<Vec<(Slot, Value)>> = vec![Vec::new(); recorder.parts(RunId(0))];
        let mut stored_of_parts: Vec<Vec<StoredValue<'_>>> = vec![Vec::new(); recorder.parts(RunId(0))];
        for (number, (slot, value)) in of_frame.iter().enumerate() {
            let part = recorder.part(RunId(0), *slot).unwrap();
            if number == again || (again == slots.len() + 1 && number != 6) {
                of_parts[part].push((*slot, value.clone()));
            } else {
                let value = (again == slots.len() + 1).then(|| value.clone());
                stored_of_parts[part].push(StoredValue {
                    slot: *slot,
                    key: key_of(*slot),
                    port: port_of(*slot),
                    value,
                });
            }
        }
        let parts = of_parts.iter().zip(&stored_of_parts).enumerate();
        let parts = parts.map(|(part, (made, stored))| {
            recorder.encode_stored(RunId(0), (FrameIndex(0), &frame), PartId(part), made, stored).unwrap()
        });
        let keys: Vec<SlotKey> =
            (0..5).map(|node| SlotKey { node: NodeId(node), key: key(&frame, NodeId(node)) }).collect();
        let (run, source_key) = (0, Some(source_key));
        let commit = Commit {
            run: RunId(run),
            frame: &frame,
            source_key,
            keys: &keys,
            failures: &[],
            absent: &[],
            warnings: &[],
            live: None,
        };
        recorder.write(&commit, parts.collect()).unwrap();
        recorder.finish(&[]).unwrap();
        assert!(std::fs::read(path("taken.mcap")).unwrap() == expected, "{again}");
    }
}

#[test]
fn nodes_that_exchange_their_keys_exchange_their_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (frame, plan) = (frame(0), plan());
    let first = values(&frame, WIDTH, HEIGHT);
    let recorder = Recorder::create(path("first.mcap"), &plan).unwrap();
    record_frame(&recorder, RunId(0), &frame, &first, false);
    recorder.finish(&[]).unwrap();

    let exchanged = |node: NodeId| match node {
        NodeId(1) => NodeId(3),
        NodeId(3) => NodeId(1),
        other => other,
    };
    let source = |slot: Slot| match slot {
        Slot::Source { port } => Slot::Source { port },
        Slot::Node { node, port } => Slot::Node { node: exchanged(node), port },
    };
    let source_key = Key::build("source").number(frame.index).finish();
    let keys: Vec<SlotKey> = NodeId::all(5).map(|node| SlotKey { node, key: key(&frame, exchanged(node)) }).collect();
    let commit = Commit {
        run: RunId(0),
        frame: &frame,
        source_key: Some(source_key),
        keys: &keys,
        failures: &[],
        absent: &[],
        warnings: &[],
        live: None,
    };
    let recorded = |name: &str, reuses: bool| {
        let recorder = Recorder::create(path(name), &plan).unwrap();
        let earlier = Arc::new(EarlierRuns::new([path("first.mcap")], &plan));
        let recorder = if reuses { recorder.with_earlier(earlier) } else { recorder };
        let part = |part: PartId| {
            let slots = first.iter().map(|(slot, _)| *slot).filter(|slot| recorder.part(RunId(0), *slot) == Some(part));
            if !reuses {
                let value = |slot: Slot| first.iter().find(|(of, _)| *of == source(slot)).unwrap().1.clone();
                let values: Vec<(Slot, Value)> = slots.map(|slot| (slot, value(slot))).collect();
                return recorder.encode(RunId(0), (FrameIndex(0), &frame), part, &values).unwrap();
            }
            let stored = slots.map(|slot| {
                let (key, port) = match source(slot) {
                    Slot::Source { port } => (source_key, plan.runs[0].source.outputs[port].port.name),
                    Slot::Node { node, port } => (key(&frame, node), plan.runs[0].nodes[node].outputs[port].port.name),
                };
                StoredValue { slot, key, port, value: None }
            });
            recorder.encode_stored(RunId(0), (FrameIndex(0), &frame), part, &[], &stored.collect::<Vec<_>>()).unwrap()
        };
        let parts = PartId::all(recorder.parts(RunId(0))).map(part).collect();
        recorder.write(&commit, parts).unwrap();
        recorder.finish(&[]).unwrap();
        std::fs::read(path(name)).unwrap()
    };
    assert!(recorded("reused.mcap", true) == recorded("computed.mcap", false));
}

/// A chunk is checked with its frame and read again when it is copied: what another process wrote in between is
/// refused.
#[test]
fn a_chunk_that_changes_between_check_and_copy_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (frame, plan) = (frame(0), plan());
    let recorder = Recorder::create(path("first.mcap"), &plan).unwrap();
    record_frame(&recorder, RunId(0), &frame, &values(&frame, WIDTH, HEIGHT), false);
    recorder.finish(&[]).unwrap();
    let bytes = std::fs::read(path("first.mcap")).unwrap();
    let summary = Summary::read(&bytes).unwrap().expect("a summary");
    let port = plan.runs[0].nodes[1].outputs[0].port.name;
    let topic = &plan.runs[0].nodes[1].outputs[0].topic;
    let channel = summary.channels.values().find(|channel| channel.topic == *topic).expect("it is recorded").id;
    let chunk = summary.chunk_indexes.iter().find(|chunk| chunk.message_index_offsets.contains_key(&channel));
    let chunk = chunk.expect("it has a value");

    let stored = StoredValue {
        slot: Slot::Node { node: NodeId(1), port: PortId(0) },
        key: key(&frame, NodeId(1)),
        port,
        value: None,
    };
    let copy = |changed: Option<usize>| {
        std::fs::write(path("first.mcap"), &bytes).unwrap();
        let earlier = EarlierRuns::new([path("first.mcap")], &plan);
        assert!(earlier.find(&stored.key).is_some(), "the frame is checked");
        if let Some(place) = changed {
            let mut bytes = bytes.clone();
            bytes[place] ^= 1;
            std::fs::write(path("first.mcap"), bytes).unwrap();
        }
        let recorder = Recorder::create(path("second.mcap"), &plan).unwrap().with_earlier(Arc::new(earlier));
        let part = recorder.part(RunId(0), stored.slot).unwrap();
        recorder.encode_stored(RunId(0), (FrameIndex(0), &frame), part, &[], std::slice::from_ref(&stored)).map(|_| ())
    };
    copy(None).unwrap();
    let content = chunk.chunk_start_offset as usize + chunk.chunk_length as usize - 1;
    let refused = copy(Some(content)).unwrap_err();
    let refused = format!("{refused:?}");
    assert!(refused.contains("a chunk changed while it was reused"), "{refused}");
}
