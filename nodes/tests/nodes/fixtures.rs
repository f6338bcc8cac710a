//! Node by node on rendered frames, against OpenCV and NumPy: the checks that work in a bare clone
//! (`tests/fixtures/make.py`).

use depthloom_graphs::plan::FrameIndex;
use std::collections::BTreeMap;
use std::path::PathBuf;

use depthloom_graphs::Value;
use depthloom_test_needs::workspace;
use serde_json::{Map, Value as Json, json};

use crate::call::{Values, call, metres, open, png_u16, value};

const FRAME: &str = "000000_10";

fn golden(file: &str) -> PathBuf {
    workspace().join("tests/fixtures/golden").join(file)
}

/// The values of a frame: 0 is [`FRAME`].
fn frame(index: usize) -> Values {
    let root = workspace().join("tests/fixtures/road");
    open("kitti/stereo2015", &json!({ "root": root })).unwrap().read(FrameIndex(index)).unwrap().0
}

/// Our parameters for OpenCV's, whose names `StereoBM` and `StereoSGBM` write with other initials.
fn params(case: &Map<String, Json>) -> Json {
    let of_a_matcher = case.iter().filter(|(name, _)| *name != "matcher");
    let ours = of_a_matcher.map(|(name, value)| match name.to_lowercase().as_str() {
        "mode" => ("mode", value.clone()),
        "mindisparity" => ("min_disparity", value.clone()),
        "numdisparities" => ("disparities", value.clone()),
        "blocksize" => ("block", value.clone()),
        "p1" => ("p1", value.clone()),
        "p2" => ("p2", value.clone()),
        "disp12maxdiff" => ("disp12_max_diff", value.clone()),
        "prefiltertype" => ("prefilter", json!(["normalized-response", "xsobel"][value.as_u64().unwrap() as usize])),
        "prefiltersize" => ("prefilter_size", value.clone()),
        "prefiltercap" => ("prefilter_cap", value.clone()),
        "texturethreshold" => ("texture_threshold", value.clone()),
        "uniquenessratio" => ("uniqueness", value.clone()),
        "extend_left" => ("extend_left", value.clone()),
        "specklewindowsize" => ("speckle_window", value.clone()),
        "specklerange" => ("speckle_range", value.clone()),
        other => panic!("{other} is not a parameter of a matcher"),
    });
    Json::Object(ours.map(|(name, value)| (name.to_owned(), value)).collect())
}

#[test]
fn disparities_are_opencvs_in_every_pixel_and_mode() {
    let cases: BTreeMap<String, Map<String, Json>> =
        serde_json::from_slice(&std::fs::read(golden("cases.json")).unwrap()).unwrap();
    let modes = ["sgbm", "hh", "3way", "hh4", "bm", "bm_normalized", "sgbm_checked", "hh_checked"];
    let extended = ["sgbm_extended", "hh_extended", "3way_extended", "hh4_extended", "sgbm_checked_extended"];
    assert!(modes.iter().chain(&extended).all(|mode| cases.contains_key(*mode)), "{:?}", cases.keys());
    let mut files: Vec<(&str, usize)> = cases.keys().map(|case| (case.as_str(), 0)).collect();
    files.push(("sgbm", 1));
    for (name, index) in files {
        let (case, frame) = (&cases[name], frame(index));
        let kind = format!("stereo/{}", case["matcher"].as_str().unwrap());
        let found = value(&kind, &params(case), &[("left", &frame["left"]), ("right", &frame["right"])]);
        let Value::Disparity(found) = found else { panic!("{kind} gives disparities") };
        let expected = png_u16(&golden(&format!("disparity/{name}.00000{index}_10.png")));
        assert_eq!(found.sixteenths_px.dimensions(), expected.dimensions(), "{name}");
        // The files hold them above -32768.
        let pairs = found.sixteenths_px.iter().zip(expected.as_raw());
        let other = pairs.filter(|&(ours, theirs)| i32::from(*ours) != i32::from(*theirs) - 32768).count();
        assert_eq!(other, 0, "{name}, frame {index}: pixels that are not OpenCV's");
        let valid = found.sixteenths_px.iter().filter(|&&pixel| i32::from(pixel) != found.invalid()).count();
        assert!(valid * 5 > expected.len(), "{name}, frame {index}: only {valid} pixels to compare");
    }
}

/// `stereo/sgbm` without the left-right check: what NumPy's maps are of.
fn all_outputs(mode: &str, extend_left: bool) -> Values {
    let params = json!({
        "mode": mode, "disp12_max_diff": 1_000_000, "extend_left": extend_left, "right": true, "ambiguity": true
    });
    let frame = frame(0);
    call("stereo/sgbm", &params, &["left", "right"].map(|side| (side, frame[side].clone()))).unwrap()
}

#[test]
fn right_view_and_ambiguity_are_those_of_costs_summed_by_numpy() {
    let cases = [("sgbm", false), ("hh", false), ("3way", false), ("hh4", false), ("sgbm", true)];
    for (mode, extend_left) in cases {
        let name = format!("{mode}{}", if extend_left { "_extended" } else { "" });
        let outputs = all_outputs(mode, extend_left);
        let Value::Disparity(right) = &outputs["right"] else { panic!("a disparity") };
        assert_eq!((right.min_disparity_px, right.invalid()), (-63, -1024));
        let expected = png_u16(&golden(&format!("semi_global/{name}.right.png")));
        let pairs = right.sixteenths_px.iter().zip(expected.as_raw());
        let other = pairs.filter(|&(ours, theirs)| i32::from(*ours) != i32::from(*theirs) - 32768).count();
        assert_eq!(other, 0, "{name}: pixels of the right view that are not NumPy's");

        let file = golden(&format!("semi_global/{name}.ambiguity.png"));
        if !file.exists() {
            continue;
        }
        let Value::Weight(ambiguity) = &outputs["ambiguity"] else { panic!("a weight") };
        let off = |(ours, theirs): (&f32, &u16)| (ours * 65535.0 - f32::from(*theirs)).abs();
        let worst = ambiguity.share.iter().zip(png_u16(&file).as_raw()).map(off).fold(0.0, nan_or_larger);
        assert!(worst < 0.51, "{name}: the ambiguity is off by {worst} / 65535");
    }
}

#[test]
fn the_right_view_confirms_most_of_the_left_one() {
    let outputs = all_outputs("sgbm", true);
    let inputs = [("left", &outputs["disparity"]), ("right", &outputs["right"])];
    let Value::Disparity(checked) = value("disparity/left-right", &json!({}), &inputs) else { panic!("a disparity") };
    let valid = checked.sixteenths_px.iter().filter(|&&pixel| i32::from(pixel) != checked.invalid()).count();
    let share = valid as f64 / checked.sixteenths_px.len() as f64;
    println!("{:.1} % are confirmed", 100.0 * share);
    assert!(share > 0.7, "{share}");
}

#[test]
fn edges_and_weights_are_numpys() {
    let frame = frame(0);
    let Value::Mask(edges) = value("confidence/edges", &json!({}), &[("image", &frame["left"])]) else {
        panic!("edges are a mask")
    };
    let expected = image::open(golden(&format!("edges.{FRAME}.png"))).unwrap().into_luma8();
    let other = edges.set.iter().zip(expected.as_raw()).filter(|(ours, theirs)| (**ours != 0) != (**theirs != 0));
    assert_eq!(other.count(), 0, "edges that are not NumPy's");

    let Value::Weight(weight) = value("confidence/sobel", &json!({}), &[("image", &frame["left"])]) else {
        panic!("a weight")
    };
    let expected = png_u16(&golden(&format!("weight.{FRAME}.png")));
    assert_eq!(weight.share.dimensions(), expected.dimensions());
    let off = |(ours, theirs): (&f32, &u16)| (ours * 65535.0 - f32::from(*theirs)).abs();
    let worst = weight.share.iter().zip(expected.as_raw()).map(off).fold(0.0, nan_or_larger);
    println!("weights are off by at most {worst:.3} / 65535");
    assert!(worst <= 1.0, "weights are off by {worst} / 65535");
}

/// The larger of two, and NaN where one is: `f32::max` would let it pass.
fn nan_or_larger(a: f32, b: f32) -> f32 {
    if a.is_nan() || a > b { a } else { b }
}

/// How far a map is from NumPy's at most, in 1/256 m.
fn worst(ours: &Value, file: &str) -> f32 {
    let expected = png_u16(&golden(&format!("{file}.{FRAME}.png")));
    assert_eq!(metres(ours).len(), expected.as_raw().len());
    let off = |(ours, theirs): (&f32, &u16)| (ours * 256.0 - f32::from(*theirs)).abs();
    metres(ours).iter().zip(expected.as_raw()).map(off).fold(0.0, nan_or_larger)
}

#[test]
fn scaled_and_fused_maps_are_numpys_to_a_256th_of_a_metre() {
    let frame = frame(0);
    let (left, calibration) = (&frame["left"], &frame["calibration"]);
    let disparity = value("stereo/sgbm", &json!({}), &[("left", left), ("right", &frame["right"])]);
    let stereo = value("depth/from-disparity", &json!({}), &[("disparity", &disparity), ("calibration", calibration)]);
    let weight = value("confidence/sobel", &json!({}), &[("image", left)]);
    let mono = value("mono/ground-plane", &json!({}), &[("image", left), ("calibration", calibration)]);
    for (variant, method, weighting) in crate::golden::VARIANTS {
        let scaled = value("fusion/scale", &json!({ "method": method }), &[("mono", &mono), ("stereo", &stereo)]);
        let inputs = [("mono", &scaled), ("stereo", &stereo), ("weight", &weight)];
        let merged = value("fusion/confidence", &json!({ "weighting": weighting }), &inputs);
        let fused = value("filter/median", &json!({}), &[("depth", &merged)]);
        for (map, name) in [(&scaled, "mono"), (&fused, "fused")] {
            let worst = worst(map, &format!("{variant}.{name}"));
            println!("{variant}/{name}: off by at most {worst:.3} / 256 m");
            assert!(worst <= 1.0, "{variant}/{name} is off by {worst} / 256 m");
        }
    }
}
