//! Baselines of fusion against NumPy (`tests/fixtures/fusion.py`), which sums over all pixels.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Image, Pixels};
use image::GrayImage;
use serde_json::Value as Json;

use crate::call::{call, metres};
use crate::steps::{calibration, depth, weight};

#[test]
fn baselines_are_those_of_numpy() {
    let path = depthloom_test_needs::workspace().join("tests/fixtures/golden/fusion.json");
    let golden: Json = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let width = golden["width"].as_u64().unwrap() as u32;
    let map = |of: &Json| -> Vec<f32> {
        of.as_array().unwrap().iter().map(|v| v.as_f64().map_or(f32::NAN, |v| v as f32)).collect()
    };
    let grey: Vec<u8> = map(&golden["grey"]).into_iter().map(|grey| grey as u8).collect();
    let grey = GrayImage::from_raw(width, grey.len() as u32 / width, grey).unwrap();
    let mono_and_stereo =
        [("mono", depth(width, &map(&golden["mono"]))), ("stereo", depth(width, &map(&golden["stereo"])))];
    let calls = golden["calls"].as_array().unwrap();
    assert_eq!(calls.len(), 6);
    for one in calls {
        let kind = one["kind"].as_str().unwrap();
        let dense = if one["dense"].is_null() { "stereo" } else { "dense" };
        let mut inputs: Vec<(&str, Value)> = mono_and_stereo.to_vec();
        match kind {
            "fusion/facil" => inputs.push(("weight", weight(width, &map(&golden["confidence"])))),
            "fusion/inverse-variance" => inputs.push(("calibration", calibration(72.0, 0.5))),
            _ => {
                let image = Image::new(Pixels::Grey(grey.clone())).into();
                inputs = vec![("image", image), ("depth", depth(width, &map(&golden[dense])))];
            }
        }
        let outputs = call(kind, &one["params"], &inputs).unwrap();
        for (port, value) in outputs {
            for (at, (ours, expected)) in metres(&value).iter().zip(map(&one[port])).enumerate() {
                let is_close = (ours - expected).abs() <= 2e-5 * expected || ours.is_nan() && expected.is_nan();
                assert!(is_close, "{kind} {} {port} at {at}: {ours}, not {expected}", one["params"]);
            }
        }
    }
}
