//! The description of an ONNX file.

use crate::Target;

pub(crate) fn target() -> Target {
    Target::new("onnx_metadata", vec![model()], |bytes, _| depthloom_nodes::onnx::read_declaration(bytes))
}

/// A model of one convolution with its weights, and one entry of metadata; field numbers are those of onnx/onnx.proto3.
fn model() -> Vec<u8> {
    let sides = |sides: &[u8]| bytes(2, &sides.iter().flat_map(|side| bytes(1, &[0x08, *side])).collect::<Vec<u8>>());
    let tensor = |shape: &[u8]| bytes(2, &bytes(1, &[&[0x08, 1], &sides(shape)[..]].concat()));
    let value = |name: &str, shape: &[u8]| [bytes(1, name.as_bytes()), tensor(shape)].concat();
    let node = [bytes(1, b"image"), bytes(1, b"w"), bytes(2, b"depth"), bytes(4, b"Conv")].concat();
    let weights = [&[0x08, 1, 0x08, 3, 0x10, 1][..], &bytes(8, b"w"), &bytes(9, &[0; 12])].concat();
    let graph = [
        bytes(1, &node),
        bytes(2, b"main"),
        bytes(5, &weights),
        bytes(11, &value("image", &[1, 3, 8, 16])),
        bytes(12, &value("depth", &[1, 1, 8, 16])),
    ];
    let metadata = [bytes(1, b"depthloom.output"), bytes(2, b"disparity")].concat();
    [&[0x08, 8][..], &bytes(7, &graph.concat()), &bytes(14, &metadata)].concat()
}

/// A field of a message, bytes as its content.
fn bytes(number: u8, content: &[u8]) -> Vec<u8> {
    assert!(content.len() < 1 << 14, "two bytes hold its length");
    let length = [content.len() as u8 & 0x7f | 0x80, (content.len() >> 7) as u8];
    [&[number << 3 | 2][..], &length, content].concat()
}
