//! `fusion/mixture` against the trials in NumPy and OpenCV, on six real frames.

use depthloom_graphs::Value;
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::values::{Disparity, Image, Pixels, Raster};
use depthloom_test_needs::{shared, skipped};
use image::imageops::flip_horizontal;
use image::{GrayImage, Luma};
use serde_json::{Value as Json, json};
use std::path::Path;

use crate::call::{Values, call, metres, model, open, value};
use crate::golden::rows;
use crate::steps::{calibration, depth};

/// A frame and what both trials compute from it.
struct Frame {
    id: String,
    grey: [GrayImage; 2],
    calibration: Value,
    truth: Value,
    mono: Value,
}

fn frames(shared: &Path) -> Vec<Frame> {
    let root = shared.join("data/kitti_stereo_2015");
    let numbers: Vec<u32> = (150..=155).collect();
    let source = open("kitti/stereo2015", &json!({ "root": root, "frames": numbers })).unwrap();
    let network = model(std::fs::read(shared.join("models/ssl_unet.onnx")).unwrap());
    let ids = numbers.iter().map(|number| format!("{number:06}_10"));
    FrameIndex::enumerate(ids)
        .map(|(position, id)| {
            let (mut values, _) = source.read(position).unwrap();
            let mut take = |port| values.remove(port).unwrap();
            let (left, right, calibration, truth) = (take("left"), take("right"), take("calibration"), take("depth"));
            let inputs = [("image", left.clone()), ("calibration", calibration.clone()), ("model", network.clone())];
            let mono = call("mono/onnx", &json!({}), &inputs).unwrap().remove("depth").unwrap();
            Frame { id, grey: [left, right].map(|image| grey(&image)), calibration, truth, mono }
        })
        .collect()
}

fn grey(image: &Value) -> GrayImage {
    let Value::Image(image) = image else { panic!("image") };
    let Pixels::Rgb(rgb) = image.pixels() else { panic!("colour") };
    let mut grey = GrayImage::new(rgb.width(), rgb.height());
    depthloom_kernels::grey::grey_from_rgb(rgb, rgb.width() as usize, rgb.height() as usize, &mut grey);
    grey
}

/// Disparity of a pair whose left border is extended by `columns` replicated columns, without these columns.
fn sgbm(left: &GrayImage, right: &GrayImage, params: &Json, columns: u32) -> Raster<i16> {
    let extended = |image: &GrayImage| {
        let (width, height) = image.dimensions();
        let pixel = |x: u32, y: u32| *image.get_pixel(x.saturating_sub(columns), y);
        Value::from(Image::new(Pixels::Grey(GrayImage::from_fn(width + columns, height, pixel))))
    };
    let Value::Disparity(map) = value("stereo/sgbm", params, &[("left", &extended(left)), ("right", &extended(right))])
    else {
        panic!("disparity")
    };
    let (width, height) = left.dimensions();
    Raster::from_fn(width, height, |x, y| *map.sixteenths_px.get_pixel(x + columns, y))
}

fn disparity(sixteenths_px: Raster<i16>, min_disparity_px: i32) -> Value {
    Disparity { sixteenths_px, min_disparity_px }.into()
}

/// The inputs of a trial: disparity, right view, and disparity with a check of uniqueness.
fn stereo(frame: &Frame, disparities: u32, columns: u32) -> [Value; 3] {
    let params = json!({ "disparities": disparities });
    let [left, right] = &frame.grey;
    let fixed = sgbm(left, right, &params, columns);
    let unique = sgbm(left, right, &json!({ "disparities": disparities, "uniqueness": 10 }), columns);
    let mirrored = sgbm(&flip_horizontal(right), &flip_horizontal(left), &params, columns);
    let negative = |pixel: &Luma<i16>| Luma([-pixel.0[0]]);
    let width = mirrored.width();
    let right = Raster::from_fn(width, mirrored.height(), |x, y| negative(mirrored.get_pixel(width - 1 - x, y)));
    // The trials read the -1 px of an invalid pixel as a disparity: no pixel of this map is invalid.
    [disparity(fixed, 0), disparity(right, -2047), disparity(unique, 0)]
}

/// Compares the eight metrics of a depth map with the row of a trial.
fn compare(estimate: &Value, frame: &Frame, golden: &Path, estimator: &str) -> f64 {
    let csv = std::fs::read_to_string(golden).unwrap();
    let wanted = [frame.id.as_str(), estimator];
    let line = csv.lines().find(|line| line.split(',').take(2).eq(wanted)).unwrap();
    let numbers: Vec<f64> = line.split(',').skip(2).map(|number| number.parse().unwrap()).collect();
    let row = &rows(estimate, &frame.truth, &["all"])[0];
    assert_eq!(row.pixels as f64, numbers[0]);
    assert_eq!(row.scores.len(), numbers.len() - 1);
    let mut worst = 0.0_f64;
    for ((metric, ours), trial) in row.scores.iter().zip(&numbers[1..]) {
        let off = (ours - trial).abs() / trial.min(1.0);
        assert!(off <= 1e-4, "{} {estimator}: {} is {ours}, the trial has {trial}", frame.id, metric.name);
        worst = worst.max(off);
    }
    worst
}

#[test]
fn mixtures_with_the_constants_of_the_trials_have_their_scores() {
    let name = "mixtures_with_the_constants_of_the_trials_have_their_scores";
    let Some(shared) = shared(name) else { return };
    if let Err(fault) = depthloom_nodes::onnx::find() {
        return skipped(name, &fault.chain());
    }
    let golden = shared.join("oracle/golden");
    let mut worst = [0.0_f64; 3];
    for frame in frames(&shared) {
        let common = [("mono", frame.mono.clone()), ("calibration", frame.calibration.clone())];
        let fused = |params: &Json, inputs: &[(&str, &Value)]| {
            let inputs = inputs.iter().map(|(port, value)| (*port, (*value).clone()));
            let inputs: Vec<_> = common.iter().cloned().chain(inputs).collect();
            call("fusion/mixture", params, &inputs)
                .unwrap_or_else(|fault| panic!("{}", fault.chain()))
                .remove("depth")
                .unwrap()
        };
        let [fixed, right, unique] = stereo(&frame, 64, 0);
        let depth = fused(
            &json!({ "alignment": "none", "prior": { "near": 1, "support": null } }),
            &[("disparity", &fixed), ("right", &right)],
        );
        worst[0] = worst[0].max(compare(&depth, &frame, &golden.join("mixture/scores.csv"), "mixture"));
        let depth = fused(
            &json!({ "prior": { "support": null }, "local": { "regulariser": 0.05 } }),
            &[("disparity", &fixed), ("right", &right), ("unique", &unique)],
        );
        let scores = golden.join("local_mixture/scores_64.csv");
        worst[1] = worst[1].max(compare(&depth, &frame, &scores, "local_mixture"));
        let [fixed, right, unique] = stereo(&frame, 128, 128);
        let depth = fused(
            &json!({ "disparities": 128, "prior": { "support": null }, "local": { "regulariser": 0.05 } }),
            &[("disparity", &fixed), ("right", &right), ("unique", &unique)],
        );
        let scores = golden.join("local_mixture/scores_128.csv");
        worst[2] = worst[2].max(compare(&depth, &frame, &scores, "local_mixture"));
    }
    println!(
        "none, local, local with 128 disparities: scores off by at most {worst:.1?}, relative where they are below 1"
    );
}

/// A small frame: disparity and monocular depth of its pixels.
fn small(params: &Json, disparities: &[i16], mono: &[f32]) -> Values {
    let map = Raster::from_raw(disparities.len() as u32, 1, disparities.to_vec()).unwrap();
    let inputs = [
        ("disparity", disparity(map, 0)),
        ("mono", depth(mono.len() as u32, mono)),
        ("calibration", calibration(100.0, 0.5)),
    ];
    call("fusion/mixture", params, &inputs).unwrap()
}

#[test]
fn a_pixel_is_fused_as_computed_by_hand() {
    // f B = 50 px m. d = 10 px: z_s = ln 5, s_s = 0.1. z_m = ln 6, s_m = 0.4, p = 0.97 * 0.99. In Python:
    // v = .17; n = exp(-.5 * log(5 / 6) ** 2 / v) / sqrt(2 * pi * v); q = p * n / (p * n + (1 - p) / log(128))
    // m = (log(5) / .01 + log(6) / .16) / (1 / .01 + 1 / .16); z = q * m + (1 - q) * log(6)
    // V = q * (1 / (1 / .01 + 1 / .16) + (m - z) ** 2) + (1 - q) * (.16 + (log(6) - z) ** 2)
    let near = json!({ "alignment": "none", "prior": { "near": 1 } });
    let values = small(&near, &[160; 5], &[6.0; 5]);
    let (p, v) = (0.97 * 0.99, 0.17_f64);
    let (z_s, z_m) = (5_f64.ln(), 6_f64.ln());
    let n = (-0.5 * (z_s - z_m).powi(2) / v).exp() / (std::f64::consts::TAU * v).sqrt();
    let q = p * n / (p * n + (1.0 - p) / 128_f64.ln());
    let m = (z_s / 0.01 + z_m / 0.16) / (1.0 / 0.01 + 1.0 / 0.16);
    let z = q * m + (1.0 - q) * z_m;
    let variance = q * (1.0 / (1.0 / 0.01 + 1.0 / 0.16) + (m - z).powi(2)) + (1.0 - q) * (0.16 + (z_m - z).powi(2));
    let close =
        |found: f32, expected: f64| assert!((f64::from(found) / expected - 1.0).abs() < 1e-5, "{found} {expected}");
    close(metres(&values["depth"])[2], z.exp());
    close(metres(&values["deviation"])[2], z.exp() * variance.sqrt());
    close(metres(&values["aligned"])[2], 6.0);
    let Value::Weight(inlier) = &values["inlier"] else { panic!("weight") };
    close(inlier.share.as_raw()[2], q);
}

#[test]
fn a_pixel_has_the_estimate_that_is_valid() {
    for alignment in ["none", "local"] {
        let params = json!({ "alignment": alignment });
        let nan = f32::NAN;
        assert_eq!(metres(&small(&params, &[160; 5], &[nan; 5])["depth"]), [5.0; 5]);
        assert!(metres(&small(&params, &[-16; 5], &[nan; 5])["depth"]).iter().all(|depth| depth.is_nan()));
        let mono = small(&params, &[-16; 3], &[20.0; 3]);
        assert!(metres(&mono["depth"]).iter().all(|depth| (depth - 20.0).abs() < 1e-4));
    }
}

#[test]
fn learned_reliability_replaces_the_constants() {
    // Stereo is 10 px everywhere, which is 5 m; monocular depth is 5.5 m: both agree.
    let (disparities, mono) = ([160; 100], [5.5; 100]);
    let inputs = [
        ("disparity", disparity(Raster::from_raw(10, 10, disparities.to_vec()).unwrap(), 0)),
        ("mono", depth(10, &mono)),
        ("calibration", calibration(100.0, 0.5)),
    ];
    let learned = call("learn/reliability", &json!({}), &inputs).unwrap().remove("reliability").unwrap();
    let text: Json = serde_json::from_slice(&learned.artifact().unwrap().bytes).unwrap();
    assert_eq!((&text["frames"], &text["trusted_pixels"]), (&json!(1), &json!(100)));
    let wired: Vec<_> = inputs.iter().cloned().chain([("reliability", learned)]).collect();
    let near = json!({ "alignment": "none", "mono_spread": 5 });
    let ours = call("fusion/mixture", &near, &wired).unwrap();
    let Value::Weight(inlier) = &ours["inlier"] else { panic!("weight") };
    // A spread of 5 makes monocular depth useless, but it is not used: ln 1.1 = 0.095 is learned, less stereo's part.
    assert!(inlier.share.iter().all(|share| *share > 0.99));
    let depth = metres(&ours["depth"])[0];
    assert!((5.1..5.5).contains(&depth), "{depth}");

    let invalid = inputs.clone().map(|(port, value)| match port {
        "mono" => (port, crate::steps::depth(10, &[f32::NAN; 100])),
        _ => (port, value),
    });
    let fault = call("learn/reliability", &json!({}), &invalid).unwrap_err().chain();
    assert!(fault.contains("no pixel of 1 frame is trusted"), "{fault}");
    let other = Value::Reliability(depthloom_graphs::values::Artifact::reliability("{}".to_owned()).into());
    let wired: Vec<_> = inputs.into_iter().chain([("reliability", other)]).collect();
    let fault = call("fusion/mixture", &json!({}), &wired).unwrap_err();
    assert!(fault.chain().contains("`reliability` cannot be read"), "{}", fault.chain());
}

#[test]
fn a_disparity_beyond_the_search_is_refused() {
    let disparity = disparity(Raster::from_raw(2, 1, vec![160, 65 * 16]).unwrap(), 0);
    let inputs = [("disparity", disparity), ("mono", depth(2, &[5.0, 5.0])), ("calibration", calibration(100.0, 0.5))];
    let fault = call("fusion/mixture", &json!({ "disparities": 64 }), &inputs).unwrap_err().chain();
    assert!(fault.contains("has 65 px, but `disparities: 64` ends"), "{fault}");
    call("fusion/mixture", &json!({ "disparities": 128 }), &inputs).unwrap();
}
