//! Single steps on maps small enough to check by hand.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Depth, Disparity, Image, Pixels, Raster, Weight};
use image::{GrayImage, RgbImage};
use serde_json::json;

use crate::call::{call, metres, value};

const NAN: f32 = f32::NAN;

pub(crate) fn depth(width: u32, metres: &[f32]) -> Value {
    let height = metres.len() as u32 / width;
    Depth { metres: Raster::from_raw(width, height, metres.to_vec()).unwrap() }.into()
}

pub(crate) fn weight(width: u32, shares: &[f32]) -> Value {
    let height = shares.len() as u32 / width;
    Weight { share: Raster::from_raw(width, height, shares.to_vec()).unwrap() }.into()
}

pub(crate) fn calibration(focal_px: f64, baseline_m: f64) -> Value {
    Calibration { width: 4, height: 1, focal_px, cx_px: 2.0, cy_px: 0.5, baseline_m, doffs_px: 0.0 }.into()
}

fn disparity(sixteenths: &[i16]) -> Value {
    let sixteenths_px = Raster::from_raw(sixteenths.len() as u32, 1, sixteenths.to_vec()).unwrap();
    Disparity { sixteenths_px, min_disparity_px: 0 }.into()
}

fn rgb(width: u32, height: u32, bytes: Vec<u8>) -> Value {
    Image::new(Pixels::Rgb(RgbImage::from_raw(width, height, bytes).unwrap())).into()
}

fn grey(width: u32, height: u32, bytes: Vec<u8>) -> Value {
    Image::new(Pixels::Grey(GrayImage::from_raw(width, height, bytes).unwrap())).into()
}

fn same(found: &[f32], expected: &[f32]) {
    let bits = |map: &[f32]| map.iter().map(|metres| metres.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(found), bits(expected), "{found:?} is not {expected:?}");
}

#[test]
fn invalid_disparity_is_invalid_depth_and_far_depth_is_capped() {
    let inputs = [("disparity", &disparity(&[-16, 0, 16, 160])), ("calibration", &calibration(100.0, 0.5))];
    same(metres(&value("depth/from-disparity", &json!({ "cap": 20.0 }), &inputs)), &[NAN, NAN, 20.0, 5.0]);
    same(metres(&value("depth/from-disparity", &json!({ "cap": null }), &inputs)), &[NAN, NAN, 50.0, 5.0]);
}

#[test]
fn unscaled_mono_is_the_same_value_not_a_copy() {
    let mono = depth(2, &[3.0, 4.0]);
    let stereo = depth(2, &[NAN, 8.0]);
    let scaled = value("fusion/scale", &json!({ "method": "none" }), &[("mono", &mono), ("stereo", &stereo)]);
    let (Value::Depth(before), Value::Depth(after)) = (&mono, &scaled) else { panic!("depth") };
    assert!(std::sync::Arc::ptr_eq(before, after));
}

#[test]
fn occluded_pixels_take_mono() {
    let (mono, stereo, weight) = (depth(3, &[3.0, 4.0, 8.0]), depth(3, &[NAN, 2.0, 4.0]), weight(3, &[1.0, 1.0, 0.0]));
    let fused = |weighting: &str| {
        let inputs = [("mono", &mono), ("stereo", &stereo), ("weight", &weight)];
        metres(&value("fusion/confidence", &json!({ "weighting": weighting }), &inputs)).to_vec()
    };
    same(&fused("full"), &[3.0, 2.0, 4.0]);
    same(&fused("confidence"), &[3.0, 2.0, 8.0]);
    same(&fused("mean"), &[3.0, 3.0, 6.0]);
    same(&fused("fill"), &[3.0, 2.0, 4.0]);
}

#[test]
fn the_median_removes_outliers() {
    let mut map = vec![5.0; 49];
    map[24] = 70.0;
    map[0] = NAN;
    for size in [3, 5] {
        same(metres(&value("filter/median", &json!({ "size": size }), &[("depth", &depth(7, &map))])), &[5.0; 49]);
    }
}

#[test]
fn grey_and_colour_images_of_the_same_brightness_have_the_same_edges() {
    let columns = [10, 10, 200, 200, 10, 10];
    let line: Vec<u8> = columns.repeat(3);
    let colour: Vec<u8> = line.iter().flat_map(|&value| [value; 3]).collect();
    let edges = |image: &Value| {
        let Value::Mask(mask) = value("confidence/edges", &json!({}), &[("image", image)]) else { panic!("mask") };
        mask.set.as_raw().clone()
    };
    let expected = [0, 255, 255, 255, 255, 0].repeat(3);
    assert_eq!(edges(&grey(6, 3, line)), expected);
    assert_eq!(edges(&rgb(6, 3, colour)), expected);
}

#[test]
fn an_image_without_edges_has_no_confidence_anywhere() {
    let flat = grey(9, 5, vec![77; 45]);
    let Value::Weight(weight) = value("confidence/sobel", &json!({}), &[("image", &flat)]) else { panic!("weight") };
    same(weight.share.as_raw(), &[0.0; 45]);
}

#[test]
fn inputs_of_different_sizes_are_named_in_the_error() {
    let (small, large) = (depth(2, &[1.0, 2.0]), depth(3, &[1.0, 2.0, 3.0]));
    let fault = |kind: &str, inputs: &[(&str, Value)]| call(kind, &json!({}), inputs).unwrap_err().to_string();
    assert_eq!(
        fault("fusion/scale", &[("mono", small.clone()), ("stereo", large.clone())]),
        "`mono` is 2x1 and `stereo` is 3x1: they must have the same size"
    );
    assert_eq!(
        fault(
            "fusion/confidence",
            &[("mono", small.clone()), ("stereo", small.clone()), ("weight", weight(1, &[0.5]))]
        ),
        "`mono` is 2x1 and `weight` is 1x1: they must have the same size"
    );
    assert_eq!(
        fault("score/depth", &[("estimate", small), ("ground_truth", large)]),
        "`estimate` is 2x1 and `ground_truth` is 3x1: they must have the same size"
    );
    assert_eq!(
        fault("stereo/sgbm", &[("left", grey(2, 1, vec![0; 2])), ("right", grey(1, 1, vec![0]))]),
        "`left` is 2x1 and `right` is 1x1: they must have the same size"
    );
}

#[test]
fn an_image_narrower_than_the_search_is_an_error() {
    let image = grey(40, 8, (0..320).map(|i| (i * 7 % 251) as u8).collect());
    let fault = call("stereo/sgbm", &json!({}), &[("left", image.clone()), ("right", image)]).unwrap_err();
    assert!(fault.to_string().starts_with("image is 40 columns wide, too narrow for these disparities"), "{fault}");
}

#[test]
fn census_finds_a_shift_whatever_the_exposure() {
    let texture = |x: u32, y: u32| (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503).rotate_left(7)) / 7 % 120;
    let image = |shift: u32, gain: u32| {
        let pixels = (0..40).flat_map(|y| (0..120).map(move |x| (gain * texture(x + shift, y) + 9) as u8)).collect();
        grey(120, 40, pixels)
    };
    let inputs = [("left", &image(0, 1)), ("right", &image(11, 2))];
    for paths in [4, 8] {
        let params = json!({ "disparities": 32, "min_disparity": -2, "paths": paths });
        let Value::Disparity(map) = value("stereo/census-sgm", &params, &inputs) else { panic!("disparity") };
        assert_eq!(map.invalid(), -48);
        let found = (50..100).map(|x| map.sixteenths_px.get_pixel(x, 20).0[0]);
        assert!(found.clone().all(|sixteenths| (sixteenths - 11 * 16).abs() <= 8), "{:?}", found.collect::<Vec<_>>());
    }
}
