//! Python's own reader decodes the same numbers.

use depthloom_graphs::plan::{FrameIndex, NodeId, PortId, RunId};
use std::path::Path;
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::values::{Disparity, Raster};
use depthloom_recording::{Recorder, Recording};
use depthloom_test_needs::{python, workspace};
use serde_json::Value as Json;

use crate::digest::digest;
use crate::fixture::{BEGINNING_NS, CURVE, frame, plan, record, record_frame, values};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;

/// Runs the script; `None`, and the test is skipped, where this machine has no Python with its packages.
fn read_with_python(test: &str, recording: &Path, arguments: &[&str]) -> Option<Json> {
    let script = workspace().join("tests/python/read_recording.py");
    let output =
        Command::new(python(test)?).arg(script).arg(recording).args(arguments).output().expect("Python starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).expect("the script prints JSON"))
}

#[test]
fn python_decodes_the_same_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let plan = plan();
    record(&path, &plan, 0..3, WIDTH, HEIGHT);
    let Some(read) = read_with_python("python_decodes_the_same_numbers", &path, &[]) else { return };
    assert_eq!(read, digest(&path));

    // The digest is checked against the values that were recorded.
    let fused: Vec<u8> = (0..3)
        .flat_map(|index| values(&frame(index), WIDTH, HEIGHT))
        .filter(|(slot, _)| *slot == Slot::Node { node: NodeId(3), port: PortId(0) })
        .flat_map(|(_, value)| {
            let Value::Depth(depth) = value else { panic!("no depth") };
            depth.metres.iter().flat_map(|metres| metres.to_le_bytes()).collect::<Vec<u8>>()
        })
        .collect();
    let numbers = fused.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    let sum: f64 = numbers.clone().filter(|metres| metres.is_finite()).map(f64::from).sum();
    let topic = &read["topics"]["/compare/fused/depth"];
    assert_eq!(topic["count"], 3);
    assert_eq!(topic["crc32"], crc32fast::hash(&fused));
    assert_eq!(topic["sum"], format!("{sum:.9}"));
    assert_eq!(topic["nan"], numbers.clone().filter(|metres| metres.is_nan()).count());
    assert_eq!(topic["infinite"], 3);
}

#[test]
fn python_sees_what_viewers_need() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let plan = plan();
    record(&path, &plan, 0..3, WIDTH, HEIGHT);
    let Some(read) = read_with_python("python_sees_what_viewers_need", &path, &["--messages"]) else { return };
    let topic = |name: &str| &read["topics"][name];
    let first = |name: &str| &read["topics"][name]["messages"][0];

    assert_eq!(topic("/compare/source/left/image")["schema"], "foxglove.CompressedImage");
    assert_eq!(first("/compare/source/left/image")["frame_id"], "compare/left");
    assert_eq!(topic("/compare/source/right/image")["schema"], "foxglove.RawImage");
    assert_eq!(first("/compare/source/right/image")["frame_id"], "compare/right");
    // A sibling topic of the image, of the same camera.
    let calibration = &topic("/compare/source/left/calibration")["messages"][1];
    assert_eq!(calibration["frame_id"], "compare/left");
    assert_eq!(calibration["P"][3], 0.0);
    let right = &topic("/compare/source/right/calibration")["messages"][1];
    assert_eq!(right["frame_id"], "compare/right");
    assert_eq!(right["P"][3], -(721.5377 + 1.0 / 3.0) * 0.532_725_451_7);
    let view = &topic("/compare/view/calibration")["messages"][1];
    assert_eq!((&view["frame_id"], &view["K"][0]), (&"compare/view".into(), &((721.5377 + 1.0 / 3.0) / 2.0).into()));
    let stands = &topic("/compare/source/right/transform")["messages"][1];
    assert_eq!(
        (&stands["parent_frame_id"], &stands["child_frame_id"]),
        (&"compare/left".into(), &"compare/right".into())
    );
    assert_eq!(stands["translation"]["x"], 0.532_725_451_7);
    assert_eq!(calibration["K"][0], 721.5377 + 1.0 / 3.0);
    assert_eq!(calibration["baseline_m"], 0.532_725_451_7);
    assert_eq!(first("/compare/stereo/disparity")["encoding"], "16UC1");
    assert_eq!(first("/compare/stereo/disparity")["min_disparity_px"], -3);
    // The smallest disparity of the fixture is -1 px, 3 px above the one that means that nothing was found.
    assert_eq!(first("/compare/stereo/disparity")["smallest"], 48);
    assert_eq!(first("/compare/fused/depth")["frame_id"], "compare/left");
    for map in ["fused.depth", "stereo.disparity", "edges.weight", "source.depth"] {
        let picture = first(&format!("/compare/view/{map}"));
        assert_eq!((&picture["format"], &picture["frame_id"]), (&"png".into(), &"compare/view".into()), "{map}");
    }
    assert_eq!(first("/compare/edges/mask")["encoding"], "mono8");

    let scores = topic("/compare/score_fused/scores");
    assert_eq!(scores["count"], 6, "two pixel sets and a zone of two frames");
    assert_eq!(scores["messages"][0]["frame"], "000000_10");
    assert_eq!(scores["messages"][0]["set"], "valid");
    assert_eq!(scores["messages"][0]["a2"], 0.1 + 0.2);
    assert!(scores["messages"][0].get("abs_rel").is_none(), "a NaN is absent");
    assert_eq!(scores["messages"][2]["zone"], "10..20");
    assert_eq!(scores["messages"][2]["truth"], u64::MAX.to_string(), "JSON writes 64-bit numbers as text");
    let commits = &topic("/compare/commit")["messages"];
    assert_eq!(commits[2]["failures"][0]["what"], "score: no truth");
    let curve = topic(CURVE);
    assert_eq!(curve["schema"], "depthloom.CurvePoint");
    assert_eq!(curve["messages"][0]["loss"], 0.1 + 0.2);
    assert!(curve["messages"][0].get("validation").is_none(), "not measured");
    assert_eq!(curve["messages"][1]["step"], "100", "JSON writes 64-bit numbers as text");
    assert_eq!(curve["messages"][1]["validation"], "Infinity");
    assert_eq!(curve["messages"][3]["learning_rate"], 5e-4);
    assert_eq!(curve["last_ns"], BEGINNING_NS + 250_000_000);
    assert_eq!(
        read["metadata"],
        serde_json::json!(["depthloom", "depthloom.once/compare/train/model", "depthloom.once/compare/train/curve"])
    );
    assert_eq!(read["attachments"]["note.txt"], 4);
}

#[test]
fn fault_31_python_takes_the_numbers_of_a_disparity_map_at_their_word() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let map = Disparity {
        sixteenths_px: Raster::from_raw(3, 2, vec![-16, 0, 1, 16, 1600, -16]).unwrap(),
        min_disparity_px: 0,
    };
    let recorder = Recorder::create(&path, &plan()).unwrap();
    let slot = Slot::Node { node: NodeId(0), port: PortId(0) };
    record_frame(&recorder, RunId(0), &frame(0), &[(slot, map.clone().into())], false);
    recorder.finish(&[]).unwrap();
    let recording = Recording::open(&path).unwrap();
    let read = recording.reader(RunId(0), &["/compare/stereo/disparity"]).unwrap().read(FrameIndex(0)).unwrap();
    assert!(matches!(&read[0], Some(Value::Disparity(read)) if **read == map));
    let test = "fault_31_python_takes_the_numbers_of_a_disparity_map_at_their_word";
    let Some(read) = read_with_python(test, &path, &["--messages"]) else { return };
    let message = &read["topics"]["/compare/stereo/disparity"]["messages"][0];
    assert_eq!(message["encoding"], "16UC1");
    assert_eq!((&message["smallest"], &message["largest"]), (&Json::from(0), &Json::from(1616)));
}

#[test]
fn fault_53_python_reads_an_unfinished_file_from_its_start_as_documented() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan()).unwrap();
    for index in 0..3 {
        record_frame(&recorder, RunId(0), &frame(index), &values(&frame(index), WIDTH, HEIGHT), false);
    }
    drop(recorder);
    let test = "fault_53_python_reads_an_unfinished_file_from_its_start_as_documented";
    let Some(read) = read_with_python(test, &path, &["--unfinished"]) else { return };
    // Ten topics with rasters, scores of two pixel sets and a commit; the truth and its scores are missing on a frame.
    assert!(read["from_start"].as_u64().is_some_and(|messages| messages > 25), "{read}");
    assert_eq!(read["by_default"], 0, "the documentation says that nothing is found");
}
