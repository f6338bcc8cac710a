//! `score/disparity` against the oracle (OpenCV, NumPy) and a transcription of KITTI's development kit.

use depthloom_graphs::plan::FrameIndex;
use std::collections::BTreeMap;
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_graphs::values::{Disparity, Mask, Raster, TrueDisparity};
use depthloom_scores::ScoreRow;
use depthloom_test_needs::{python, shared, workspace};
use serde_json::{Value as Json, json};

use crate::call::{call, open, value};

fn rows(params: &Json, inputs: &[(&str, &Value)]) -> Vec<ScoreRow> {
    let Value::Scores(rows) = value("score/disparity", params, inputs) else { panic!("scores are rows") };
    rows.to_vec()
}

/// The oracle's own SGBM and filling, so that both are compared with each other, too.
#[test]
fn sgbm_scores_as_the_oracles() {
    let Some(shared) = shared("sgbm_scores_as_the_oracles") else { return };
    let csv = std::fs::read_to_string(shared.join("oracle/golden/disparity/scores.csv")).unwrap();
    let names: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
    let root = shared.join("data/kitti_stereo_2015");
    let frames = [150, 151, 152, 153, 154, 155];
    let source = open("kitti/stereo2015", &json!({ "root": root, "frames": frames, "disparities": true })).unwrap();
    let mut compared = 0;
    let mut means: BTreeMap<&str, [f64; 7]> = BTreeMap::new();
    for (position, frame) in frames.iter().enumerate() {
        let (values, _) = source.read(FrameIndex(position)).unwrap();
        let estimate = value("stereo/sgbm", &json!({}), &[("left", &values["left"]), ("right", &values["right"])]);
        let sets = json!({ "sets": ["valid", "filled", "all"] });
        for row in rows(&sets, &[("estimate", &estimate), ("ground_truth", &values["disp_noc"])]) {
            // The oracle calls the set `valid` answered.
            let set = if row.set.name() == "valid" { "answered" } else { row.set.name() };
            let golden = csv.lines().find(|line| line.starts_with(&format!("{frame:06}_10,{set},"))).unwrap();
            let golden: Vec<f64> = golden.split(',').skip(2).map(|cell| cell.parse().unwrap()).collect();
            assert!((row.density().unwrap() - golden[0]).abs() <= 1e-12);
            assert_eq!(row.pixels as f64, golden[1], "{frame} {}", row.set);
            assert_eq!(row.scores.len(), names.len() - 4);
            let sums = means.entry(set).or_default();
            row.scores.iter().zip(sums).for_each(|((_, score), sum)| *sum += score);
            for (name, golden) in names[4..].iter().zip(&golden[2..]) {
                let ours = row.score(name).unwrap();
                assert!((ours - golden).abs() <= 1e-12 * golden, "{frame} {} {name}: {ours}, not {golden}", row.set);
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 6 * 3 * 7);
    for (set, of_metric) in means {
        let golden = csv.lines().find(|line| line.starts_with(&format!("mean,{set},"))).unwrap();
        let golden: Vec<f64> = golden.split(',').skip(4).map(|cell| cell.parse().unwrap()).collect();
        for (sum, golden) in of_metric.iter().zip(golden) {
            assert!((sum / 6.0 - golden).abs() <= 1e-12, "mean {set}");
        }
    }
}

/// Random maps with gaps of all lengths, at borders and over whole rows, with ties at the thresholds.
fn maps(seed: u64, (width, height): (u32, u32)) -> (Vec<i16>, Vec<u16>, Vec<u8>) {
    let mut state = seed;
    let mut below = move |n: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % n
    };
    let (mut estimate, mut truth, mut objects) = (Vec::new(), Vec::new(), Vec::new());
    for y in 0..height {
        let mut gap = if y % 7 == 3 { u64::from(width) } else { below(6) };
        for _ in 0..width {
            let t = if below(3) == 0 { 0 } else { 1 + below(200 * 256) };
            // A third of the answers are off by whole sixteenths of a pixel, so that errors meet the thresholds
            // exactly.
            let near = (t / 16 * 16) as i64 + 16 * (below(160) as i64 - 80);
            let answer = if below(3) == 0 { below(3200) as i64 } else { near / 16 };
            gap = gap.saturating_sub(1);
            let missing = gap > 0 || below(9) == 0;
            if gap == 0 && below(20) == 0 {
                gap = below(15);
            }
            estimate.push(if missing { -16 } else { answer.clamp(-16, 3200) as i16 });
            truth.push(if below(2) == 0 { (t / 16 * 16) as u16 } else { t as u16 });
            objects.push(if below(4) == 0 { 1 + below(9) as u8 } else { 0 });
        }
    }
    (estimate, truth, objects)
}

#[test]
fn scores_are_those_of_kittis_development_kit() {
    const TEST: &str = "scores_are_those_of_kittis_development_kit";
    let folder = tempfile::tempdir().unwrap();
    let size @ (width, height) = (61, 40);
    for seed in 1..=3 {
        let (estimate, truth, objects) = maps(seed, size);
        let file = |name: &str, bytes: Vec<u8>| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let files = [
            file("estimate", estimate.iter().flat_map(|fixed| fixed.to_le_bytes()).collect()),
            file("truth", truth.iter().flat_map(|fixed| fixed.to_le_bytes()).collect()),
            file("objects", objects.clone()),
        ];
        let Some(python) = python(TEST) else { return };
        let mut script = Command::new(python);
        script.arg(workspace().join("tests/python/kitti_devkit.py"));
        let output = script.args([width, height].map(|px| px.to_string())).args(files).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let expected: Json = serde_json::from_slice(&output.stdout).unwrap();

        let disparity =
            Disparity { sixteenths_px: Raster::from_raw(width, height, estimate).unwrap(), min_disparity_px: 0 };
        let objects = objects.iter().map(|&object| if object > 0 { 255 } else { 0 }).collect();
        let inputs = [
            ("estimate", &disparity.into()),
            ("ground_truth", &TrueDisparity::from_px_256(&Raster::from_raw(width, height, truth).unwrap()).into()),
            ("obj_map", &Mask { set: Raster::from_raw(width, height, objects).unwrap() }.into()),
        ];
        let rows = rows(&json!({ "sets": ["valid", "filled", "all"] }), &inputs);
        let close = |ours: Option<f64>, theirs: &Json, what: &str| {
            let (ours, theirs) = (ours.unwrap(), theirs.as_f64().unwrap());
            assert!((ours - theirs).abs() <= 1e-12 * (1.0 + theirs), "{seed} {what}: {ours}, not {theirs}");
        };
        for row in rows.iter().filter(|row| row.zone.is_empty()) {
            let of_set = &expected[row.set.name()];
            assert_eq!(row.pixels, of_set["pixels"], "{}", row.set);
            for (metric, score) in &row.scores {
                close(Some(*score), &of_set[metric.name], &format!("{} {}", row.set, metric.name));
            }
            close(row.density(), &expected["density"], "density");
        }
        for (zone, name) in [("background", "d1_bg"), ("foreground", "d1_fg")] {
            let row = rows.iter().find(|row| row.zone == zone && row.set.name() == "filled").unwrap();
            close(row.score("d1"), &expected[name], name);
        }
    }
}

#[test]
fn a_road_has_ground_truth_disparities_cars_and_two_pixel_sets() {
    let params = json!({ "frames": [3], "width": 320, "height": 96, "disparities": true });
    let (values, _) = open("synthetic/road", &params).unwrap().read(FrameIndex(0)).unwrap();
    let (Value::TrueDisparity(noc), Value::TrueDisparity(occ)) = (&values["disp_noc"], &values["disp_occ"]) else {
        panic!("disparities")
    };
    let Value::Mask(occluded) = &values["occluded"] else { panic!("a mask") };
    let (noc, occ) = (noc.px_256().unwrap(), occ.px_256().unwrap());
    for ((noc, occ), hidden) in noc.iter().zip(occ.iter()).zip(occluded.set.iter()) {
        assert_eq!(*noc, if *hidden > 0 { 0 } else { *occ });
    }
    // Where the ground truth itself is the estimate, the error is at most 1/16 px; what is occluded is wrong where only
    // `noc` answers.
    let sixteenths = noc.iter().map(|v| (v / 16) as i16).collect();
    let (width, height) = noc.dimensions();
    let sixteenths_px = Raster::from_raw(width, height, sixteenths).unwrap();
    let estimate = Disparity { sixteenths_px, min_disparity_px: 0 }.into();
    let inputs = [
        ("estimate", &estimate),
        ("ground_truth", &values["disp_occ"]),
        ("occluded", &values["occluded"]),
        ("obj_map", &values["obj_map"]),
        ("image", &values["left"]),
        ("calibration", &values["calibration"]),
    ];
    let zones = json!({ "distance_m": [0, 10, 20, 50, 80], "rows": 3 });
    let rows = rows(&json!({ "sets": ["all"], "zones": zones }), &inputs);
    let row_of = |zone: &str| rows.iter().find(|row| row.zone == zone).unwrap_or_else(|| panic!("no zone {zone}"));
    assert_eq!((row_of("visible").score("d1"), row_of("occluded").score("d1")), (Some(0.0), Some(1.0)));
    assert!(row_of("").score("epe").unwrap() < 1.0 / 16.0);
    assert_eq!(row_of("visible").density(), Some(1.0));
    let pixels = |zones: &[&str]| zones.iter().map(|zone| row_of(zone).pixels).sum::<u64>();
    assert_eq!(pixels(&["background", "foreground"]), row_of("").pixels);
    assert_eq!(pixels(&["row_1_of_3", "row_2_of_3", "row_3_of_3"]), row_of("").pixels);
    assert!(pixels(&["foreground"]) > 0 && pixels(&["0..10", "10..20", "20..50"]) > 0);
    assert!(row_of("edges").pixels > 0 && row_of("textureless").pixels > 0);
}

#[test]
fn bands_of_distance_want_a_calibration() {
    let params = json!({ "zones": { "distance_m": [0, 10, 80] } });
    let (estimate, truth) = (vec![16; 4], vec![256; 4]);
    let estimate = Disparity { sixteenths_px: Raster::from_raw(2, 2, estimate).unwrap(), min_disparity_px: 0 };
    let truth = TrueDisparity::from_px_256(&Raster::from_raw(2, 2, truth).unwrap());
    let fault =
        call("score/disparity", &params, &[("estimate", estimate.into()), ("ground_truth", truth.into())]).unwrap_err();
    assert!(fault.to_string().contains("needs a calibration"), "{fault}");
}
