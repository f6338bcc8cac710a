//! True disparities: 16 bits where these hold a frame's exactly, floats where they do not, in one recording.

use std::collections::BTreeMap;

use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{FrameIndex, Plan, PlannedOutput, PortId, RunId};
use depthloom_graphs::values::{Raster, TrueDisparity};
use depthloom_graphs::{Port, Value, ValueType};
use depthloom_recording::{Recorder, Recording};
use depthloom_test_needs::{python, workspace};
use mcap::Summary;

use crate::digest::digest;
use crate::fixture::{frame, plan, record_frame, values};

const SIZE: (u32, u32) = (12, 5);
const TOPIC: &str = "/compare/source/disp_occ";
const SLOT: Slot = Slot::Source { port: PortId(4) };

/// The fixture's plan with true disparities besides, the last of the source's outputs.
fn with_truth() -> Plan {
    let mut plan = plan();
    plan.record.view = false;
    let port = Port::frame("disp_occ", ValueType::TrueDisparity, "True disparity.").optional();
    let output = PlannedOutput { port, topic: TOPIC.to_owned(), aliases: Vec::new(), recorded: true };
    plan.runs[0].source.outputs.push(output);
    plan
}

/// Of whole 256ths of a pixel in even frames.
fn truth(index: u64) -> Raster<f32> {
    let step = if index.is_multiple_of(2) { 0.25 } else { 0.3 };
    Raster::from_fn(SIZE.0, SIZE.1, |x, y| {
        image::Luma([if x == y { f32::NAN } else { step * (1 + x + 12 * y) as f32 }])
    })
}

#[test]
fn each_frame_has_the_form_that_holds_it_and_comes_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &with_truth()).unwrap();
    for index in 0..4 {
        let frame = frame(index);
        let mut values = values(&frame, SIZE.0, SIZE.1);
        let after = values.iter().position(|(slot, _)| *slot > SLOT).unwrap();
        values.insert(after, (SLOT, TrueDisparity { px: truth(index) }.into()));
        record_frame(&recorder, RunId(0), &frame, &values, index == 1);
    }
    recorder.finish(&[]).unwrap();
    let recording = Recording::open(&path).unwrap();
    let mut reader = recording.reader(RunId(0), &[TOPIC]).unwrap();
    for index in 0..4 {
        let Some(Value::TrueDisparity(read)) = &reader.read(FrameIndex(index as usize)).unwrap()[0] else {
            panic!("a truth")
        };
        let bits = |px: &Raster<f32>| px.iter().map(|px| px.to_bits()).collect::<Vec<u32>>();
        assert_eq!(bits(&read.px), bits(&truth(index)), "{index}");
    }
    // What has no such truths has its channels under the numbers it had; the floats' comes behind all.
    let channels = |bytes: &[u8]| {
        let summary = Summary::read(bytes).unwrap().expect("a summary");
        let units = summary.channels.values().map(|channel| {
            (channel.id, (channel.topic.clone(), channel.schema.as_ref().map(|schema| schema.name.clone())))
        });
        units.collect::<BTreeMap<_, _>>()
    };
    let channels = channels(&std::fs::read(&path).unwrap());
    let of_truth: Vec<_> = channels
        .iter()
        .filter(|(_, (topic, _))| topic == TOPIC)
        .map(|(id, (_, unit))| (*id, unit.as_deref()))
        .collect();
    assert_eq!(of_truth.len(), 2);
    assert_eq!((of_truth[0].1, of_truth[1].1), (Some("foxglove.RawImage"), Some("depthloom.FloatMap")));
    // Behind it are channels for other disparities alone.
    let mut behind = channels.range(of_truth[1].0..);
    assert!(behind.all(|(_, (_, schema))| schema.as_deref() == Some("depthloom.FloatMap")));

    let Some(python) = python("each_frame_has_the_form_that_holds_it_and_comes_back_bit_for_bit") else { return };
    let script = workspace().join("tests/python/read_recording.py");
    let output = std::process::Command::new(python).arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theirs: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(theirs["topics"][TOPIC], digest(&path)["topics"][TOPIC]);
}
