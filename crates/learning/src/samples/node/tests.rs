//! The node as the runner calls it: frames one after the other, then the samples.

use depthloom_graphs::contracts::InlineHost;
use depthloom_graphs::values::{Calibration, Disparity, Image, Mask, Pixels, Raster};
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Node, Scratch, Value};
use half::f16;
use image::{GrayImage, RgbImage};

use super::{CollectSamples, SamplesParams};
use crate::samples::Samples;
use depthloom_random::SplitMix64;

/// What is wired to the node in a frame.
#[derive(Clone)]
struct Wired {
    image: Image,
    target: Disparity,
    mask: Mask,
    calibration: Option<Calibration>,
    right: Option<Image>,
}

fn rgb(width: u32, height: u32, seed: u64) -> Image {
    let mut random = SplitMix64::new(seed);
    let bytes = (0..width * height * 3).map(|_| random.below(256) as u8).collect();
    Image::new(Pixels::Rgb(RgbImage::from_raw(width, height, bytes).unwrap()))
}

fn disparity(width: u32, height: u32, px: i16) -> Disparity {
    let sixteenths_px = Raster::from_raw(width, height, vec![px * 16; (width * height) as usize]).unwrap();
    Disparity { sixteenths_px, min_disparity_px: 0 }
}

fn mask(width: u32, height: u32, set: u8) -> Mask {
    Mask { set: Raster::from_raw(width, height, vec![set; (width * height) as usize]).unwrap() }
}

fn wired(seed: u64) -> Wired {
    Wired {
        image: rgb(16, 8, seed),
        target: disparity(16, 8, 4),
        mask: mask(16, 8, 255),
        calibration: None,
        right: None,
    }
}

fn params() -> SamplesParams {
    SamplesParams { size: [4, 2], ..SamplesParams::default() }
}

/// The bytes that the node gives.
fn collect(params: SamplesParams, frames: &[Wired]) -> Result<Vec<u8>, Fault> {
    CollectSamples::check(&params).map_err(|(_, what)| Fault::new(what))?;
    let Instance::Ordered(mut node) = CollectSamples::build(params)? else { panic!("it sees frames in order") };
    let ports = CollectSamples::declaration().inputs;
    let mut scratch = Scratch::default();
    for (index, frame) in frames.iter().cloned().enumerate() {
        let values: Vec<Option<Value>> = ports
            .iter()
            .map(|port| match port.name {
                "image" => Some(Value::Image(frame.image.clone().into())),
                "target" => Some(Value::Disparity(frame.target.clone().into())),
                "mask" => Some(Value::Mask(frame.mask.clone().into())),
                "calibration" => frame.calibration.clone().map(|calibration| Value::Calibration(calibration.into())),
                "right" => frame.right.clone().map(|right| Value::Image(right.into())),
                other => panic!("nothing is wired to {other}"),
            })
            .collect();
        let frame = Frame::at_10_hz(format!("frame {index}"), index as u64);
        node.process(&frame, &Inputs::new(&ports, &values), &mut Context::new(&InlineHost, &mut scratch))?;
    }
    let outputs = node.finish(&mut Context::new(&InlineHost, &mut scratch))?;
    let outputs = outputs.in_order_of(&CollectSamples::declaration().outputs)?;
    let [Some(Value::Samples(samples))] = outputs.as_slice() else { panic!("it gives samples") };
    Ok(samples.bytes.to_vec())
}

fn samples(frames: &[Wired]) -> Samples {
    let bytes = collect(params(), frames).unwrap_or_else(|fault| panic!("{}", fault.chain()));
    Samples::decode(&bytes).unwrap()
}

fn message(frames: &[Wired]) -> String {
    collect(params(), frames).unwrap_err().chain()
}

#[test]
fn a_frame_becomes_a_sample_with_its_name_planes_and_scale() {
    let halves = RgbImage::from_fn(16, 8, |x, _| image::Rgb(if x < 8 { [10, 20, 30] } else { [40, 50, 60] }));
    let calibration =
        Calibration { width: 16, height: 8, focal_px: 32.0, cx_px: 8.0, cy_px: 4.0, baseline_m: 0.5, doffs_px: 0.0 };
    let image = Image::new(Pixels::Rgb(halves));
    let found = samples(&[Wired { image, calibration: Some(calibration), ..wired(0) }]);
    assert_eq!((found.width, found.height, found.has_right, found.items.len()), (4, 2, false, 1));
    let sample = &found.items[0];
    assert_eq!(sample.id, "frame 0");
    let plane = |left: u8, right: u8| [left, left, right, right].repeat(2);
    assert_eq!(sample.image, [plane(10, 40), plane(20, 50), plane(30, 60)].concat());
    assert_eq!(sample.share, vec![f16::from_f32(4.0 / 16.0); 8]);
    assert_eq!((sample.depth_scale, &sample.right), (Some(1.0), &None));
}

#[test]
fn grey_is_repeated_in_all_channels() {
    let grey = GrayImage::from_fn(16, 8, |x, y| image::Luma([(x * 13 + y * 29) as u8]));
    let repeated = RgbImage::from_fn(16, 8, |x, y| image::Rgb([grey.get_pixel(x, y).0[0]; 3]));
    let samples_of = |pixels| samples(&[Wired { image: Image::new(pixels), ..wired(0) }]);
    assert_eq!(samples_of(Pixels::Grey(grey)), samples_of(Pixels::Rgb(repeated)));
}

#[test]
fn the_right_image_is_resized_as_the_left_one_is() {
    let both = samples(&[Wired { right: Some(rgb(16, 8, 9)), ..wired(1) }]);
    let as_left = samples(&[wired(9)]);
    assert!(both.has_right);
    assert_eq!(both.items[0].right.as_ref(), Some(&as_left.items[0].image));
    assert_ne!(both.items[0].right.as_ref(), Some(&both.items[0].image));
}

#[test]
fn bytes_are_equal_with_and_without_a_temporary_file() {
    let frames: Vec<Wired> = (0..9).map(|seed| Wired { right: Some(rgb(16, 8, seed + 50)), ..wired(seed) }).collect();
    // 0 MB: every sample goes into the file.
    let [kept, spilled] =
        [256, 0].map(|memory_mb| collect(SamplesParams { memory_mb, ..params() }, &frames).unwrap_or_default());
    assert_eq!(Samples::decode(&kept).unwrap().items.len(), 9);
    assert!(kept == spilled, "bytes differ");
}

#[test]
fn frames_without_target_are_left_out() {
    let nothing = Wired { mask: mask(16, 8, 0), ..wired(1) };
    let far = Wired { target: disparity(16, 8, 0), ..wired(2) };
    let found = samples(&[wired(0), nothing.clone(), far, wired(3)]);
    assert_eq!(found.items.iter().map(|sample| sample.id.as_str()).collect::<Vec<_>>(), ["frame 0", "frame 3"]);
    assert!(samples(&[nothing]).items.is_empty());
    assert!(samples(&[]).items.is_empty());
}

#[test]
fn sizes_that_differ_are_told() {
    let target = message(&[Wired { target: disparity(16, 7, 4), ..wired(0) }]);
    assert_eq!(target, "`image` is 16x8 and `target` is 16x7: they must have the same size");
    let mask = message(&[Wired { mask: mask(8, 8, 255), ..wired(0) }]);
    assert_eq!(mask, "`image` is 16x8 and `mask` is 8x8: they must have the same size");
    let right = message(&[Wired { right: Some(rgb(17, 8, 0)), ..wired(0) }]);
    assert_eq!(right, "`image` is 16x8 and `right` is 17x8: they must have the same size");
}

#[test]
fn images_smaller_than_the_networks_are_told() {
    for (width, height) in [(3, 8), (16, 1)] {
        let (target, mask) = (disparity(width, height, 4), mask(width, height, 255));
        let small = message(&[Wired { image: rgb(width, height, 0), target, mask, ..wired(0) }]);
        assert_eq!(small, format!("`image` is {width}x{height}, smaller than the network's image of 4x2"));
    }
}

#[test]
fn all_frames_or_none_have_a_right_image() {
    let with = Wired { right: Some(rgb(16, 8, 2)), ..wired(2) };
    for frames in [[with.clone(), wired(1)], [wired(1), with]] {
        assert_eq!(message(&frames), "some frames have a right image and others do not");
    }
}

#[test]
fn a_calibration_without_metres_is_told() {
    let calibration =
        Calibration { width: 16, height: 8, focal_px: 32.0, cx_px: 8.0, cy_px: 4.0, baseline_m: 0.0, doffs_px: 0.0 };
    let flat = message(&[Wired { calibration: Some(calibration), ..wired(0) }]);
    assert_eq!(flat, "`calibration` has a focal length of 32 px and a baseline of 0 m");
    let calibration =
        Calibration { width: 16, height: 8, focal_px: 32.0, cx_px: 8.0, cy_px: 4.0, baseline_m: 0.5, doffs_px: 1.5 };
    let apart = message(&[Wired { calibration: Some(calibration), ..wired(0) }]);
    assert_eq!(
        apart,
        "the principal points of `calibration` are 1.5 px apart, but training in metres requires equal principal points"
    );
}

#[test]
fn parameters_out_of_range_are_told() {
    let wrong = [
        SamplesParams { size: [0, 2], ..params() },
        SamplesParams { size: [4, 4097], ..params() },
        SamplesParams { least_disparity: -1.0, ..params() },
        SamplesParams { least_disparity: f64::NAN, ..params() },
        SamplesParams { coverage: 1.5, ..params() },
    ];
    for params in wrong {
        let what = format!("{params:?}");
        assert!(CollectSamples::check(&params).is_err(), "{what}");
    }
}
