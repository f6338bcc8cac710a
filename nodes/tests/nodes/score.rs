//! `score/depth`: presets, and single settings over them.

use depthloom_graphs::Value;
use depthloom_scores::{PixelSet, ScoreRow};
use serde_json::{Value as Json, json};

use crate::call::value;
use crate::steps::{depth, weight};

fn rows(params: &Json, estimate: &[f32], truth: &[f32]) -> Vec<ScoreRow> {
    let (estimate, truth) = (depth(2, estimate), depth(2, truth));
    let Value::Scores(rows) = value("score/depth", params, &[("estimate", &estimate), ("ground_truth", &truth)]) else {
        panic!("scores")
    };
    rows.to_vec()
}

const ESTIMATE: [f32; 4] = [10.0, f32::NAN, 20.0, 100.0];
const TRUTH: [f32; 4] = [10.0, 10.0, 40.0, 100.0];

#[test]
fn data_sets_are_in_the_requested_order() {
    let rows = rows(&json!({ "sets": ["valid", "all"] }), &ESTIMATE, &TRUTH);
    assert_eq!(
        rows.iter().map(|row| (row.set, row.pixels)).collect::<Vec<_>>(),
        [(PixelSet::Valid, 2), (PixelSet::All, 3)]
    );
    assert_eq!(rows[0].score("abs_rel"), Some(0.25));
    assert_eq!((rows[0].density(), rows[1].density()), (Some(2.0 / 3.0), Some(2.0 / 3.0)));
}

#[test]
fn single_settings_override_the_preset() {
    let far = rows(&json!({ "sets": ["valid"], "max_m": 120.0 }), &ESTIMATE, &TRUTH);
    assert_eq!(far[0].pixels, 3);
    let kitti = rows(&json!({ "preset": "kitti-depth", "sets": ["valid"] }), &ESTIMATE, &TRUTH);
    assert_eq!(kitti[0].pixels, 3);
    assert_eq!(kitti[0].score("sq_rel"), Some(0.25 / 3.0));
    let by_truth = json!({ "preset": "kitti-depth", "sets": ["valid"], "sq_rel": "by-truth" });
    assert_eq!(rows(&by_truth, &ESTIMATE, &TRUTH)[0].score("sq_rel"), Some(10.0 / 3.0));
    let missing = json!({ "missing_m": 10.0 });
    assert_eq!(rows(&missing, &ESTIMATE, &TRUTH)[0].score("a1"), Some(2.0 / 3.0));
}

#[test]
fn median_scaling_forgives_a_wrong_scale() {
    let (estimate, truth) = ([1.0, 2.0, 3.0, 4.0], [10.0, 20.0, 30.0, 40.0]);
    let scaled = json!({ "median_scaling": true });
    assert_eq!(rows(&scaled, &estimate, &truth)[0].score("abs_rel"), Some(0.0));
    assert_eq!(rows(&json!({}), &estimate, &truth)[0].score("a1"), Some(0.0));
}

/// Against `tests/fixtures/uncertainty.py` (NumPy): random maps with gaps, ties and unknown uncertainties.
#[test]
fn metrics_of_uncertainties_are_numpys() {
    let path = depthloom_test_needs::workspace().join("tests/fixtures/golden/uncertainty.json");
    let cases: Vec<Json> = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    assert_eq!(cases.len(), 12);
    for case in &cases {
        let width = case["width"].as_u64().unwrap() as u32;
        let map = |name: &str| -> Option<Vec<f32>> {
            let pixels = case[name].as_array()?.iter().map(|v| v.as_f64().map_or(f32::NAN, |v| v as f32));
            Some(pixels.collect())
        };
        let (estimate, truth) = (depth(width, &map("estimate").unwrap()), depth(width, &map("truth").unwrap()));
        let mut inputs = vec![("estimate", &estimate), ("ground_truth", &truth)];
        let deviation = map("deviation").map(|map| depth(width, &map));
        let confidence = map("confidence").map(|map| weight(width, &map));
        inputs.extend(deviation.iter().map(|map| ("deviation", map)));
        inputs.extend(confidence.iter().map(|map| ("confidence", map)));
        let params = json!({ "ause_error": case["error"], "ause_steps": case["steps"], "sets": ["all", "valid"] });
        let Value::Scores(rows) = value("score/depth", &params, &inputs) else { panic!("scores") };
        let expected = case["expected"].as_object().unwrap();
        for row in rows.iter() {
            // Behind the eight of Table I.
            assert_eq!(row.scores.len(), 8 + expected.len());
            for (name, expected) in expected {
                let (ours, expected) = (row.score(name).unwrap(), expected.as_f64().unwrap());
                assert!((ours - expected).abs() < 1e-12, "{name}: {ours}, not {expected}");
            }
        }
    }
}

#[test]
fn deviations_are_aligned_with_the_estimate() {
    // The factor is 10: the last pixel is off by 3 m, the others by nothing.
    let (estimate, truth) = (depth(2, &[1.0, 2.0, 3.0, 4.0]), depth(2, &[10.0, 20.0, 30.0, 43.0]));
    for (align, deviation_m, expected) in [("none", 0.31, 0.0), ("median", 0.31, 1.0), ("median", 0.29, 0.75)] {
        let deviation = depth(2, &[deviation_m; 4]);
        let inputs = [("estimate", &estimate), ("ground_truth", &truth), ("deviation", &deviation)];
        let Value::Scores(rows) = value("score/depth", &json!({ "align": align }), &inputs) else { panic!("scores") };
        assert_eq!(rows[0].score("coverage"), Some(expected), "{align} {deviation_m}");
    }
}
