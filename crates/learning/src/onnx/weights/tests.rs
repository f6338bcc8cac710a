//! Weights from bytes laid out by hand after the published formats, from our own files, and from damaged ones.

use std::error::Error;
use std::path::Path;

use proptest::collection::vec;
use proptest::prelude::*;
use prost::Message;

use super::{NamedTensor, TensorError, WeightsError, decode_weights};
use crate::networks::{Monocular, Network, Size, export, layout};
use depthloom_onnx::{GraphProto, ModelProto, NodeProto, TensorProto, data_type};

/// A `.safetensors` file: the header's length in 8 bytes, the header, the elements.
fn safetensors(header: &str, data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

fn onnx(initializer: Vec<TensorProto>) -> Vec<u8> {
    let node = vec![NodeProto { op_type: "Relu".to_owned(), ..NodeProto::default() }];
    let graph = GraphProto { node, initializer, ..GraphProto::default() };
    ModelProto { graph: Some(graph), ..ModelProto::default() }.encode_to_vec()
}

fn named(name: &str, dims: &[usize], values: &[f32]) -> NamedTensor {
    NamedTensor { name: name.to_owned(), dims: dims.to_vec(), values: values.to_vec() }
}

fn tensor(name: &str, kind: i32, dims: &[i64]) -> TensorProto {
    TensorProto { name: name.to_owned(), data_type: kind, dims: dims.to_vec(), ..TensorProto::default() }
}

fn of_safetensors(bytes: &[u8]) -> Result<Vec<NamedTensor>, WeightsError> {
    decode_weights(Path::new("net.safetensors"), bytes)
}

fn of_onnx(bytes: &[u8]) -> Result<Vec<NamedTensor>, WeightsError> {
    decode_weights(Path::new("net.onnx"), bytes)
}

/// An error and what it comes from, in one line.
fn message(error: &WeightsError) -> String {
    let (mut line, mut cause) = (error.to_string(), error.source());
    while let Some(error) = cause {
        line = format!("{line}: {error}");
        cause = error.source();
    }
    line
}

#[test]
fn safetensors_come_in_the_order_of_their_bytes() {
    let header = r#"{"__metadata__":{"format":"pt"},"b":{"dtype":"F16","shape":[2],"data_offsets":[8,12]},
        "a":{"dtype":"F32","shape":[1,2],"data_offsets":[0,8]},"n":{"dtype":"I64","shape":[],"data_offsets":[12,20]},
        "z":{"dtype":"F32","shape":[0],"data_offsets":[20,20]},"y":{"dtype":"F32","shape":[0],"data_offsets":[20,20]},
        "d":{"dtype":"F64","shape":[],"data_offsets":[20,28]},"c":{"dtype":"BF16","shape":[1],"data_offsets":[28,30]}}"#;
    let mut data = Vec::new();
    data.extend_from_slice(&[0, 0, 0x80, 0x3f, 0, 0, 0x20, 0xc0]); // 1.0 and -2.5 in IEEE single
    data.extend_from_slice(&[0x00, 0x3c, 0x00, 0xc1]); // 1.0 and -2.5 in IEEE half
    data.extend_from_slice(&7_i64.to_le_bytes());
    data.extend_from_slice(&[0, 0, 0, 0, 0, 0, 0xd0, 0x3f]); // 0.25 in IEEE double
    data.extend_from_slice(&[0x40, 0x3f]); // 0.75 in bfloat16
    let expected = [
        named("a", &[1, 2], &[1.0, -2.5]),
        named("b", &[2], &[1.0, -2.5]),
        named("y", &[0], &[]),
        named("z", &[0], &[]),
        named("d", &[], &[0.25]),
        named("c", &[1], &[0.75]),
    ];
    for _ in 0..4 {
        assert_eq!(of_safetensors(&safetensors(header, &data)).unwrap(), expected);
    }
}

#[test]
fn onnx_constants_are_raw_or_in_the_field_of_their_type() {
    let raw = |tensor: TensorProto, raw: &[u8]| TensorProto { raw_data: Some(raw.to_vec()), ..tensor };
    let file = onnx(vec![
        raw(tensor("z", data_type::FLOAT, &[2]), &[0, 0, 0x80, 0x3f, 0, 0, 0x20, 0xc0]),
        TensorProto { float_data: vec![1.5], ..tensor("a", data_type::FLOAT, &[]) },
        raw(tensor("shape", data_type::INT64, &[1]), &[1, 0, 0, 0, 0, 0, 0, 0]),
        raw(tensor("h", data_type::FLOAT16, &[1, 1]), &[0x00, 0xc1]),
        TensorProto { int32_data: vec![0xc100, 0x3c00], ..tensor("i", data_type::FLOAT16, &[2]) },
        TensorProto { int32_data: vec![0x3f40], ..tensor("b", data_type::BFLOAT16, &[1]) },
        TensorProto { double_data: vec![0.25], ..tensor("d", data_type::DOUBLE, &[1]) },
        // Some writers leave an empty `raw_data` beside the field that counts.
        raw(TensorProto { float_data: vec![4.0], ..tensor("e", data_type::FLOAT, &[1]) }, &[]),
        tensor("nothing", data_type::FLOAT, &[3, 0]),
    ]);
    let expected = [
        named("z", &[2], &[1.0, -2.5]),
        named("a", &[], &[1.5]),
        named("h", &[1, 1], &[-2.5]),
        named("i", &[2], &[-2.5, 1.0]),
        named("b", &[1], &[0.75]),
        named("d", &[1], &[0.25]),
        named("e", &[1], &[4.0]),
        named("nothing", &[3, 0], &[]),
    ];
    assert_eq!(of_onnx(&file).unwrap(), expected);
}

#[test]
fn a_written_network_gives_its_parameters_back() {
    let size = Size { width: 32, height: 32 };
    for (network, spread) in [(Network::UnetLite, false), (Network::UnetTiny, true), (Network::EigenCoarse, false)] {
        let network = Monocular { network, spread };
        let layout = layout(network, size);
        let values = layout.start(3);
        let read = decode_weights(Path::new("network.onnx"), &export(network, size, &values, "none")).unwrap();
        for (parameter, values) in layout.parameters.iter().zip(&values) {
            let found = read.iter().find(|tensor| tensor.name == parameter.name).unwrap();
            assert_eq!((&found.dims, &found.values), (&parameter.shape, values), "{}", parameter.name);
        }
    }
}

#[test]
fn errors_name_file_and_tensor() {
    let damaged = |tensor: TensorProto| {
        let error = of_onnx(&onnx(vec![TensorProto { name: "conv.bias".to_owned(), ..tensor }])).unwrap_err();
        let WeightsError::Tensor { source, .. } = &error else { panic!("{error}") };
        let (source, line) = (source.clone(), message(&error));
        assert!(line.starts_with("tensor `conv.bias` of net.onnx: "), "{line}");
        source
    };
    let float = |dims: &[i64]| tensor("", data_type::FLOAT, dims);
    let count = |found, wanted, dims: &[usize]| TensorError::Count { found, wanted, dims: dims.to_vec() };
    assert_eq!(damaged(float(&[2, -1])), TensorError::Sides(vec![2, -1]));
    assert_eq!(damaged(float(&[i64::MAX, 3])), TensorError::Sides(vec![i64::MAX, 3]));
    assert_eq!(damaged(float(&[1 << 40])), count(0, 1 << 40, &[1 << 40]));
    assert_eq!(damaged(TensorProto { raw_data: Some(vec![0; 7]), ..float(&[1]) }), count(2, 1, &[1]));
    assert_eq!(damaged(TensorProto { float_data: vec![0.0; 3], ..float(&[2]) }), count(3, 2, &[2]));
    assert_eq!(damaged(TensorProto { data_location: 1, ..float(&[2]) }), TensorError::Elsewhere);
    assert!(matches!(damaged(tensor("", 8, &[])), TensorError::ElementType(_)));

    let twice = of_onnx(&onnx(vec![tensor("w", data_type::FLOAT, &[0]), tensor("w", data_type::FLOAT, &[0])]));
    assert_eq!(message(&twice.unwrap_err()), "tensor `w` of net.onnx: two tensors have this name");
    let complex = r#"{"w":{"dtype":"C64","shape":[1],"data_offsets":[0,8]}}"#;
    let complex = message(&of_safetensors(&safetensors(complex, &[0; 8])).unwrap_err());
    assert!(complex.starts_with("tensor `w` of net.safetensors: its elements have type C64"), "{complex}");
    let past = r#"{"w":{"dtype":"F32","shape":[4611686018427387904],"data_offsets":[0,8]}}"#;
    assert!(
        message(&of_safetensors(&safetensors(past, &[0; 8])).unwrap_err()).starts_with("net.safetensors is damaged")
    );
    assert!(message(&of_onnx(b"\xff\xff").unwrap_err()).starts_with("net.onnx is damaged"));
    assert!(message(&of_safetensors(&[0xff; 20]).unwrap_err()).contains("net.safetensors"));
    assert!(message(&decode_weights(Path::new("net.pth"), b"").unwrap_err()).contains("net.pth is neither"));
}

/// Tensors with names of their own.
fn tensors() -> impl Strategy<Value = Vec<NamedTensor>> {
    let one = vec(0_usize..4, 0..4).prop_flat_map(|dims| {
        let count = dims.iter().product::<usize>();
        (Just(dims), vec(-1e6_f32..1e6, count))
    });
    vec(one, 0..5).prop_map(|all| {
        all.into_iter()
            .enumerate()
            .map(|(i, (dims, values))| named(&format!("layer{i}.weight"), &dims, &values))
            .collect()
    })
}

fn as_onnx(tensors: &[NamedTensor]) -> Vec<u8> {
    let constant = |(i, of): (usize, &NamedTensor)| {
        let dims: Vec<i64> = of.dims.iter().map(|&side| side as i64).collect();
        let plain = tensor(&of.name, data_type::FLOAT, &dims);
        if i % 2 == 0 {
            return TensorProto { float_data: of.values.clone(), ..plain };
        }
        let raw = of.values.iter().flat_map(|value| value.to_le_bytes()).collect();
        TensorProto { raw_data: Some(raw), ..plain }
    };
    onnx(tensors.iter().enumerate().map(constant).collect())
}

fn as_safetensors(tensors: &[NamedTensor]) -> Vec<u8> {
    let (mut header, mut data) = (serde_json::Map::new(), Vec::new());
    for of in tensors {
        let start = data.len();
        data.extend(of.values.iter().flat_map(|value| value.to_le_bytes()));
        let about = serde_json::json!({ "dtype": "F32", "shape": of.dims, "data_offsets": [start, data.len()] });
        header.insert(of.name.clone(), about);
    }
    safetensors(&serde_json::Value::Object(header).to_string(), &data)
}

/// Elements as many as the sides say, and no more than the file has bytes for.
fn is_sound(read: &[NamedTensor], bytes: &[u8]) -> bool {
    let fits = |tensor: &NamedTensor| tensor.values.len() == tensor.dims.iter().product::<usize>();
    read.iter().all(fits) && read.iter().map(|tensor| tensor.values.len()).sum::<usize>() <= bytes.len()
}

proptest! {
    #[test]
    fn tensors_survive_being_written_and_read(tensors in tensors()) {
        prop_assert_eq!(&of_onnx(&as_onnx(&tensors)).unwrap(), &tensors);
        let mut of_safetensors = of_safetensors(&as_safetensors(&tensors)).unwrap();
        // Tensors without elements have the offset of their neighbour.
        of_safetensors.sort_by(|a, b| a.name.cmp(&b.name));
        prop_assert_eq!(&of_safetensors, &tensors);
    }

    #[test]
    fn damaged_files_give_an_error_or_sound_tensors(
        tensors in tensors(),
        damage in vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        part in proptest::option::of(0.0..1.0_f64),
    ) {
        for (mut bytes, read) in [
            (as_onnx(&tensors), of_onnx as fn(&[u8]) -> _),
            (as_safetensors(&tensors), of_safetensors),
        ] {
            for (at, byte) in &damage {
                let at = at.index(bytes.len());
                bytes[at] = *byte;
            }
            bytes.truncate((bytes.len() as f64 * part.unwrap_or(1.0)) as usize);
            if let Ok(read) = read(&bytes) {
                prop_assert!(is_sound(&read, &bytes));
            }
        }
    }

    #[test]
    fn noise_never_panics(bytes in vec(any::<u8>(), 0..300)) {
        for read in [of_onnx(&bytes), of_safetensors(&bytes), of_safetensors(&safetensors(r#"{"a":{}}"#, &bytes))] {
            prop_assert!(read.is_err() || is_sound(&read.unwrap(), &bytes));
        }
    }
}
