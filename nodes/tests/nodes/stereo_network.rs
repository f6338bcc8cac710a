//! `stereo/onnx` and `onnx` on networks whose answers NumPy gives as well (`tests/fixtures/networks.py`).

use std::path::PathBuf;
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Depth, Raster, Weight};
use depthloom_nodes::onnx;
#[cfg(feature = "tract")]
use depthloom_test_needs::onnx_runtime;
use depthloom_test_needs::{skipped, workspace};
use serde_json::{Value as Json, json};

use crate::call::{call, metres, model};

const WIDTH: u32 = 157;
const HEIGHT: u32 = 75;

fn fixture(file: &str) -> PathBuf {
    workspace().join("tests/fixtures/networks").join(file)
}

fn golden(file: &str) -> Vec<f32> {
    let bytes = std::fs::read(fixture(file)).unwrap();
    let values: Vec<f32> = bytes.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)).collect();
    assert_eq!(values.len(), (WIDTH * HEIGHT) as usize);
    values
}

fn image(file: &str) -> Value {
    let image = image::open(fixture(file)).unwrap().into_rgb8();
    depthloom_graphs::values::Image::new(depthloom_graphs::values::Pixels::Rgb(image)).into()
}

fn network(file: &str) -> Value {
    model(std::fs::read(fixture(file)).unwrap())
}

const FOCAL_PX: f64 = 300.0;
const BASELINE_M: f64 = 0.5;
const DOFFS_PX: f64 = 2.0;

fn calibration() -> Value {
    Calibration {
        width: WIDTH,
        height: HEIGHT,
        focal_px: FOCAL_PX,
        cx_px: 78.0,
        cy_px: 37.0,
        baseline_m: BASELINE_M,
        doffs_px: DOFFS_PX,
    }
    .into()
}

fn raster(values: Vec<f32>) -> Raster<f32> {
    Raster::from_raw(WIDTH, HEIGHT, values).unwrap()
}

fn error_text(fault: &depthloom_graphs::Fault) -> String {
    fault.remedy_text().map_or_else(|| fault.chain(), |remedy| format!("{}\n  remedy: {remedy}", fault.chain()))
}

fn stereo(file: &str, params: &Json) -> Result<crate::call::Values, String> {
    let inputs = [
        ("left", image("left.png")),
        ("right", image("right.png")),
        ("calibration", calibration()),
        ("model", network(file)),
    ];
    call("stereo/onnx", params, &inputs).map_err(|fault| error_text(&fault))
}

/// Whether this machine can run networks; says that the test is skipped where it cannot.
fn can_run(test: &str) -> bool {
    onnx::find().map_err(|fault| skipped(test, &fault.chain())).is_ok()
}

fn disparity(value: &Value) -> Raster<f32> {
    value.disparity_px().unwrap_or_else(|| panic!("{value:?} is not a disparity"))
}

/// The largest difference to what NumPy gives.
fn worst(found: impl Iterator<Item = f64>, expected: &[f32]) -> f64 {
    found.zip(expected).map(|(found, &expected)| (found - f64::from(expected)).abs()).fold(0.0, f64::max)
}

/// The disparities of depths that were not capped.
fn px_of(depth: &Value) -> impl Iterator<Item = f64> {
    metres(depth).iter().map(|&metres| FOCAL_PX * BASELINE_M / f64::from(metres) - DOFFS_PX)
}

#[test]
fn a_stereo_network_equals_numpy_at_a_size_that_is_not_a_multiple_of_its_stride() {
    if !can_run("a_stereo_network_equals_numpy_at_a_size_that_is_not_a_multiple_of_its_stride") {
        return;
    }
    let (left, right) = (golden("disparity.f32"), golden("disparity_right.f32"));
    for file in ["shifts.onnx", "torch.onnx"] {
        let values = stereo(file, &json!({ "multiple": 4, "cap": null, "right_view": true })).unwrap();
        let off = worst(px_of(&values["depth"]), &left);
        println!("{file}: {off:.1e} px from NumPy");
        assert!(off < 1e-4, "{file}: {off} px from NumPy");
        let own = disparity(&values["disparity"]);
        assert_eq!(own.dimensions(), (WIDTH, HEIGHT));
        // Not rounded to 1/16 px.
        assert!(worst(own.iter().map(|&px| f64::from(px)), &left) < 1e-4);
        let mirrored = disparity(&values["disparity_right"]);
        assert!(worst(mirrored.iter().map(|&px| -f64::from(px)), &right) < 1e-4);
    }
}

#[test]
fn padding_can_be_chosen() {
    if !can_run("padding_can_be_chosen") {
        return;
    }
    let px = |params: Json| px_of(&stereo("shifts.onnx", &params).unwrap()["depth"]).collect::<Vec<f64>>();
    let usual = px(json!({ "multiple": 4, "cap": null }));
    for other in [json!({ "pad_at": "top-left" }), json!({ "pad_with": "zero" }), json!({ "size": [192, 96] })] {
        let mut params = json!({ "multiple": 4, "cap": null });
        params.as_object_mut().unwrap().extend(other.as_object().unwrap().clone());
        let other = px(params);
        assert_eq!(other.len(), usual.len());
        assert_ne!(other, usual);
    }
}

#[test]
fn one_input_of_both_images_in_halves_with_heads_is_a_stereo_network_as_well() {
    if !can_run("one_input_of_both_images_in_halves_with_heads_is_a_stereo_network_as_well") {
        return;
    }
    let params = json!({
        "order": "right-left", "fit": "resize", "head": -1, "output": "disparity-share", "output_scale": -1, "cap": null,
    });
    let values = stereo("pair.onnx", &params).unwrap();
    let off = worst(px_of(&values["depth"]), &golden("resized.f32"));
    println!("pair.onnx: {off:.1e} px from NumPy");
    // Both resize in f32 and round to halves: where they round apart, a share of 1e-3 of a pixel is decided.
    assert!(off < 2e-2, "{off} px from NumPy");
    // The first head is half the second.
    let mut half = params.clone();
    half["head"] = json!(0);
    half["output_scale"] = json!(-2);
    let half = stereo("pair.onnx", &half).unwrap();
    let (half, whole) = (disparity(&half["disparity"]), disparity(&values["disparity"]));
    let alike = |(a, b): (&f32, &f32)| (a.is_nan() && b.is_nan()) || (a - b).abs() < 1e-2;
    assert!(half.iter().zip(whole.iter()).all(alike));
    let error = stereo("pair.onnx", &json!({ "fit": "resize" })).unwrap_err();
    assert!(error.contains("which is 2 maps for one image") && error.contains("`head`"), "{error}");
    let error = stereo("pair.onnx", &json!({ "head": 1, "size": [160, 96] })).unwrap_err();
    assert!(error.contains("`size` has 96 rows, and input `both` of the network takes 80"), "{error}");
}

#[test]
fn ports_follow_from_the_parameters() {
    let registry = depthloom_nodes::registry();
    let kind = registry.node_kind("stereo/onnx").unwrap();
    let ports = |params: &Json| {
        let signature = kind.signature(&kind.resolve(params).unwrap()).unwrap();
        let names = |ports: &[depthloom_graphs::Port]| ports.iter().map(|port| port.name).collect::<Vec<_>>();
        (names(&signature.inputs), names(&signature.outputs))
    };
    let pair = vec!["left", "right", "model"];
    assert_eq!(ports(&json!({ "depth": false })), (pair.clone(), vec!["disparity"]));
    let with = [&pair[..], &["calibration"]].concat();
    assert_eq!(ports(&json!({ "depth": false, "output": "depth" })), (with.clone(), vec!["disparity"]));
    assert_eq!(ports(&json!({ "right_view": true })), (with, vec!["disparity", "depth", "disparity_right"]));
}

#[test]
fn networks_that_are_not_stereo_networks_are_refused_with_a_remedy() {
    if !can_run("networks_that_are_not_stereo_networks_are_refused_with_a_remedy") {
        return;
    }
    let error = stereo("fusion.onnx", &json!({})).unwrap_err();
    assert!(error.contains("the network has the inputs mono, stereo, weight") && error.contains("`onnx`"), "{error}");
    let error = stereo("shifts.onnx", &json!({ "layout": "nhwc" })).unwrap_err();
    assert!(error.contains("(layout: nhwc)") && error.contains("`layout` is nchw or nhwc"), "{error}");
    let error = stereo("shifts.onnx", &json!({ "left_name": "left", "right_name": "rihgt" })).unwrap_err();
    assert!(error.contains("no input `rihgt`; it has left, right"), "{error}");
    let error = stereo("pair.onnx", &json!({ "size": null, "head": 0, "right_view": true, "order": "left-right" }));
    assert!(error.is_ok(), "both views in two runs: {error:?}");
}

fn depth_of(values: Vec<f32>) -> Value {
    Depth { metres: raster(values) }.into()
}

#[test]
fn networks_for_confidence_and_fusion_run_with_declared_ports() {
    if !can_run("networks_for_confidence_and_fusion_run_with_declared_ports") {
        return;
    }
    let depth = depth_of(golden("depth.f32"));
    let params = json!({ "multiple": 8, "ports": {
        "inputs": {
            "image": { "type": "image", "name": "rgb", "layout": "nhwc" },
            "depth": { "type": "depth", "name": "inverse", "form": "inverse", "scale": 10 },
        },
        "outputs": { "weight": { "type": "weight" } },
    } });
    let inputs = [("image", image("left.png")), ("depth", depth.clone()), ("model", network("confidence.onnx"))];
    let weight = call("onnx", &params, &inputs).map_err(|fault| error_text(&fault)).unwrap();
    let Value::Weight(found) = &weight["weight"] else { panic!("a weight") };
    let off = worst(found.share.iter().map(|&share| f64::from(share)), &golden("weight.f32"));
    assert!(off < 1e-5, "{off} from NumPy's weights");

    let params = json!({ "multiple": 1, "ports": {
        "inputs": { "mono": { "type": "depth" }, "stereo": { "type": "depth", "missing": 0 }, "weight": { "type": "weight" } },
        "outputs": { "depth": { "type": "depth" } },
    } });
    let weight: Value = Weight { share: raster(golden("weight.f32")) }.into();
    let mono = depth_of(vec![20.0; (WIDTH * HEIGHT) as usize]);
    let inputs =
        [("mono", mono.clone()), ("stereo", depth.clone()), ("weight", weight), ("model", network("fusion.onnx"))];
    let fused = call("onnx", &params, &inputs).map_err(|fault| error_text(&fault)).unwrap();
    let off = worst(metres(&fused["depth"]).iter().map(|&metres| f64::from(metres)), &golden("fused.f32"));
    assert!(off < 1e-4, "{off} m from NumPy's fusion");

    let without = json!({ "ports": {
        "inputs": { "mono": { "type": "depth" }, "stereo": { "type": "depth" } },
        "outputs": { "depth": { "type": "depth" } },
    } });
    let inputs = [("mono", mono), ("stereo", depth), ("model", network("fusion.onnx"))];
    let error = call("onnx", &without, &inputs).map_err(|fault| error_text(&fault)).unwrap_err();
    assert!(error.contains("no port feeds input `weight` of the network"), "{error}");
}

/// This test program again, its networks in another engine: a process has one.
#[test]
#[cfg(feature = "tract")]
fn all_of_it_holds_in_tract_and_in_onnx_runtime() {
    const AGAIN: &str = "DEPTHLOOM_TEST_AGAIN";
    if std::env::var_os(AGAIN).is_some() {
        return;
    }
    let library = onnx_runtime("all_of_it_holds_in_tract_and_in_onnx_runtime");
    let engines = [("tract", None)].into_iter().chain(library.map(|library| ("onnxruntime", Some(library))));
    for (engine, library) in engines {
        let mut program = Command::new(std::env::current_exe().unwrap());
        program
            .args(["stereo_network::", "--test-threads", "1", "--nocapture"])
            .env(AGAIN, "1")
            .env(onnx::VARIABLE, engine);
        let output = program.env_remove("ORT_DYLIB_PATH").envs(library.map(|path| ("ORT_DYLIB_PATH", path))).output();
        let output = output.unwrap();
        let stdout = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{engine}: {stdout}{}", String::from_utf8_lossy(&output.stderr));
        assert!(stdout.contains("shifts.onnx: ") && stdout.contains("pair.onnx: "), "{engine} ran nothing: {stdout}");
        for line in stdout.lines().filter(|line| line.contains("from NumPy")) {
            println!("{engine}: {line}");
        }
    }
}
