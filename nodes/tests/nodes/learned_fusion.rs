//! `fusion/learned` with a network that returns three of its planes.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Depth, Disparity, Image, Pixels, Raster, Weight};
use depthloom_onnx::{
    Dimension, DimensionProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto,
    TensorProto, TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto, data_type,
};
use image::{Luma, Rgb, RgbImage};
use prost::Message;
use serde_json::json;

use crate::call::{call, metres, model};
use crate::steps::calibration;

/// A network of `width` x `height` whose maps are its planes from `first` on.
pub(crate) fn network(planes: i64, first: i64, (width, height): (i64, i64), meaning: &str) -> Vec<u8> {
    let tensor = |name: &str, channels: i64| {
        let sides = [1, channels, height, width];
        let dim = sides.iter().map(|&side| DimensionProto { value: Some(Dimension::Value(side)) }).collect();
        let tensor_type = TensorTypeProto { elem_type: data_type::FLOAT, shape: Some(TensorShapeProto { dim }) };
        ValueInfoProto { name: name.to_owned(), r#type: Some(TypeProto { tensor_type: Some(tensor_type) }) }
    };
    let number = |name: &str, value: i64| TensorProto {
        name: name.to_owned(),
        dims: vec![1],
        data_type: data_type::INT64,
        raw_data: Some(value.to_le_bytes().to_vec()),
        ..TensorProto::default()
    };
    let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    let slice = NodeProto {
        input: names(&["planes", "first", "end", "axis"]),
        output: names(&["fusion"]),
        op_type: "Slice".to_owned(),
        ..NodeProto::default()
    };
    let graph = GraphProto {
        node: vec![slice],
        name: "slice".to_owned(),
        initializer: vec![number("first", first), number("end", first + 3), number("axis", 1)],
        input: vec![tensor("planes", planes)],
        output: vec![tensor("fusion", 3)],
        value_info: Vec::new(),
    };
    let metadata = StringStringEntryProto { key: "depthloom.output".to_owned(), value: meaning.to_owned() };
    let model = ModelProto {
        ir_version: 8,
        graph: Some(graph),
        opset_import: vec![OperatorSetIdProto { domain: String::new(), version: 13 }],
        metadata_props: vec![metadata],
        ..ModelProto::default()
    };
    model.encode_to_vec()
}

/// A frame of 32 x 16 on which every map is constant: `f B` is 32 px m, so a share of the width is 1 / depth.
fn frame(disparity_px: i16, mono_m: f32, network: Vec<u8>) -> Vec<(&'static str, Value)> {
    let (width, height) = (32, 16);
    let disparity = |px: i16| -> Value {
        let sixteenths_px = Raster::from_pixel(width, height, Luma([px * 16]));
        Disparity { sixteenths_px, min_disparity_px: 0 }.into()
    };
    vec![
        ("image", Image::new(Pixels::Rgb(RgbImage::from_pixel(width, height, Rgb([51, 153, 102])))).into()),
        ("disparity", disparity(disparity_px)),
        ("consistent", disparity(disparity_px)),
        ("mono", Depth { metres: Raster::from_pixel(width, height, Luma([mono_m])) }.into()),
        ("weight", Weight { share: Raster::from_pixel(width, height, Luma([0.75])) }.into()),
        ("calibration", calibration(64.0, 0.5)),
        ("model", model(network)),
    ]
}

fn has_engine(test: &str) -> bool {
    depthloom_nodes::onnx::find().map_err(|fault| depthloom_test_needs::skipped(test, &fault.chain())).is_ok()
}

#[test]
fn the_result_follows_from_the_planes_and_the_formula() {
    if !has_engine("the_result_follows_from_the_planes_and_the_formula") {
        return;
    }
    // Stereo is at 10.67 m, mono at 16 m.
    let (stereo, mono) = ((32.0_f64 / 3.0).ln(), 16.0_f64.ln());
    let apart = mono - stereo;
    let of_mono = (4.0 - mono) / 2.0;
    let cases = [(0, [0.2, 0.6, 0.4]), (3, [apart, 1.0, of_mono]), (5, [of_mono, 1.0, 0.75])];
    for (first, [gate, residual, spread]) in cases {
        let found = call("fusion/learned", &json!({}), &frame(3, 16.0, network(8, first, (8, 4), "fusion"))).unwrap();
        let corrected = mono - (2.0 * residual - 1.0);
        let expected = (gate * stereo + (1.0 - gate) * corrected).exp();
        let deviation = 2.0_f64.sqrt() * (0.01_f64.ln() * (1.0 - spread)).exp() * expected;
        for (port, expected) in [("depth", expected), ("deviation", deviation)] {
            for &found in metres(&found[port]) {
                let off = (f64::from(found) / expected - 1.0).abs();
                assert!(off < 1e-4, "planes from {first}: {port} is {found}, expected {expected}");
            }
        }
    }
    // Without stereo, the corrected monocular estimate.
    let found =
        call("fusion/learned", &json!({ "cap": 9.0 }), &frame(-1, 10.0, network(8, 0, (8, 4), "fusion"))).unwrap();
    assert!(metres(&found["depth"]).iter().all(|&m| (f64::from(m) / (10.0_f64.ln() - 0.2).exp() - 1.0).abs() < 1e-4));
    let found =
        call("fusion/learned", &json!({ "cap": 7.0 }), &frame(-1, 10.0, network(8, 0, (8, 4), "fusion"))).unwrap();
    assert!(metres(&found["depth"]).iter().all(|&m| m == 7.0));
}

#[test]
fn other_networks_and_small_images_are_refused() {
    if !has_engine("other_networks_and_small_images_are_refused") {
        return;
    }
    let message = |network: Vec<u8>| match call("fusion/learned", &json!({}), &frame(3, 16.0, network)) {
        Ok(_) => panic!("it must be refused"),
        Err(fault) => fault.chain(),
    };
    assert!(message(network(8, 0, (8, 4), "depth")).contains("the network computes `depth`, expected `fusion`"));
    assert!(message(network(6, 0, (8, 4), "fusion")).contains("has the shape 1x6x4x8, expected 1x8xHxW"));
    let small = message(network(8, 0, (64, 32), "fusion"));
    assert!(small.contains("the network takes images of 64x32, and these are 32x16"), "{small}");
}
