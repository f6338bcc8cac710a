//! `score/depth`: presets, and single settings over them.

use depthloom_graphs::Value;
use depthloom_scores::{PixelSet, ScoreRow};
use serde_json::{Value as Json, json};

use crate::call::value;
use crate::steps::depth;

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
