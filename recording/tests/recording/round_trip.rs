//! What is recorded is read back, bit for bit.

use crate::digest::digest;
use crate::fixture::{
    BEGINNING_NS, CURVE, curve, frame, key, model, plan, plan_of, record, record_aggregate_values, record_frame, values,
};
use depthloom_graphs::contracts::{Failure, Sink, Slot, Store, StoredState};
use depthloom_graphs::plan::{FrameIndex, NodeId, PartId, PlannedOutput, PortId, RunId};
use depthloom_graphs::values::{Curve, Number, Pixels};
use depthloom_graphs::{Key, Port, Value, ValueType};
use depthloom_recording::{Condition, RecordedContent, Recorder, Recording, RecordingError};
use depthloom_scores::ScoreRow;

const WIDTH: u32 = 70;
const HEIGHT: u32 = 40;

fn bits(samples: &[f32]) -> Vec<u32> {
    samples.iter().map(|sample| sample.to_bits()).collect()
}

fn curve_bits(curve: &Curve) -> Vec<(u64, u64, Option<u64>, u64)> {
    let bits = |point: &depthloom_graphs::values::CurvePoint| {
        (point.step, point.loss.to_bits(), point.validation.map(f64::to_bits), point.learning_rate.to_bits())
    };
    curve.points.iter().map(bits).collect()
}

/// Equality of every bit.
fn assert_same(recorded: &Value, read: &Value) {
    match (recorded, read) {
        (Value::Image(a), Value::Image(b)) => {
            assert_eq!(a.pixels(), b.pixels());
            assert_eq!(a.encoded(), b.encoded());
        }
        (Value::Disparity(a), Value::Disparity(b)) => assert_eq!(a, b),
        (Value::TrueDisparity(a), Value::TrueDisparity(b)) => assert_eq!(a, b),
        (Value::Depth(a), Value::Depth(b)) => {
            assert_eq!(a.metres.dimensions(), b.metres.dimensions());
            assert_eq!(bits(&a.metres), bits(&b.metres));
        }
        (Value::Weight(a), Value::Weight(b)) => assert_eq!(bits(&a.share), bits(&b.share)),
        (Value::Mask(a), Value::Mask(b)) => assert_eq!(a, b),
        (Value::Calibration(a), Value::Calibration(b)) => assert_eq!(a, b),
        (Value::Number(a), Value::Number(b)) => assert_eq!(a.value.to_bits(), b.value.to_bits()),
        (Value::Scores(a), Value::Scores(b)) => {
            assert_eq!(a.len(), b.len());
            for (a, b) in a.iter().zip(b.iter()) {
                let bits = |row: &ScoreRow| -> Vec<(&str, u64)> {
                    row.scores.iter().map(|(metric, score)| (metric.name, score.to_bits())).collect()
                };
                assert_eq!((a, bits(a)), (b, bits(b)));
            }
        }
        (Value::Curve(a), Value::Curve(b)) => assert_eq!(curve_bits(a), curve_bits(b)),
        (a, b) => panic!("{} came back as {}", a.value_type(), b.value_type()),
    }
}

/// The ports that a recording knows under a key, with their values; without those whose values were not recorded.
fn stored(recording: &Recording, key: &Key) -> Vec<(String, Option<Value>)> {
    let known =
        recording.find(key).expect("the key is known").into_iter().filter(|held| held.state != StoredState::NotKept);
    known.map(|held| (held.port.clone(), recording.value(key, &held.port).expect("it is readable"))).collect()
}

#[test]
fn numbers_of_frames_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan();
    let outputs = &mut plan.runs[0].nodes[2].outputs;
    let port = Port::frame("version", ValueType::Number, "Which network computed this frame.");
    outputs.push(PlannedOutput { port, topic: "/compare/edges/version".to_owned(), ..outputs[0].clone() });
    let slot = Slot::Node { node: NodeId(2), port: PortId(2) };
    let recorded = |index: u64| Value::from(Number { value: [0.0, -0.0, 0.1 + 0.2, 7.0][index as usize] });
    let recorder = Recorder::create(&path, &plan).unwrap();
    for index in 0..4 {
        let mut of_frame = values(&frame(index), WIDTH, HEIGHT);
        of_frame.push((slot, recorded(index)));
        record_frame(&recorder, RunId(0), &frame(index), &of_frame, false);
    }
    recorder.finish(&[]).unwrap();
    let recording = Recording::open(&path).unwrap();
    for index in 0..4 {
        let read = recording.value(&key(&frame(index), NodeId(2)), "version").unwrap().unwrap();
        assert_same(&recorded(index), &read);
    }
}

#[test]
fn every_value_comes_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), 10..16, WIDTH, HEIGHT);
    let recording = Recording::open(&path).unwrap();
    assert_eq!(*recording.condition(), Condition::Complete);
    let outputs: Vec<_> = recording.plan().outputs(RunId(0)).filter(|(_, output)| !output.once).collect();
    let topics: Vec<&str> = outputs.iter().map(|(_, output)| output.topic.as_str()).collect();
    assert_eq!(topics.len(), 10);
    let mut reader = recording.reader(RunId(0), &topics).unwrap();
    assert_eq!(recording.frames(RunId(0)).len(), 6);
    for (position, index) in (10..16).enumerate() {
        let expected = values(&frame(index), WIDTH, HEIGHT);
        let read = reader.read(FrameIndex(position)).unwrap();
        for ((slot, output), read) in outputs.iter().zip(&read) {
            let expected = expected.iter().find(|(of, _)| of == slot).map(|(_, value)| value);
            match (expected, read) {
                (Some(expected), Some(read)) => assert_same(expected, read),
                (None, None) => {}
                (expected, read) => panic!("{} of frame {index}: {expected:?}, {read:?}", output.topic),
            }
        }
    }
    let (first, from_iterator) = recording.reader(RunId(0), &topics[..1]).unwrap().next().unwrap().unwrap();
    assert_eq!(&*first.id, "000010_10");
    assert!(matches!(&from_iterator[0], Some(Value::Image(image)) if matches!(image.pixels(), Pixels::Rgb(_))));
}

#[test]
fn frames_keep_ids_times_keys_and_failures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), 0..3, 16, 16);
    let recording = Recording::open(&path).unwrap();
    let frames = recording.frames(RunId(0));
    assert_eq!(
        frames.iter().map(|of| (&*of.id, of.index, of.time_ns - BEGINNING_NS)).collect::<Vec<_>>(),
        [("000000_10", 0, 0), ("000001_10", 1, 100_000_000), ("000002_10", 2, 200_000_000)]
    );
    assert_eq!(frames[1].source_key, Some(Key::build("source").number(1).finish()));
    assert_eq!(frames[1].keys.iter().map(|of| of.node.0).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    assert_eq!(frames[1].keys[3].key, key(&frame(1), NodeId(3)));
    assert!(frames[1].failures.is_empty());
    assert_eq!(frames[2].keys.len(), 4);
    assert_eq!(frames[2].failures, [Failure { node: Some(NodeId(4)), what: "score: no truth".to_owned() }]);
}

#[test]
fn the_plan_and_the_files_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), 0..1, 16, 16);
    let recording = Recording::open(&path).unwrap();
    let recorded = recording.plan();
    assert_eq!(*recorded, depthloom_recording::RecordedPlan::from_plan(&plan()));
    let estimate = &recorded.runs[0].estimates[0];
    assert_eq!(estimate.label, "fused");
    assert_eq!(estimate.estimate_topic.as_deref(), Some("/compare/fused/depth"));
    assert_eq!(estimate.truth_topic.as_deref(), Some("/compare/source/depth"));
    assert_eq!(estimate.score_topic.as_deref(), Some("/compare/score_fused/scores"));
    assert_eq!(estimate.score_params["preset"], "martins2018");
    assert_eq!(recording.attachment("experiment/fixture.yaml").unwrap(), b"experiment: fixture\n");
    assert_eq!(recording.attachment("experiment.resolved.yaml").unwrap(), b"experiment: fixture\nvariants: {}\n");
    assert_eq!(recording.attachment("note.txt").unwrap(), b"note");
    assert!(matches!(recording.attachment("other"), Err(RecordingError::Missing { .. })));
}

#[test]
fn an_alias_reads_the_topic_it_stands_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), 0..1, 16, 16);
    let recording = Recording::open(&path).unwrap();
    let alias = recording.reader(RunId(0), &["/compare/full/fused/depth"]).unwrap().read(FrameIndex(0)).unwrap();
    let topic = recording.reader(RunId(0), &["/compare/fused/depth"]).unwrap().read(FrameIndex(0)).unwrap();
    assert_same(alias[0].as_ref().unwrap(), topic[0].as_ref().unwrap());
    let unknown = recording.reader(RunId(0), &["/compare/fused/depht"]);
    assert!(matches!(unknown, Err(RecordingError::UnknownTopic { topic, .. }) if topic == "/compare/fused/depht"));
}

#[test]
fn values_are_found_by_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), 0..3, 16, 16);
    let recording = Recording::open(&path).unwrap();
    let frame = frame(1);
    let expected = values(&frame, 16, 16);
    let fused = expected.iter().find(|(slot, _)| *slot == Slot::Node { node: NodeId(3), port: PortId(0) }).unwrap();
    let ports = |stored: &[(String, Option<Value>)]| stored.iter().map(|(port, _)| port.clone()).collect::<Vec<_>>();
    let [(_, Some(found))] = &stored(&recording, &key(&frame, NodeId(3)))[..] else { panic!("one port") };
    assert_same(&fused.1, found);
    assert_eq!(ports(&stored(&recording, &key(&frame, NodeId(2)))), ["weight", "mask"]);
    let train = stored(&recording, &Key::of_content(b"train"));
    assert_eq!(ports(&train), ["model", "curve"]);
    let [(_, Some(Value::Model(model))), (_, Some(learned))] = &train[..] else { panic!() };
    assert_eq!(*model.bytes, [7; 1000]);
    assert_same(&curve().into(), learned);
    assert!(recording.find(&Key::of_content(b"unknown")).is_none());
}

#[test]
fn a_store_tells_what_is_known_to_be_nothing_from_what_was_not_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan();
    plan.record.every = 2;
    let recorder = Recorder::create(&path, &plan).unwrap();
    for index in 0..2 {
        let absent = |slot: &Slot| *slot == Slot::Node { node: NodeId(2), port: PortId(1) };
        let values: Vec<_> = values(&frame(index), 16, 16).into_iter().filter(|(slot, _)| !absent(slot)).collect();
        record_frame(&recorder, RunId(0), &frame(index), &values, false);
    }
    recorder
        .once(RunId(0), Slot::Node { node: NodeId(5), port: PortId(0) }, &Key::of_content(b"train"), &model(), &[])
        .unwrap();
    let ports = |recording: &Recording, key: Key| -> Vec<(String, bool)> {
        stored(recording, &key).into_iter().map(|(port, value)| (port, value.is_some())).collect()
    };
    let unfinished = Recording::open(&path).unwrap();
    assert_eq!(ports(&unfinished, Key::of_content(b"train")), [("model".to_owned(), true)], "the rest may come yet");
    recorder.finish(&[]).unwrap();
    let finished = Recording::open(&path).unwrap();
    let (model, curve) = (("model".to_owned(), true), ("curve".to_owned(), false));
    assert_eq!(ports(&finished, Key::of_content(b"train")), [model, curve]);
    let (weight, mask) = (("weight".to_owned(), true), ("mask".to_owned(), false));
    assert_eq!(ports(&finished, key(&frame(0), NodeId(2))), [weight, mask]);
    assert_eq!(ports(&finished, key(&frame(1), NodeId(2))), Vec::new(), "values are recorded on every second frame");
    assert_eq!(ports(&finished, key(&frame(1), NodeId(4))), [("scores".to_owned(), true)], "scores of all");
}

#[test]
fn a_learning_curve_lies_between_two_stages_and_in_no_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan_of(&["learn", "compare"])).unwrap();
    for (run, frames) in [(0, 3..5), (1, 0..2)] {
        for index in frames {
            record_frame(&recorder, RunId(run), &frame(index), &values(&frame(index), 16, 16), false);
        }
        record_aggregate_values(&recorder, RunId(run));
    }
    recorder.finish(&[]).unwrap();
    let recording = Recording::open(&path).unwrap();
    let once = recording.aggregate_values();
    let outputs: Vec<_> =
        once.iter().map(|value| (value.run.0, value.node.0, value.port.0, value.value_type.as_str())).collect();
    assert_eq!(outputs, [(0, 5, 0, "model"), (0, 5, 1, "curve"), (1, 5, 0, "model"), (1, 5, 1, "curve")]);
    let topics = ["/learn/train/curve", CURVE];
    for (of, topic) in [&once[1], &once[3]].into_iter().zip(topics) {
        assert_eq!(of.content, RecordedContent::Messages { topic: topic.to_owned(), count: 4 });
        assert_same(&curve().into(), &recording.aggregate_value(of).unwrap());
    }
    assert_eq!([0, 1].map(|run| recording.frames(RunId(run)).len()), [2, 2]);
    assert!(recording.reader(RunId(1), &[CURVE]).is_err(), "a curve is not a value of a frame");
    // A millisecond a step, from the first frame of the stage on: all stages begin at once.
    let digest = digest(&path);
    for topic in topics {
        let first_ns = BEGINNING_NS;
        let topic = &digest["topics"][topic];
        assert_eq!((&topic["schema"], &topic["count"]), (&"depthloom.CurvePoint".into(), &4.into()));
        assert_eq!((&topic["first_ns"], &topic["last_ns"]), (&first_ns.into(), &(first_ns + 250_000_000).into()));
    }
}

#[test]
fn a_curve_without_points_and_one_without_frames_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan_of(&["learn", "compare"])).unwrap();
    let (slot, key) = (Slot::Node { node: NodeId(5), port: PortId(1) }, Key::of_content(b"train"));
    recorder.once(RunId(0), slot, &key, &Curve::default().into(), &[]).unwrap();
    recorder.once(RunId(1), slot, &key, &curve().into(), &[]).unwrap();
    recorder.finish(&[]).unwrap();
    let recording = Recording::open(&path).unwrap();
    let read = |place: usize| recording.aggregate_value(&recording.aggregate_values()[place]).unwrap();
    assert_same(&Curve::default().into(), &read(0));
    assert_same(&curve().into(), &read(1));
}

#[test]
fn every_second_frame_keeps_values_and_every_frame_its_scores() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan();
    plan.record.every = 2;
    record(&path, &plan, 0..4, 16, 16);
    let recording = Recording::open(&path).unwrap();
    let mut reader = recording.reader(RunId(0), &["/compare/fused/depth", "/compare/score_fused/scores"]).unwrap();
    let recorded: Vec<(bool, bool)> = (0..4)
        .map(|position| reader.read(FrameIndex(position)).unwrap())
        .map(|values| (values[0].is_some(), values[1].is_some()))
        .collect();
    // Frame 2 has no truth, and so no scores.
    assert_eq!(recorded, [(true, true), (false, true), (true, false), (false, true)]);
}

#[test]
fn fault_29_every_nth_frame_counts_from_the_first_of_the_stage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan();
    plan.record.every = 100;
    record(&path, &plan, 151..155, 16, 16);
    let recording = Recording::open(&path).unwrap();
    let mut reader = recording.reader(RunId(0), &["/compare/fused/depth"]).unwrap();
    let recorded: Vec<bool> = (0..4).map(|position| reader.read(FrameIndex(position)).unwrap()[0].is_some()).collect();
    assert_eq!(recorded, [true, false, false, false]);
}

#[test]
fn parts_encoded_in_any_order_give_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let files = [false, true].map(|backwards| {
        let path = folder.path().join(format!("{backwards}.mcap"));
        let recorder = Recorder::create(&path, &plan()).unwrap();
        // Meanwhile other frames' parts are encoded, as on a machine with more workers.
        let other = values(&frame(99), 300, 100);
        for index in 0..3 {
            if backwards {
                Sink::encode(&recorder, RunId(0), (FrameIndex(99), &frame(99)), PartId(1), &other).unwrap();
            }
            record_frame(&recorder, RunId(0), &frame(index), &values(&frame(index), 300, 100), backwards);
        }
        recorder.finish(&[]).unwrap();
        std::fs::read(path).unwrap()
    });
    assert!(files[0] == files[1]);
}

#[test]
fn two_stage_runs_share_a_file_and_keep_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan_of(&["learn", "compare"])).unwrap();
    // Their frames are of the same instants.
    for (run, frames) in [(0, 0..3), (1, 1..5)] {
        for index in frames {
            record_frame(&recorder, RunId(run), &frame(index), &values(&frame(index), 16, 16), false);
        }
    }
    let written = recorder.finish(&[]).unwrap();
    assert_eq!(written.frames, 7);
    assert_eq!(written.bytes, std::fs::metadata(&path).unwrap().len());
    let recording = Recording::open(&path).unwrap();
    let indices = |run| recording.frames(run).iter().map(|frame| frame.index).collect::<Vec<_>>();
    assert_eq!((indices(RunId(0)), indices(RunId(1))), (vec![0, 1, 2], vec![1, 2, 3, 4]));
    let of_learning = recording.reader(RunId(0), &["/learn/fused/depth"]).unwrap().read(FrameIndex(2)).unwrap();
    let of_comparing = recording.reader(RunId(1), &["/compare/fused/depth"]).unwrap().read(FrameIndex(1)).unwrap();
    assert_same(of_learning[0].as_ref().unwrap(), of_comparing[0].as_ref().unwrap());
    assert!(recording.reader(RunId(0), &["/compare/fused/depth"]).is_err());
    assert_eq!(recording.frames(RunId(2)), []);
}
