//! The whole pipeline, node by node, on two real frames against the oracle (OpenCV, NumPy, ONNX Runtime).

use depthloom_graphs::plan::FrameIndex;
use std::path::Path;

use depthloom_graphs::Value;
use depthloom_scores::ScoreRow;
use depthloom_test_needs::{shared, skipped};
use serde_json::json;

use crate::call::{call, metres, model, open, png_u16, value};

/// The variants of Table I as the oracle ran them: name, scaling, weighting.
pub(crate) const VARIANTS: [(&str, &str, &str); 5] = [
    ("full", "minmax", "full"),
    ("no_weighting", "minmax", "confidence"),
    ("mean", "minmax", "mean"),
    ("no_scaling", "none", "full"),
    ("average_scaling", "average", "full"),
];

struct Frame {
    id: &'static str,
    left: Value,
    calibration: Value,
    truth: Value,
    disparity: Value,
    stereo: Value,
    weight: Value,
}

fn frames(shared: &Path) -> Vec<Frame> {
    let root = shared.join("data/kitti_stereo_2015");
    let source = open("kitti/stereo2015", &json!({ "root": root, "frames": [150, 155] })).unwrap();
    let frame = |(position, id)| {
        let (mut values, _) = source.read(position).unwrap();
        let mut take = |port| values.remove(port).unwrap();
        let (left, right, calibration, truth) = (take("left"), take("right"), take("calibration"), take("depth"));
        let disparity = value("stereo/sgbm", &json!({}), &[("left", &left), ("right", &right)]);
        let stereo =
            value("depth/from-disparity", &json!({}), &[("disparity", &disparity), ("calibration", &calibration)]);
        let weight = value("confidence/sobel", &json!({}), &[("image", &left)]);
        Frame { id, left, calibration, truth, disparity, stereo, weight }
    };
    FrameIndex::enumerate(["000150_10", "000155_10"]).map(frame).collect()
}

/// The share of pixels farther than 1/256 m from the oracle's map.
fn share_off(ours: &Value, golden: &Path) -> f64 {
    let golden = png_u16(golden);
    let ours = metres(ours);
    assert_eq!(ours.len(), golden.as_raw().len());
    let off = |(ours, golden): (&f32, &u16)| ours.is_nan() || (ours * 256.0 - f32::from(*golden)).abs() > 1.0;
    ours.iter().zip(golden.as_raw()).filter(|&pair| off(pair)).count() as f64 / ours.len() as f64
}

/// The oracle's row for a frame, an estimate and a pixel set: pixels, then the eight scores. The oracle calls the set
/// `valid` answered.
fn golden_row(folder: &Path, [frame, label, set]: [&str; 3]) -> (u64, [f64; 8]) {
    let wanted = [frame, label, if set == "valid" { "answered" } else { set }];
    let csv = std::fs::read_to_string(folder.join("scores.csv")).unwrap();
    let line =
        csv.lines().find(|line| line.split(',').take(3).eq(wanted)).unwrap_or_else(|| panic!("no row {wanted:?}"));
    let numbers: Vec<&str> = line.split(',').skip(3).collect();
    let scores: Vec<f64> = numbers[1..].iter().map(|number| number.parse().unwrap()).collect();
    (numbers[0].parse().unwrap(), scores.try_into().unwrap())
}

pub(crate) fn rows(estimate: &Value, truth: &Value, sets: &[&str]) -> Vec<ScoreRow> {
    let Value::Scores(rows) = value(
        "score/depth",
        &json!({ "preset": "martins2018", "sets": sets }),
        &[("estimate", estimate), ("ground_truth", truth)],
    ) else {
        panic!("scores are rows")
    };
    rows.to_vec()
}

fn assert_scores(row: &ScoreRow, golden: (u64, [f64; 8]), tolerance: f64, what: &str) {
    assert_eq!(row.pixels, golden.0, "{what}: pixels");
    let mut worst = 0.0_f64;
    assert_eq!(row.scores.len(), golden.1.len(), "{what}");
    for ((metric, ours), golden) in row.scores.iter().zip(golden.1) {
        let name = metric.name;
        assert!((ours - golden).abs() <= tolerance * golden.abs(), "{what}: {name} is {ours}, the oracle has {golden}");
        worst = worst.max((ours / golden - 1.0).abs());
    }
    println!("{what}: {} pixels, scores off by at most {worst:.1e}", row.pixels);
}

/// Scaling, fusion, median and scores of one frame under every variant.
fn fuse_and_compare(frame: &Frame, mono: &Value, folder: &Path, tolerance: f64) {
    let all = ["all"];
    for (variant, method, weighting) in VARIANTS {
        let scaled = value("fusion/scale", &json!({ "method": method }), &[("mono", mono), ("stereo", &frame.stereo)]);
        let merged = value(
            "fusion/confidence",
            &json!({ "weighting": weighting }),
            &[("mono", &scaled), ("stereo", &frame.stereo), ("weight", &frame.weight)],
        );
        let fused = value("filter/median", &json!({}), &[("depth", &merged)]);
        let off = share_off(&fused, &folder.join(format!("{}.fused.{variant}.png", frame.id)));
        println!("{} {variant}: {off:.1e} of the fused pixels off by more than 1/256 m", frame.id);
        assert!(off <= 1e-3, "{} {variant}: {off} of the pixels are off", frame.id);
        for (estimate, name) in [(&scaled, "mono"), (&fused, "fused")] {
            let label = format!("{variant}/{name}");
            let golden = golden_row(folder, [frame.id, &label, "all"]);
            assert_scores(&rows(estimate, &frame.truth, &all)[0], golden, tolerance, &label);
        }
    }
}

#[test]
fn disparity_and_confidence_are_the_oracles() {
    let Some(shared) = shared("disparity_and_confidence_are_the_oracles") else { return };
    let folder = shared.join("oracle/golden/ground_plane");
    for frame in frames(&shared) {
        let Value::Disparity(disparity) = &frame.disparity else { panic!("disparity") };
        let ours: Vec<u16> = disparity.sixteenths_px.iter().map(|&fixed| fixed.max(0) as u16).collect();
        let golden = png_u16(&folder.join(format!("{}.disparity.png", frame.id)));
        assert!(&ours == golden.as_raw(), "{}: a disparity differs", frame.id);

        let Value::Weight(weight) = &frame.weight else { panic!("weight") };
        let golden = png_u16(&folder.join(format!("{}.confidence.png", frame.id)));
        let off = |(ours, golden): (&f32, &u16)| (ours * 65535.0 - f32::from(*golden)).abs();
        let worst = weight.share.iter().zip(golden.as_raw()).map(off).fold(0.0, f32::max);
        println!("{}: confidence off by at most {worst:.2} / 65535", frame.id);
        assert!(worst <= 4.0, "{}: confidence is off by {worst} / 65535", frame.id);
    }
}

#[test]
fn stereo_scores_on_both_pixel_sets_are_the_oracles() {
    let Some(shared) = shared("stereo_scores_on_both_pixel_sets_are_the_oracles") else { return };
    let folder = shared.join("oracle/golden/ground_plane");
    for frame in frames(&shared) {
        let sets = ["valid", "all"];
        for (row, set) in rows(&frame.stereo, &frame.truth, &sets).iter().zip(sets) {
            assert_scores(row, golden_row(&folder, [frame.id, "stereo", set]), 1e-4, set);
        }
    }
}

#[test]
fn the_ground_plane_pipeline_is_the_oracles() {
    let Some(shared) = shared("the_ground_plane_pipeline_is_the_oracles") else { return };
    let folder = shared.join("oracle/golden/ground_plane");
    for frame in frames(&shared) {
        let mono =
            value("mono/ground-plane", &json!({}), &[("image", &frame.left), ("calibration", &frame.calibration)]);
        assert_eq!(share_off(&mono, &folder.join(format!("{}.mono.png", frame.id))), 0.0);
        fuse_and_compare(&frame, &mono, &folder, 1e-4);
    }
}

#[test]
fn the_network_pipeline_is_the_oracles() {
    let Some(shared) = shared("the_network_pipeline_is_the_oracles") else { return };
    if let Err(fault) = depthloom_nodes::onnx::find() {
        return skipped("the_network_pipeline_is_the_oracles", &fault.chain());
    }
    let folder = shared.join("oracle/golden/ssl_unet");
    let model = model(std::fs::read(shared.join("models/ssl_unet.onnx")).unwrap());
    for frame in frames(&shared) {
        let inputs =
            [("image", frame.left.clone()), ("calibration", frame.calibration.clone()), ("model", model.clone())];
        let mono = call("mono/onnx", &json!({}), &inputs).unwrap().remove("depth").unwrap();
        let off = share_off(&mono, &folder.join(format!("{}.mono.png", frame.id)));
        assert!(off <= 1e-3, "{}: {off} of the network's pixels are off", frame.id);
        fuse_and_compare(&frame, &mono, &folder, 1e-3);
    }
}
