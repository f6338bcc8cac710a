//! The alignments of `fusion/scale`: against NumPy (`tests/fixtures/alignment.py`), and with a network whose output was
//! distorted.

use std::collections::BTreeMap;

use depthloom_graphs::Value;
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::values::{Depth, Raster, RelativeInverseDepth, Weight};
use depthloom_test_needs::random::Random;
use depthloom_test_needs::{shared, skipped, workspace};
use serde_json::{Value as Json, json};

use crate::call::{Values, call, metres, model, open, value};

const SIZE: (u32, u32) = (64, 24);
const NAN: f32 = f32::NAN;

fn floats(name: &str) -> Raster<f32> {
    let file = workspace().join("tests/fixtures/golden/alignment").join(format!("{name}.f32"));
    let bytes = std::fs::read(file).unwrap();
    let values = bytes.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)).collect();
    Raster::from_raw(SIZE.0, SIZE.1, values).unwrap()
}

/// Farther than the tolerance from NumPy, relative to it, at the worst pixel; both are NaN at the same pixels.
fn worst(found: &[f32], expected: &[f32]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let off = |(found, expected): (&f32, &f32)| {
        assert_eq!(found.is_nan(), expected.is_nan());
        if found.is_nan() { 0.0 } else { (f64::from(*found) / f64::from(*expected) - 1.0).abs() }
    };
    found.iter().zip(expected).map(off).fold(0.0, f64::max)
}

#[test]
fn alignments_are_numpys() {
    let file = workspace().join("tests/fixtures/golden/alignment/cases.json");
    let cases: BTreeMap<String, Json> = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    assert_eq!(cases.len(), 8);
    let stereo: Value = Depth { metres: floats("stereo") }.into();
    let weight: Value = Weight { share: floats("weight") }.into();
    let relative: Value = RelativeInverseDepth { values: floats("mono") }.into();
    let depth: Value = Depth { metres: floats("depth") }.into();
    for (name, case) in cases {
        let mut params = case["params"].clone();
        let weighted = params.as_object_mut().unwrap().remove("weighted").unwrap().as_bool().unwrap();
        let mono = if params["mono"] == "depth" { &depth } else { &relative };
        let mut inputs = vec![("mono", mono), ("stereo", &stereo)];
        inputs.extend(weighted.then_some(("weight", &weight)));
        let found = value("fusion/scale", &params, &inputs);
        let worst = worst(metres(&found), floats(&name).as_raw());
        println!("{name}: off by at most {worst:.1e}");
        // NumPy solves `local` at every pixel, depthloom on a grid.
        let tolerance = if name.starts_with("local") { 0.01 } else { 1e-6 };
        assert!(worst < tolerance, "{name} is off by {worst}");
    }
}

fn relative(values: &[f32]) -> Value {
    RelativeInverseDepth { values: Raster::from_raw(values.len() as u32, 1, values.to_vec()).unwrap() }.into()
}

fn depth(values: &[f32]) -> Value {
    Depth { metres: Raster::from_raw(values.len() as u32, 1, values.to_vec()).unwrap() }.into()
}

const METHODS: [&str; 4] = ["least-squares", "robust", "median", "local"];

#[test]
fn frames_without_a_fit_have_the_documented_results() {
    for method in METHODS {
        let of_relative = |mono: &[f32], stereo: &[f32]| {
            let params = json!({ "method": method, "mono": "relative-inverse-depth" });
            metres(&value("fusion/scale", &params, &[("mono", &relative(mono)), ("stereo", &depth(stereo))])).to_vec()
        };
        let of_depth = |mono: &[f32], stereo: &[f32]| {
            let params = json!({ "method": method });
            metres(&value("fusion/scale", &params, &[("mono", &depth(mono)), ("stereo", &depth(stereo))])).to_vec()
        };
        // No pixel is valid in both.
        assert!(of_relative(&[1.0, NAN], &[NAN, 4.0]).iter().all(|metres| metres.is_nan()), "{method}");
        assert_eq!(of_depth(&[1.0, 100.0], &[NAN, NAN]), [1.0, 100.0], "{method}");
        // Alike: the ratio, or stereo's mean. 1/2 is the mean of the inverse depths.
        assert_eq!(of_relative(&[3.0, 3.0, 6.0], &[2.0, 2.0, NAN]), [2.0, 2.0, 1.0], "{method}");
        assert_eq!(of_relative(&[-3.0, -3.0, 6.0, NAN], &[2.0, 2.0, NAN, 1.0])[..3], [2.0; 3], "{method}");
        assert_eq!(of_depth(&[4.0, 4.0, 8.0], &[2.0, 2.0, NAN]), [2.0, 2.0, 4.0], "{method}");
    }
}

#[test]
fn aligned_inverse_depth_of_zero_and_below_is_at_the_cap() {
    // z = x / 10: the third and fourth pixels are at infinity and behind it.
    let (mono, stereo) = (relative(&[5.0, 1.0, 0.0, -1.0]), depth(&[2.0, 10.0, NAN, NAN]));
    for method in ["least-squares", "robust"] {
        let params = json!({ "method": method, "mono": "relative-inverse-depth", "cap": 60 });
        let found = value("fusion/scale", &params, &[("mono", &mono), ("stereo", &stereo)]);
        assert!(worst(metres(&found), &[2.0, 10.0, 60.0, 60.0]) < 1e-6, "{method}: {:?}", metres(&found));
    }
}

#[test]
fn depth_with_inverse_depth_that_metres_cannot_represent_is_aligned_with_it() {
    // As `mono/onnx` gives it with `output: inverse-depth`: at -1 and 0 the metres are the cap's.
    let inverse = [5.0, 1.0, 0.0, -1.0];
    let capped = Depth { metres: Raster::from_raw(4, 1, vec![0.2, 1.0, 80.0, 80.0]).unwrap() };
    let mono = Value::depth_from_inverse(capped, &inverse);
    // 1 / Z = (x + 2) / 20
    let stereo = depth(&[20.0 / 7.0, 20.0 / 3.0, 10.0, NAN]);
    let found = value("fusion/scale", &json!({ "method": "least-squares" }), &[("mono", &mono), ("stereo", &stereo)]);
    assert!(worst(metres(&found), &[20.0 / 7.0, 20.0 / 3.0, 10.0, 20.0]) < 1e-6, "{:?}", metres(&found));
}

#[test]
fn relative_inverse_depth_needs_a_method_that_aligns_it() {
    let fault = |params: Json, mono: Value| {
        call("fusion/scale", &params, &[("mono", mono), ("stereo", depth(&[1.0, 2.0]))]).unwrap_err().chain()
    };
    let mono = || relative(&[1.0, 2.0]);
    for method in ["minmax", "average", "none"] {
        let what = fault(json!({ "method": method, "mono": "relative-inverse-depth" }), mono());
        assert!(what.contains(&format!("method is {method}, which needs depth in metres")), "{what}");
    }
    let what = fault(json!({ "method": "local", "mono": "relative-inverse-depth", "domain": "depth" }), mono());
    assert!(what.contains("domain is depth"), "{what}");
    let registry = depthloom_nodes::registry();
    let scale = registry.node_kind("fusion/scale").unwrap();
    let mono_type = |params: Json| {
        let signature = scale.signature(&scale.resolve(&params).unwrap()).unwrap();
        signature.inputs[0].value_type.name()
    };
    assert_eq!(mono_type(json!({})), "depth");
    assert_eq!(mono_type(json!({ "method": "robust", "mono": "relative-inverse-depth" })), "relative-inverse-depth");
}

struct Frame {
    inverse: RelativeInverseDepth,
    stereo: Value,
    weight: Value,
    truth: Value,
}

/// Frames 150 to 155 with the network's own numbers, a share of the width.
fn frames(shared: &std::path::Path) -> Vec<Frame> {
    let root = shared.join("data/kitti_stereo_2015");
    let numbers: Vec<u32> = (150..=155).collect();
    let source = open("kitti/stereo2015", &json!({ "root": root, "frames": numbers })).unwrap();
    let network = model(std::fs::read(shared.join("models/ssl_unet.onnx")).unwrap());
    let frame = |index| {
        let mut values: Values = source.read(FrameIndex(index)).unwrap().0;
        let mut take = |port| values.remove(port).unwrap();
        let (left, right, calibration, truth) = (take("left"), take("right"), take("calibration"), take("depth"));
        let disparity = value("stereo/sgbm", &json!({}), &[("left", &left), ("right", &right)]);
        let stereo =
            value("depth/from-disparity", &json!({}), &[("disparity", &disparity), ("calibration", &calibration)]);
        let weight = value("confidence/sobel", &json!({}), &[("image", &left)]);
        let inputs = [("image", &left), ("model", &network)];
        let params = json!({ "output": "relative-inverse-depth" });
        let Value::RelativeInverseDepth(inverse) = value("mono/onnx", &params, &inputs) else { panic!("inverse") };
        Frame { inverse: (*inverse).clone(), stereo, weight, truth }
    };
    (0..6).map(frame).collect()
}

fn abs_rel(estimate: &Value, truth: &Value) -> f64 {
    let inputs = [("estimate", estimate), ("ground_truth", truth)];
    let Value::Scores(rows) = value("score/depth", &json!({ "sets": ["all"] }), &inputs) else { panic!("rows") };
    rows[0].score("abs_rel").unwrap()
}

/// A network whose output was distorted by a random scale and shift per frame is as good after alignment and fusion as
/// the network itself: within 3 % of its abs_rel (here far less, for the fit follows any scale and shift).
#[test]
fn a_distorted_network_is_aligned_to_what_it_was() {
    const TEST: &str = "a_distorted_network_is_aligned_to_what_it_was";
    let Some(shared) = shared(TEST) else { return };
    if let Err(fault) = depthloom_nodes::onnx::find() {
        return skipped(TEST, &fault.chain());
    }
    let frames = frames(&shared);
    let mut random = Random::new(25, TEST);
    let distortions: Vec<(f64, f64)> = frames
        .iter()
        .map(|_| {
            let mut unit = || random.below(1 << 20) as f64 / f64::from(1 << 20);
            (0.05 * 400.0_f64.powf(unit()), 4.0 * unit() - 2.0)
        })
        .collect();
    for method in ["least-squares", "robust", "local"] {
        let means = |distorted: bool| {
            let mut sums = [0.0; 2];
            for (frame, (scale, shift)) in frames.iter().zip(&distortions) {
                let mut inverse = frame.inverse.clone();
                if distorted {
                    inverse.values.iter_mut().for_each(|x| *x = (scale * f64::from(*x) + scale * shift) as f32);
                }
                let params = json!({ "method": method, "mono": "relative-inverse-depth" });
                let inputs = [("mono", &Value::from(inverse)), ("stereo", &frame.stereo), ("weight", &frame.weight)];
                let mono = value("fusion/scale", &params, &inputs);
                let inputs = [("mono", &mono), ("stereo", &frame.stereo), ("weight", &frame.weight)];
                let fused = value("fusion/confidence", &json!({}), &inputs);
                let fused = value("filter/median", &json!({}), &[("depth", &fused)]);
                sums[0] += abs_rel(&mono, &frame.truth) / frames.len() as f64;
                sums[1] += abs_rel(&fused, &frame.truth) / frames.len() as f64;
            }
            sums
        };
        let (own, of_distorted) = (means(false), means(true));
        println!("{method}: abs_rel of mono and fused {own:.4?}, distorted {of_distorted:.4?}");
        for (own, of_distorted) in own.into_iter().zip(of_distorted) {
            assert!((of_distorted / own - 1.0).abs() < 0.03, "{method}: {of_distorted}, undistorted {own}");
        }
    }
}
