//! `stereo/bm` and the filters of disparity maps, on scenes made for them.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Disparity, Image, Pixels, Raster};
use image::GrayImage;
use serde_json::json;

use crate::call::{call, value};

const WIDTH: u32 = 180;
const HEIGHT: u32 = 50;

/// An object of 20 px disparity, columns 90 to 130 of the left image, before a background of 4.
const BACKGROUND: u32 = 4;
const OBJECT: u32 = 20;

/// Columns of the left image that the object hides in the right one.
const HIDDEN: std::ops::Range<u32> = 90 - (OBJECT - BACKGROUND)..90;

fn texture(layer: u32, x: u32, y: u32) -> u8 {
    let mixed = (layer << 20 ^ x << 10 ^ y).wrapping_mul(2_654_435_761);
    ((mixed ^ mixed >> 15).wrapping_mul(2_246_822_519) >> 24) as u8
}

/// The scene from a camera `baseline` times that of the pair to the right.
fn view(baseline: u32) -> Value {
    let pixel = |x: u32, y: u32| {
        let on_object = x + OBJECT * baseline;
        let layer = if (90..130).contains(&on_object) {
            texture(1, on_object, y)
        } else {
            texture(0, x + BACKGROUND * baseline, y)
        };
        image::Luma([layer])
    };
    Image::new(Pixels::Grey(GrayImage::from_fn(WIDTH, HEIGHT, pixel))).into()
}

fn map(width: u32, min_disparity_px: i32, sixteenths: &[i16]) -> Value {
    let height = sixteenths.len() as u32 / width;
    let sixteenths_px = Raster::from_raw(width, height, sixteenths.to_vec()).unwrap();
    Disparity { sixteenths_px, min_disparity_px }.into()
}

fn pixels(value: &Value) -> &[i16] {
    let Value::Disparity(map) = value else { panic!("{} is not a disparity", value.value_type()) };
    map.sixteenths_px.as_raw()
}

/// Valid pixels among columns, and those of them farther than 1 px from the background's disparity.
fn valid(disparity: &Value, columns: std::ops::Range<u32>) -> (usize, usize) {
    let Value::Disparity(map) = disparity else { panic!("disparity") };
    let found = map
        .sixteenths_px
        .enumerate_pixels()
        .filter(|(x, _, pixel)| columns.contains(x) && i32::from(pixel.0[0]) != map.invalid());
    let wrong = |pixel: &i16| (i32::from(*pixel) - BACKGROUND as i32 * 16).abs() > 16;
    let found: Vec<i16> = found.map(|(.., pixel)| pixel.0[0]).collect();
    (found.len(), found.iter().filter(|pixel| wrong(pixel)).count())
}

#[test]
fn pixels_hidden_in_the_right_image_fail_the_left_right_check() {
    let (left, right) = (view(0), view(1));
    let params = json!({ "disparities": 32, "block": 7, "uniqueness": 0, "texture_threshold": 0 });
    let forth = value("stereo/bm", &params, &[("left", &left), ("right", &right)]);
    let mut exchanged = params;
    exchanged["min_disparity"] = json!(-31);
    let back = value("stereo/bm", &exchanged, &[("left", &right), ("right", &left)]);
    let checked = value("disparity/left-right", &json!({}), &[("left", &forth), ("right", &back)]);

    let (seen, wrong) = valid(&forth, HIDDEN);
    let (still_seen, still_wrong) = valid(&checked, HIDDEN);
    println!("hidden: {seen} valid, {wrong} wrong; checked: {still_seen} and {still_wrong}");
    assert!(wrong > seen / 2, "without a check, {wrong} of {seen} hidden pixels are wrong");
    // What is left of the block's width beside the object passes: both views fatten it.
    assert!(still_wrong * 3 < wrong, "{still_wrong} of {wrong} wrong answers pass");
    let (before, after) = (valid(&forth, 40..70), valid(&checked, 40..70));
    assert!(before.1 == 0 && after.1 == 0 && after.0 * 10 > before.0 * 9, "{before:?} {after:?}: what both see stays");
}

#[test]
fn filled_gaps_take_the_background() {
    let before = map(6, 0, &[-16, 90, -16, -16, 40, 50, -16, -16, -16, -16, -16, -16]);
    let after = |longest| value("disparity/fill", &json!({ "longest": longest }), &[("disparity", &before)]);
    let row = [90, 90, 40, 40, 40, 50];
    assert_eq!(pixels(&after(None)), row.repeat(2));
    let mut limited = row.repeat(2);
    (limited[2], limited[3]) = (-16, -16);
    (limited[8], limited[9]) = (-16, -16);
    assert_eq!(pixels(&after(Some(1_u32))), limited);
}

#[test]
fn speckles_are_regions_whose_neighbours_differ_little() {
    let before = map(6, -2, &[0, 8, 8, 40, -48, 40]);
    let after = |window, range| {
        let params = json!({ "window": window, "range": range });
        pixels(&value("disparity/speckle", &params, &[("disparity", &before)])).to_vec()
    };
    assert_eq!(after(1, 0.5), [0, 8, 8, -48, -48, -48]);
    assert_eq!(after(3, 0.5), [-48; 6]);
    assert_eq!(after(3, 2.0), [0, 8, 8, 40, -48, -48]);
    assert_eq!(after(0, 0.0), [0, 8, 8, 40, -48, 40]);
}

#[test]
fn maps_of_different_sizes_and_images_smaller_than_the_block_are_errors() {
    let (small, large) = (map(2, 0, &[0; 4]), map(2, 0, &[0; 6]));
    let fault = |kind: &str, inputs: [(&str, Value); 2]| call(kind, &json!({}), &inputs).unwrap_err().to_string();
    assert_eq!(
        fault("disparity/left-right", [("left", small), ("right", large)]),
        "`left` is 2x2 and `right` is 2x3: they must have the same size"
    );
    let image: Value = Image::new(Pixels::Grey(GrayImage::new(200, 21))).into();
    assert_eq!(
        fault("stereo/bm", [("left", image.clone()), ("right", image)]),
        "image is 200x21, too small for a block of 21: both sides must be larger"
    );
}

#[test]
fn the_right_view_decides_how_hidden_pixels_are_smoothed() {
    let (left, right) = (view(0), view(1));
    let params = json!({ "disparities": 32, "block": 7, "uniqueness": 0, "texture_threshold": 0 });
    let forth = value("stereo/bm", &params, &[("left", &left), ("right", &right)]);
    let mut exchanged = params;
    exchanged["min_disparity"] = json!(-31);
    let back = value("stereo/bm", &exchanged, &[("left", &right), ("right", &left)]);
    // The scene's texture is noise, in which every pixel is an edge: layers of one brightness each guide.
    let layers = GrayImage::from_fn(WIDTH, HEIGHT, |x, _| image::Luma([if (90..130).contains(&x) { 200 } else { 50 }]));
    let layers: Value = Image::new(Pixels::Grey(layers)).into();
    let kind = "disparity/weighted-least-squares";
    let alone = value(kind, &json!({}), &[("image", &layers), ("disparity", &forth)]);
    let both = value(kind, &json!({}), &[("image", &layers), ("disparity", &forth), ("right", &back)]);

    let (hidden, shown) = (HIDDEN, 93..127);
    let (before, after) = (valid(&forth, hidden.clone()), valid(&both, hidden.clone()));
    println!("hidden, valid and wrong: {before:?}, alone {:?}, both {after:?}", valid(&alone, hidden));
    assert!(before.1 > before.0 / 2 && after.1 == 0 && after.0 >= before.0, "{before:?} {after:?}");
    let of_object = valid(&both, shown);
    assert_eq!(of_object.0, of_object.1, "the object keeps its own disparity");
    assert!(valid(&both, 0..30).0 == 0, "columns that were never searched stay without answer");
}

#[test]
fn smoothing_fills_invalid_pixels_on_request() {
    let image: Value = Image::new(Pixels::Grey(GrayImage::new(4, 3))).into();
    let before = map(4, 0, &[-16, 32, 32, 32, -16, 32, -16, 32, -16, -16, -16, -16]);
    let after = |fill: bool| {
        let params = json!({ "fill": fill });
        let inputs = [("image", &image), ("disparity", &before)];
        pixels(&value("disparity/weighted-least-squares", &params, &inputs)).to_vec()
    };
    assert_eq!(after(true), [-16, 32, 32, 32, -16, 32, 32, 32, -16, -16, -16, -16]);
    assert_eq!(after(false), pixels(&before));
    let small: Value = Image::new(Pixels::Grey(GrayImage::new(4, 2))).into();
    let fault =
        call("disparity/weighted-least-squares", &json!({}), &[("image", small), ("disparity", before.clone())]);
    assert_eq!(fault.unwrap_err().to_string(), "`image` is 4x2 and `disparity` is 4x3: they must have the same size");
}

#[test]
fn fault_12_costs_that_take_more_memory_than_there_is_are_refused_with_their_number() {
    let image: Value = Image::new(Pixels::Grey(GrayImage::new(8192, 8192))).into();
    let modes = [
        ("stereo/census-sgm", json!({ "disparities": 256 }), "32.0 GiB"),
        ("stereo/census-sgm", json!({ "disparities": 256, "census": "full", "p2": 100, "paths": 4 }), "32.0 GiB"),
        // The first 256 columns are not searched.
        ("stereo/sgbm", json!({ "disparities": 256, "mode": "hh" }), "62.0 GiB"),
        ("stereo/sgbm", json!({ "disparities": 256, "mode": "hh4" }), "62.0 GiB"),
    ];
    for (kind, params, number) in modes {
        let inputs = [("left", image.clone()), ("right", image.clone())];
        let fault = call(kind, &params, &inputs).unwrap_err();
        let report = fault.chain();
        let expected = format!("the images are 8192x8192: {number} of memory would be needed, and 8 GiB is the most");
        assert_eq!(report, expected, "{kind} {params}");
        assert!(fault.remedy_text().is_some_and(|remedy| remedy.contains("reduce `disparities`")));
    }
}
