//! Disparities finer than 1/16 px, and inverse depth that metres do not hold.

use depthloom_graphs::Value;
use depthloom_graphs::contracts::{Contract, Slot};
use depthloom_graphs::plan::{FrameIndex, NodeId, PortId, RunId};
use depthloom_graphs::values::Depth;
use depthloom_recording::{Recorder, Recording};
use depthloom_test_needs::{python, workspace};

use crate::digest::digest;
use crate::fixture::{Noise, frame, plan, raster, record_frame, values};

const WIDTH: u32 = 12;
const HEIGHT: u32 = 5;

/// The fixture's values, those of odd frames finer.
fn finer(index: u64) -> Vec<(Slot, Value)> {
    let mut values = values(&frame(index), WIDTH, HEIGHT);
    if index % 2 == 1 {
        let mut noise = Noise(index);
        for (_, value) in &mut values {
            match value {
                Value::Disparity(_) => {
                    *value = Value::disparity_from_px(raster(WIDTH, HEIGHT, || noise.share() * 90.0 - 9.0));
                }
                Value::Depth(depth) => {
                    let inverse: Vec<f32> = depth.metres.iter().map(|_| noise.share() - 0.5).collect();
                    let metres = inverse.iter().map(|x| if *x > 0.02 { 1.0 / x } else { 50.0 }).collect();
                    let metres = image::ImageBuffer::from_raw(WIDTH, HEIGHT, metres).expect("as many as pixels");
                    *value = Value::depth_from_inverse(Depth { metres }, &inverse);
                }
                _ => {}
            }
        }
    }
    values
}

#[test]
fn they_come_back_bit_for_bit_and_other_readers_see_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan();
    plan.record.view = false;
    let recorder = Recorder::create(&path, &plan).unwrap();
    for index in 0..4 {
        record_frame(&recorder, RunId(0), &frame(index), &finer(index), false);
    }
    recorder.finish(&[]).unwrap();
    let recording = Recording::open(&path).unwrap();
    let of_frames = || plan.runs[0].nodes.iter().enumerate().filter(|(_, node)| node.contract != Contract::Once);
    let topics: Vec<String> =
        of_frames().flat_map(|(_, node)| &node.outputs).map(|output| output.topic.clone()).collect();
    let mut reader = recording.reader(RunId(0), &topics).unwrap();
    let (mut floats, mut relative) = (0, 0);
    for index in 0..4 {
        let recorded = finer(index);
        let slots = of_frames().flat_map(|(node, of)| {
            (0..of.outputs.len()).map(move |port| Slot::Node { node: NodeId(node), port: PortId(port) })
        });
        for (slot, read) in slots.zip(reader.read(FrameIndex(index as usize)).unwrap()) {
            let Some((_, value)) = recorded.iter().find(|(of, _)| *of == slot) else { continue };
            match (value, read) {
                (Value::FloatDisparity(a), Some(Value::FloatDisparity(b))) => {
                    assert_eq!(*a, b);
                    floats += 1;
                }
                (Value::RelativeDepth(a), Some(Value::RelativeDepth(b))) => {
                    assert_eq!(*a, b);
                    relative += 1;
                }
                (Value::FloatDisparity(_) | Value::RelativeDepth(_), other) => panic!("{other:?}"),
                _ => {}
            }
        }
    }
    assert_eq!((floats, relative), (2, 4));

    let Some(python) = python("they_come_back_bit_for_bit_and_other_readers_see_them") else { return };
    let script = workspace().join("tests/python/read_recording.py");
    let output = std::process::Command::new(python).arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theirs: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(theirs["topics"], digest(&path)["topics"]);
}
