//! `mono/onnx` with networks of one operator: what goes in, what comes out, and what is refused.

use depthloom_graphs::plan::FrameIndex;
use std::path::Path;
#[cfg(feature = "tract")]
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_graphs::values::{Depth, Image, Pixels, Raster};
use depthloom_nodes::onnx;
use depthloom_nodes::onnx::Provider;
#[cfg(feature = "tract")]
use depthloom_test_needs::onnx_runtime;
use depthloom_test_needs::{shared, skipped};
use image::RgbImage;
use serde_json::{Value as Json, json};

use crate::call::{call, metres, model, open, value};
use crate::steps::calibration;
use depthloom_test_needs::onnx_file::{self, F32, Tensor, U8};

/// Whether this machine can run networks; says that the test is skipped where it cannot.
fn can_run(test: &str) -> bool {
    match onnx::find() {
        Ok(_) => true,
        Err(fault) => {
            skipped(test, &fault.chain());
            false
        }
    }
}

/// A network that gives the mean of its input's channels: of 1x3xHxW, 1x1xHxW.
fn mean(input: &[i64], output: &[i64]) -> Value {
    model(onnx_file::model("ReduceMean", Some(1), &[Tensor("image", F32, input)], &Tensor("share", F32, output)))
}

/// Four columns, each of one grey, two rows.
fn image() -> Value {
    let row = [51, 51, 51, 102, 102, 102, 204, 204, 204, 255, 255, 255];
    Image::new(Pixels::Rgb(RgbImage::from_raw(4, 2, row.repeat(2)).unwrap())).into()
}

fn run(params: &Json, model: &Value) -> Result<Vec<f32>, String> {
    let inputs = [("image", image()), ("calibration", calibration(10.0, 2.0)), ("model", model.clone())];
    let error = |fault: depthloom_graphs::Fault| match fault.remedy_text() {
        Some(remedy) => format!("{}\n  remedy: {remedy}", fault.chain()),
        None => fault.chain(),
    };
    call("mono/onnx", params, &inputs).map(|values| metres(&values["depth"]).to_vec()).map_err(error)
}

fn assert_close(found: &[f32], expected: [f32; 4]) {
    for (found, expected) in found.iter().zip(expected.repeat(2)) {
        assert!((found - expected).abs() <= 1e-5 * expected, "{found} is not {expected}");
    }
}

#[test]
fn every_meaning_of_the_output_becomes_metres() {
    if !can_run("every_meaning_of_the_output_becomes_metres") {
        return;
    }
    // The image is as large as the network's; the means are .2 .4 .8 1, and f * B is 20 px m.
    let network = mean(&[1, 3, 2, 4], &[1, 1, 2, 4]);
    let run = |params| run(&params, &network).unwrap();
    assert_close(&run(json!({})), [25.0, 12.5, 6.25, 5.0]);
    assert_close(&run(json!({ "cap": 10 })), [10.0, 10.0, 6.25, 5.0]);
    assert_close(&run(json!({ "output_scale": 0.5 })), [50.0, 25.0, 12.5, 10.0]);
    assert_close(&run(json!({ "floor_px": 2.0 })), [10.0, 10.0, 6.25, 5.0]);
    assert_close(&run(json!({ "output": "disparity-px", "cap": null })), [100.0, 50.0, 25.0, 20.0]);
    assert_close(&run(json!({ "output": "inverse-depth" })), [5.0, 2.5, 1.25, 1.0]);
    assert_close(&run(json!({ "output": "depth", "output_scale": 100.0 })), [20.0, 40.0, 80.0, 80.0]);
    assert_close(&run(json!({ "output": "depth", "mean": [1.0, 1.0, 1.0] })), [1e-3; 4]);
    assert_close(&run(json!({ "output": "depth", "std": [0.5, 0.5, 0.5] })), [0.4, 0.8, 1.6, 2.0]);
}

#[test]
fn metadata_of_a_model_may_state_the_meaning_of_its_output() {
    if !can_run("metadata_of_a_model_may_state_the_meaning_of_its_output") {
        return;
    }
    let saying = |meaning: &str| {
        let (image, map) = (Tensor("image", F32, &[1, 3, 2, 4]), Tensor("map", F32, &[1, 1, 2, 4]));
        let mut bytes = onnx_file::model("ReduceMean", Some(1), &[image], &map);
        // `metadata_props`, field 14 of ModelProto: a key and a value, fields 1 and 2.
        let name = "depthloom.output";
        let entry = [&[0x0a, name.len() as u8], name.as_bytes(), &[0x12, meaning.len() as u8], meaning.as_bytes()];
        let entry = entry.concat();
        bytes.extend([0x72, entry.len() as u8]);
        bytes.extend(entry);
        model(bytes)
    };
    assert_close(&run(&json!({ "output_scale": 100.0 }), &saying("depth")).unwrap(), [20.0, 40.0, 80.0, 80.0]);
    assert_close(&run(&json!({ "output": "inverse-depth" }), &saying("inverse-depth")).unwrap(), [5.0, 2.5, 1.25, 1.0]);
    let error = run(&json!({ "output": "disparity-share" }), &saying("depth")).unwrap_err();
    assert!(error.contains("state the output `depth`") && error.contains("leave `output` out"), "{error}");
    assert!(run(&json!({}), &saying("warmth")).unwrap_err().contains("which is not supported"));
}

#[test]
fn a_second_output_is_the_standard_deviation_of_log_depth() {
    if !can_run("a_second_output_is_the_standard_deviation_of_log_depth") {
        return;
    }
    // Two outputs of the same numbers, .2 .4 .8 1.
    let outputs = [Tensor("share", F32, &[1, 1, 2, 4]), Tensor("spread", F32, &[1, 1, 2, 4])];
    let network =
        model(onnx_file::of_outputs("ReduceMean", &[("axes", &[1])], &[Tensor("image", F32, &[1, 3, 2, 4])], &outputs));
    let inputs = [("image", image()), ("calibration", calibration(10.0, 2.0)), ("model", network)];
    let maps = |params: Json| call("mono/onnx", &params, &inputs).map_err(|fault| fault.chain());
    let values = maps(json!({ "spread_name": "spread", "cap": 20 })).unwrap();
    assert_close(metres(&values["depth"]), [20.0, 12.5, 6.25, 5.0]);
    assert_close(metres(&values["deviation"]), [4.0, 5.0, 5.0, 5.0]);
    // The factor on the output is not one on its spread, and the mirror image counts in both.
    let values = maps(json!({ "spread_name": "spread", "output_scale": 0.5, "flip": "mean" })).unwrap();
    assert_close(metres(&values["deviation"]), [10.0, 10.0, 10.0, 10.0]);
    assert!(!maps(json!({})).unwrap().contains_key("deviation"));
    let error = maps(json!({ "spread_name": "doubt" })).unwrap_err();
    assert!(error.contains("no output `doubt`; it has share, spread"), "{error}");
}

/// A host that counts warnings.
#[derive(Default)]
struct Listening(std::sync::Mutex<Vec<(u64, String)>>);

impl depthloom_graphs::Host for Listening {
    fn cancelled(&self) -> bool {
        false
    }

    fn warn_n(&self, count: u64, what: &str) {
        self.0.lock().unwrap().push((count, what.to_owned()));
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {}

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        1
    }
}

#[test]
fn fault_42_nan_pixels_are_invalid_counted_and_do_not_spread() {
    if !can_run("fault_42_pixels_that_are_no_numbers_are_no_answers") {
        return;
    }
    use depthloom_graphs::{Context, Inputs, Instance, Scratch};
    let registry = depthloom_nodes::registry();
    let kind = registry.node_kind("mono/onnx").unwrap();
    // Of .2 .4 .8 1, the mean is taken away: the root of negative numbers is NaN, of the others .55 and .71.
    let depth_and_warnings = |op: &str, columns: i64, params: Json| {
        let (input, output) = (Tensor("x", F32, &[1, 1, 2, columns]), Tensor("y", F32, &[1, 1, 2, columns]));
        let network = model(onnx_file::model(op, None, &[input], &output));
        let Instance::Pure(node) = kind.build(&kind.resolve(&params).unwrap()).unwrap() else { panic!("pure") };
        let inputs = [Some(image()), Some(calibration(10.0, 2.0)), Some(network)];
        let (host, mut scratch) = (Listening::default(), Scratch::default());
        let inputs = Inputs::new(&kind.declaration.inputs, &inputs);
        let outputs = node.process(&inputs, &mut Context::new(&host, &mut scratch)).unwrap();
        let value = outputs.in_order_of(&kind.declaration.outputs).unwrap().remove(0).unwrap();
        (metres(&value).to_vec(), host.0.into_inner().unwrap())
    };
    let error = |count| vec![(count, "pixels of the network's output are NaN or infinite, and so invalid".to_owned())];
    let dark = json!({ "mean": [0.5, 0.5, 0.5] });
    for output in ["disparity-share", "disparity-px", "inverse-depth", "depth"] {
        let mut params = dark.clone();
        params["output"] = output.into();
        let (depth, warned) = depth_and_warnings("Sqrt", 4, params);
        let valid: Vec<bool> = depth.iter().map(|metres| metres.is_finite()).collect();
        assert_eq!(valid, [false, false, true, true].repeat(2), "{output}: {depth:?}");
        assert_eq!(warned, error(4), "{output}");
    }
    // Infinity is invalid, too: a standard deviation so small that the quotient overflows.
    let (depth, warned) = depth_and_warnings("Exp", 4, json!({ "std": [1e-3, 1e-3, 1e-3], "output": "depth" }));
    assert!(depth.iter().all(|metres| metres.is_nan()), "{depth:?}");
    assert_eq!(warned, error(8));
    // A network of two columns: the first is invalid, and contributes to the first three of the image.
    let (depth, warned) = depth_and_warnings("Sqrt", 2, dark.clone());
    let valid: Vec<bool> = depth.iter().map(|metres| metres.is_finite()).collect();
    assert_eq!((valid, warned), ([false, false, false, true].repeat(2), error(2)), "{depth:?}");
    // With a second opinion, what one of the two gave stands.
    let mut twice = dark;
    twice["flip"] = "mean".into();
    let (depth, warned) = depth_and_warnings("Sqrt", 4, twice);
    assert!(depth[2].is_finite() && depth[3].is_finite(), "{depth:?}");
    assert!(warned[0].0 >= 4, "{warned:?}");
    // No warning if all values are finite.
    assert_eq!(depth_and_warnings("Identity", 4, json!({})).1, Vec::new());
}

/// NumPy: `raw = [-.2, 0, .4, .6]; s, b = lstsq(c_[raw, ones(4)], 1 / t); z = s * raw + b; y = where(z > 0, 1 / z,
/// 80)`, then `mean(abs(y - t) / t)`. Of outputs raised to 1/80 it would be 0.432.
#[test]
fn inverse_depth_of_zero_and_below_is_aligned_as_the_network_gave_it() {
    if !can_run("inverse_depth_of_zero_and_below_is_aligned_as_the_network_gave_it") {
        return;
    }
    let network = mean(&[1, 3, 2, 4], &[1, 1, 2, 4]);
    let truth = [70.0, 30.0, 4.0, 2.0].repeat(2);
    let truth = Value::from(Depth { metres: Raster::from_raw(4, 2, truth).unwrap() });
    let abs_rel = |cap: Json, align: &str| {
        let params = json!({ "output": "inverse-depth", "mean": [0.4, 0.4, 0.4], "cap": cap });
        let inputs = [("image", image()), ("calibration", calibration(10.0, 2.0)), ("model", network.clone())];
        let depth = call("mono/onnx", &params, &inputs).unwrap().remove("depth").unwrap();
        let params = json!({ "align": align, "sets": ["all"] });
        let Value::Scores(rows) = value("score/depth", &params, &[("estimate", &depth), ("ground_truth", &truth)])
        else {
            panic!("scores")
        };
        rows[0].score("abs_rel").unwrap()
    };
    for cap in [json!(80), json!(null), json!(2)] {
        let found = abs_rel(cap, "scale-and-shift");
        assert!((found - 0.271_934_020_863_076_3).abs() < 1e-6, "{found}");
    }
    // Without an alignment they are as far as the cap.
    let far = [(80.0 - 70.0) / 70.0, (80.0 - 30.0) / 30.0, (4.0 - 2.5) / 4.0, (2.0 - 1.0 / 0.6) / 2.0];
    let found = abs_rel(json!(80), "none");
    assert!((found - far.iter().sum::<f64>() / 4.0).abs() < 1e-6, "{found}");
}

#[test]
fn a_disparity_in_pixels_grows_with_the_image() {
    if !can_run("a_disparity_in_pixels_grows_with_the_image") {
        return;
    }
    // Half the image's columns: a pixel of the network is two of the image.
    let network = mean(&[1, 3, 2, 2], &[1, 1, 2, 2]);
    let depth = run(&json!({ "output": "disparity-px", "cap": null }), &network).unwrap();
    // The mean of 51 and 102 is rounded to 76, half to even.
    assert!((depth[0] - 20.0 / (2.0 * 76.0 / 255.0)).abs() < 1e-3, "{}", depth[0]);
}

#[test]
fn an_open_size_is_filled_in_and_a_fixed_one_may_be_repeated() {
    if !can_run("an_open_size_is_filled_in_and_a_fixed_one_may_be_repeated") {
        return;
    }
    let open = mean(&[-1, 3, -1, -1], &[-1, 1, -1, -1]);
    assert_close(&run(&json!({ "size": [4, 2] }), &open).unwrap(), [25.0, 12.5, 6.25, 5.0]);
    let fixed = mean(&[1, 3, 2, 4], &[1, 1, 2, 4]);
    assert_close(&run(&json!({ "size": [4, 2] }), &fixed).unwrap(), [25.0, 12.5, 6.25, 5.0]);
}

#[test]
fn fault_43_an_open_size_may_be_a_multiple_and_the_image_padded() {
    if !can_run("fault_43_an_open_size_may_be_a_multiple_and_the_image_padded") {
        return;
    }
    let open = mean(&[-1, 3, -1, -1], &[-1, 1, -1, -1]);
    // The image is 4x2: with a multiple of 3 the network sees 6x3.
    let padded = json!({ "multiple": 3, "fit": "pad", "output": "depth", "output_scale": 10 });
    assert_close(&run(&padded, &open).unwrap(), [2.0, 4.0, 8.0, 10.0]);
    // Shares and pixels of what the network sees, 6 columns, are pixels of the image.
    let depth =
        |output: &str| run(&json!({ "multiple": 3, "fit": "pad", "output": output, "cap": null }), &open).unwrap();
    assert_close(&depth("disparity-px"), [100.0, 50.0, 25.0, 20.0]);
    assert_close(&depth("disparity-share"), [100.0 / 6.0, 50.0 / 6.0, 25.0 / 6.0, 20.0 / 6.0]);
    let resized = run(&json!({ "multiple": 4, "output": "depth", "output_scale": 10 }), &open).unwrap();
    assert!(resized.iter().all(|metres| (2.0..=10.0).contains(metres)) && resized[0] < resized[3], "{resized:?}");
    for flip in ["mean", "godard"] {
        let params = json!({ "multiple": 3, "fit": "pad", "output": "depth", "output_scale": 10, "flip": flip });
        assert_close(&run(&params, &open).unwrap(), [2.0, 4.0, 8.0, 10.0]);
    }
}

#[test]
fn fault_51_a_vector_is_not_used_as_a_map() {
    if !can_run("fault_51_a_vector_is_not_used_as_a_map") {
        return;
    }
    // Means over rows: 1x1x1x4, a vector.
    let input = [Tensor("image", F32, &[1, 1, 2, 4])];
    for output in [&[1, 1, 1, 4][..], &[-1, -1, -1, -1]] {
        let vector = model(onnx_file::model("ReduceMean", Some(2), &input, &Tensor("pose", F32, output)));
        let error = run(&json!({}), &vector).unwrap_err();
        assert!(error.contains("pose"), "{error}");
        assert!(run(&json!({ "output_name": "pose" }), &vector).unwrap_err().contains("not a map of an image of 4x2"));
    }
}

#[test]
fn fault_59_inputs_of_halves_are_fed() {
    if !can_run("fault_59_inputs_of_halves_are_fed") {
        return;
    }
    let kernel: [(&str, &[i64]); 1] = [("kernel_shape", &[1, 1])];
    let halves = Tensor("image", 10, &[1, 1, 2, 4]);
    let network = model(onnx_file::model_with("MaxPool", &kernel, &[halves], &Tensor("share", 10, &[1, 1, 2, 4])));
    let depth = run(&json!({ "output": "depth", "output_scale": 10 }), &network).unwrap();
    for (found, expected) in depth.iter().zip([2.0, 4.0, 8.0, 10.0]) {
        assert!((found - expected).abs() < 0.01, "{found} is not {expected}");
    }
}

#[test]
fn channels_may_come_last() {
    if !can_run("channels_may_come_last") {
        return;
    }
    let input = Tensor("image", F32, &[1, 2, 4, 3]);
    let network = model(onnx_file::model("ReduceMean", Some(3), &[input], &Tensor("share", F32, &[1, 2, 4, 1])));
    assert_close(&run(&json!({ "layout": "nhwc" }), &network).unwrap(), [25.0, 12.5, 6.25, 5.0]);
}

#[test]
fn parallel_frames_have_separate_sessions_and_equal_results() {
    if !can_run("parallel_frames_have_separate_sessions_and_equal_results") {
        return;
    }
    use depthloom_graphs::contracts::InlineHost;
    use depthloom_graphs::{Context, Inputs, Instance, Scratch};
    let registry = depthloom_nodes::registry();
    let kind = registry.node_kind("mono/onnx").unwrap();
    let Instance::Pure(node) = kind.build(&kind.resolve(&json!({})).unwrap()).unwrap() else { panic!("pure") };
    let inputs = [Some(image()), Some(calibration(10.0, 2.0)), Some(mean(&[1, 3, 2, 4], &[1, 1, 2, 4]))];
    let process = || {
        let inputs = Inputs::new(&kind.declaration.inputs, &inputs);
        let outputs = node.process(&inputs, &mut Context::new(&InlineHost, &mut Scratch::default())).unwrap();
        let value = outputs.in_order_of(&kind.declaration.outputs).unwrap().remove(0).unwrap();
        metres(&value).to_vec()
    };
    let expected = process();
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..4).map(|_| scope.spawn(|| (0..20).all(|_| process() == expected))).collect();
        assert!(workers.into_iter().all(|worker| worker.join().unwrap()));
    });
}

#[test]
fn networks_that_do_not_output_depth_are_refused_with_a_remedy() {
    if !can_run("networks_that_do_not_output_depth_are_refused_with_a_remedy") {
        return;
    }
    let good = mean(&[1, 3, 2, 4], &[1, 1, 2, 4]);
    let one = |op, axes, input: &Tensor<'_>, output: &Tensor<'_>| {
        let Tensor(name, ty, shape) = *input;
        model(onnx_file::model(op, axes, &[Tensor(name, ty, shape)], output))
    };
    let rgb = Tensor("image", F32, &[1, 3, 2, 4]);
    let two = [Tensor("image", F32, &[1, 3, 2, 4]), Tensor("pose", F32, &[1, 6])];
    let broken: Vec<(&str, Value, Json)> = vec![
        ("wrong input name", good.clone(), json!({ "input_name": "rgb" })),
        ("wrong output name", good.clone(), json!({ "output_name": "depth" })),
        ("wrong layout", good.clone(), json!({ "layout": "nhwc" })),
        ("wrong size", good, json!({ "size": [320, 96] })),
        ("open size", mean(&[1, 3, -1, -1], &[1, 1, -1, -1]), json!({})),
        ("wrong rank", one("Identity", None, &Tensor("x", F32, &[3, 4]), &Tensor("y", F32, &[3, 4])), json!({})),
        (
            "wrong channels",
            one("Identity", None, &Tensor("x", F32, &[1, 4, 2, 4]), &Tensor("y", F32, &[1, 4, 2, 4])),
            json!({}),
        ),
        ("wrong batch", mean(&[8, 3, 2, 4], &[8, 1, 2, 4]), json!({})),
        (
            "wrong type",
            one("Identity", None, &Tensor("x", U8, &[1, 3, 2, 4]), &Tensor("y", U8, &[1, 3, 2, 4])),
            json!({}),
        ),
        ("two inputs", model(onnx_file::model("Identity", None, &two, &Tensor("y", F32, &[1, 3, 2, 4]))), json!({})),
        ("several maps", one("Identity", None, &rgb, &Tensor("y", F32, &[1, 3, 2, 4])), json!({})),
        ("output of whole numbers", one("Shape", None, &rgb, &Tensor("y", 7, &[4])), json!({})),
    ];
    let mut error = String::new();
    for (name, network, params) in broken {
        error += &format!("{name}\n  {}\n", run(&params, &network).unwrap_err());
    }
    insta::assert_snapshot!(error);
}

#[test]
fn a_file_that_is_not_a_model_is_reported() {
    if !can_run("a_file_that_is_not_a_model_is_reported") {
        return;
    }
    let error = run(&json!({}), &model(b"<html>404</html>".to_vec())).unwrap_err();
    let title = onnx::find().unwrap().title();
    assert!(error.starts_with(&format!("the 16 bytes of the model cannot be loaded by {title}")), "{error}");
    assert!(error.contains("remedy: `model` expects an ONNX file, or the output of a learning stage"), "{error}");
}

#[test]
fn a_model_cut_short_or_spoilt_ends_no_process() {
    if !can_run("a_model_cut_short_or_spoilt_ends_no_process") {
        return;
    }
    let input = [Tensor("image", F32, &[1, 3, 2, 4])];
    let whole = onnx_file::model("ReduceMean", Some(1), &input, &Tensor("share", F32, &[1, 1, 2, 4]));
    assert!(run(&json!({}), &model(whole.clone())).is_ok());
    let half = run(&json!({}), &model(whole[..whole.len() / 2].to_vec())).unwrap_err();
    assert!(half.contains("bytes of the model cannot be loaded by"), "{half}");
    // A byte may say something else that is right, or not: no answer is expected, only that there is one.
    for at in 0..whole.len() {
        let mut spoilt = whole.clone();
        spoilt[at] ^= 0x15;
        let _ = run(&json!({}), &model(spoilt));
        let _ = run(&json!({}), &model(whole[..at].to_vec()));
    }
}

#[test]
fn the_mirror_image_counts_as_much_whatever_batch_the_model_has() {
    if !can_run("the_mirror_image_counts_as_much_whatever_batch_the_model_has") {
        return;
    }
    // The larger of a pixel and its left neighbour; of the mirror image, mirrored back, and its right one.
    let attributes: [(&str, &[i64]); 2] = [("kernel_shape", &[1, 2]), ("pads", &[0, 1, 0, 0])];
    for batch in [1, 2, -1] {
        let input = [Tensor("image", F32, &[batch, 1, 2, 4])];
        let output = Tensor("share", F32, &[batch, 1, 2, 4]);
        let network = model(onnx_file::model_with("MaxPool", &attributes, &input, &output));
        let run = |flip| run(&json!({ "output": "depth", "output_scale": 10, "flip": flip }), &network);
        assert_close(&run("mean").unwrap(), [3.0, 6.0, 9.0, 10.0]);
        assert_close(&run("godard").unwrap(), [4.0, 6.0, 9.0, 10.0]);
        match run("none") {
            Ok(alone) => assert_close(&alone, [2.0, 4.0, 8.0, 10.0]),
            Err(error) => assert!(batch == 2 && error.contains("(or 2, with `flip`)"), "{error}"),
        }
    }
}

#[test]
fn a_provider_that_is_not_there_is_an_error_and_never_the_processor() {
    if !can_run("a_provider_that_is_not_there_is_an_error_and_never_the_processor") {
        return;
    }
    let engine = onnx::find().unwrap();
    for provider in Provider::ALL.into_iter().filter(|provider| !engine.providers().contains(provider)) {
        let name = provider.name();
        let error = run(&json!({ "provider": name }), &mean(&[1, 3, 2, 4], &[1, 1, 2, 4])).unwrap_err();
        assert!(error.starts_with(&engine.title()), "{error}");
        assert!(error.contains(&format!(" has no provider `{name}`; it has cpu")), "{error}");
        assert!(error.contains("or use `provider: cpu`"), "{error}");
        assert_ne!(engine.fingerprint(provider), engine.fingerprint(Provider::Cpu));
    }
    assert!(!engine.used().iter().any(|used| !engine.providers().contains(used)));
}

#[test]
fn threads_do_not_change_a_bit() {
    if !can_run("threads_do_not_change_a_bit") {
        return;
    }
    let Some(shared) = shared("threads_do_not_change_a_bit") else { return };
    let network = model(std::fs::read(shared.join("models/ssl_unet.onnx")).unwrap());
    let depth = |threads| {
        let inputs = [("image", &image()), ("calibration", &calibration(10.0, 2.0)), ("model", &network)];
        metres(&value("mono/onnx", &json!({ "threads": threads }), &inputs)).to_vec()
    };
    assert_eq!(depth(1), depth(2));
}

/// The network's own answer, unscaled, to a real frame.
fn share(shared: &Path) -> Vec<f32> {
    let root = shared.join("data/kitti_stereo_2015");
    let source = open("kitti/stereo2015", &json!({ "root": root, "frames": [150] })).unwrap();
    let left = source.read(FrameIndex(0)).unwrap().0.remove("left").unwrap();
    let network = model(std::fs::read(shared.join("models/ssl_unet.onnx")).unwrap());
    let inputs = [("image", &left), ("calibration", &calibration(721.5377, 0.532_725)), ("model", &network)];
    metres(&value("mono/onnx", &json!({ "output": "depth", "cap": null }), &inputs)).to_vec()
}

/// This test program again, its networks in another engine: a process has one.
#[cfg(feature = "tract")]
fn again_in(engine: &str, arguments: &[&str], answer: &Path) -> Command {
    let mut program = Command::new(std::env::current_exe().unwrap());
    program.args(arguments).env(onnx::VARIABLE, engine).env(ANSWER, answer);
    program
}

const ANSWER: &str = "DEPTHLOOM_TEST_ANSWER";

#[test]
#[ignore = "a part of tract_equals_onnx_runtime"]
fn answer_into_a_file() {
    let (Some(file), Some(shared)) = (std::env::var_os(ANSWER), shared("answer_into_a_file")) else {
        return;
    };
    let bytes: Vec<u8> = share(&shared).into_iter().flat_map(f32::to_le_bytes).collect();
    std::fs::write(file, bytes).unwrap();
}

#[test]
#[cfg(feature = "tract")]
fn tract_equals_onnx_runtime() {
    const TEST: &str = "tract_equals_onnx_runtime";
    let (Some(_), Some(library)) = (shared(TEST), onnx_runtime(TEST)) else { return };
    let folder = tempfile::tempdir().unwrap();
    let answer = |engine: &str, library: Option<&Path>| {
        let answer = folder.path().join(engine);
        let mut program = again_in(engine, &["--exact", "network::answer_into_a_file", "--ignored"], &answer);
        let output = program.env_remove("ORT_DYLIB_PATH").envs(library.map(|path| ("ORT_DYLIB_PATH", path))).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{output:?}");
        let bytes = std::fs::read(answer).unwrap();
        bytes.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)).collect::<Vec<f32>>()
    };
    let (tract, runtime) = (answer("tract", None), answer("onnxruntime", Some(&library)));
    assert!(!tract.is_empty() && tract.iter().chain(&runtime).all(|share| share.is_finite()));
    assert_eq!(tract.len(), runtime.len());
    let off = |(a, b): (&f32, &f32)| f64::from((a - b).abs() / b.abs());
    let worst = tract.iter().zip(&runtime).map(off).fold(0.0, f64::max);
    println!("tract and ONNX Runtime differ by at most {worst:.1e}");
    assert!(worst < 1e-4, "tract and ONNX Runtime differ by {worst}");
}

#[test]
#[cfg(feature = "tract")]
fn all_of_this_holds_in_tract() {
    if std::env::var_os(ANSWER).is_some() {
        return;
    }
    let output = again_in("tract", &["network::", "--test-threads", "1"], Path::new("")).output().unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{stdout}{}", String::from_utf8_lossy(&output.stderr));
    let tests =
        ["networks_that_do_not_output_depth_are_refused_with_a_remedy", "every_meaning_of_the_output_becomes_metres"];
    assert!(tests.iter().all(|test| stdout.contains(&format!("test network::{test} ... ok"))), "{stdout}");
}

/// A network that returns its input of one channel, whatever its size.
fn same() -> Value {
    let side = [1, 1, -1, -1];
    model(onnx_file::model("Identity", None, &[Tensor("image", F32, &side)], &Tensor("map", F32, &side)))
}

#[test]
fn relative_inverse_depth_is_a_value_of_its_own_type() {
    if !can_run("relative_inverse_depth_is_a_value_of_its_own_type") {
        return;
    }
    let network = mean(&[1, 3, 2, 4], &[1, 1, 2, 4]);
    // Without a calibration, without a cap; negative numbers stay.
    let params = json!({ "output": "relative-inverse-depth", "output_scale": 10, "mean": [0.5, 0.5, 0.5] });
    let inputs = [("image", image()), ("model", network)];
    let values = call("mono/onnx", &params, &inputs).unwrap();
    assert_eq!(values.keys().collect::<Vec<_>>(), [&"inverse"]);
    let Value::RelativeInverseDepth(map) = &values["inverse"] else { panic!("inverse") };
    for (found, expected) in map.values.iter().zip([-3.0, -1.0, 3.0, 5.0].repeat(2)) {
        assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
    }
    assert!(values["inverse"].metres().is_none() && values["inverse"].depth_estimate().is_none());
}

#[test]
fn an_image_is_resized_to_the_length_of_a_side() {
    if !can_run("an_image_is_resized_to_the_length_of_a_side") {
        return;
    }
    let seen = |side: Json| {
        let mut params = side;
        (params["output"], params["resize"], params["round"]) = (json!("depth"), json!("bicubic"), json!(false));
        run(&params, &same())
    };
    // OpenCV: `INTER_CUBIC` to 8x4 or 12x6, `INTER_LINEAR` back.
    let twice = [0.205_078, 0.408_594, 0.791_406, 0.994_922];
    let thrice = [0.2, 0.4, 0.8, 1.0];
    for (side, expected) in [
        (json!({ "short_side": 4 }), twice),
        (json!({ "long_side": 8, "multiple": 4 }), twice),
        (json!({ "short_side": 5, "multiple": 6 }), thrice),
    ] {
        assert_close(&seen(side).unwrap(), expected);
    }
}

#[test]
fn sides_and_normalisations_that_exclude_others_are_refused() {
    if !can_run("sides_and_normalisations_that_exclude_others_are_refused") {
        return;
    }
    for (params, what) in [
        (json!({ "short_side": 4, "long_side": 8 }), "short_side cannot be combined with `long_side`"),
        (json!({ "long_side": 8, "size": [4, 2] }), "long_side cannot be combined with `size`"),
        (json!({ "short_side": 4, "fit": "pad" }), "short_side cannot be combined with `fit: pad`"),
        (json!({ "normalisation": "half", "mean": [0.5, 0.5, 0.5] }), "normalisation replaces `mean` and `std`"),
    ] {
        let error = run(&params, &same()).unwrap_err();
        assert!(error.contains(what), "{error}");
    }
    let error = run(&json!({ "short_side": 4 }), &mean(&[1, 3, 2, 4], &[1, 1, 2, 4])).unwrap_err();
    assert!(error.contains("the network fixes the size of its image") && error.contains("1x3x2x4"), "{error}");
}

#[test]
fn known_normalisations_are_their_means_and_deviations() {
    if !can_run("known_normalisations_are_their_means_and_deviations") {
        return;
    }
    let network = mean(&[1, 3, 2, 4], &[1, 1, 2, 4]);
    let run = |params: Json| {
        let mut params = params;
        params["output"] = "relative-inverse-depth".into();
        let inputs = [("image", image()), ("model", network.clone())];
        let values = call("mono/onnx", &params, &inputs).unwrap();
        let Value::RelativeInverseDepth(map) = &values["inverse"] else { panic!("inverse") };
        map.values.to_vec()
    };
    let imagenet = run(json!({ "mean": [0.485, 0.456, 0.406], "std": [0.229, 0.224, 0.225] }));
    assert_eq!(run(json!({ "normalisation": "imagenet" })), imagenet);
    let reversed = run(json!({ "channels": "bgr", "mean": [0.406, 0.456, 0.485], "std": [0.225, 0.224, 0.229] }));
    assert_eq!(run(json!({ "channels": "bgr", "normalisation": "imagenet" })), reversed);
    let half = run(json!({ "normalisation": "half" }));
    assert!(
        half.iter().zip([-0.6, -0.2, 0.6, 1.0].repeat(2)).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-6),
        "{half:?}"
    );
}
