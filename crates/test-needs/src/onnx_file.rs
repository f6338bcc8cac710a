//! Tiny ONNX files, written field by field from the public protobuf schema, so that tests of networks need no
//! additional files.

/// A protobuf message that is being built.
#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn varint(mut self, field: u8, value: u64) -> Self {
        self.push(u64::from(field) << 3);
        self.push(value);
        self
    }

    fn bytes(mut self, field: u8, value: &[u8]) -> Self {
        self.push((u64::from(field) << 3) | 2);
        self.push(value.len() as u64);
        self.0.extend_from_slice(value);
        self
    }

    fn text(self, field: u8, value: &str) -> Self {
        self.bytes(field, value.as_bytes())
    }

    fn message(self, field: u8, value: &Self) -> Self {
        self.bytes(field, &value.0)
    }

    fn push(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }
}

/// ONNX: 32-bit floats.
pub const F32: u64 = 1;
/// ONNX: bytes.
pub const U8: u64 = 2;

/// A named tensor of an element type; a side of -1 is open.
pub struct Tensor<'a>(pub &'a str, pub u64, pub &'a [i64]);

impl Tensor<'_> {
    fn message(&self) -> Message {
        let mut shape = Message::default();
        for (axis, &side) in self.2.iter().enumerate() {
            let open = || Message::default().text(2, &format!("side{axis}"));
            let dim = u64::try_from(side).map_or_else(|_| open(), |side| Message::default().varint(1, side));
            shape = shape.message(1, &dim);
        }
        let tensor = Message::default().varint(1, self.1).message(2, &shape);
        Message::default().text(1, self.0).message(2, &Message::default().message(1, &tensor))
    }
}

/// A model of one node `op` that reads the first input and writes `output`.
///
/// `axes`: the attribute of that name, if the operator has one.
#[must_use]
pub fn model(op: &str, axes: Option<i64>, inputs: &[Tensor<'_>], output: &Tensor<'_>) -> Vec<u8> {
    let attributes: Vec<_> = axes.iter().map(|axis| ("axes", std::slice::from_ref(axis))).collect();
    model_with(op, &attributes, inputs, output)
}

/// Like [`model`], with attributes that are lists of integers.
#[must_use]
pub fn model_with(op: &str, attributes: &[(&str, &[i64])], inputs: &[Tensor<'_>], output: &Tensor<'_>) -> Vec<u8> {
    of_outputs(op, attributes, inputs, std::slice::from_ref(output))
}

/// Like [`model_with`], with a node for each output.
#[must_use]
pub fn of_outputs(op: &str, attributes: &[(&str, &[i64])], inputs: &[Tensor<'_>], outputs: &[Tensor<'_>]) -> Vec<u8> {
    let mut graph = Message::default();
    for output in outputs {
        let mut node = Message::default().text(1, inputs[0].0).text(2, output.0).text(4, op);
        for (name, values) in attributes {
            let attribute = Message::default().text(1, name);
            let attribute =
                values.iter().fold(attribute, |attribute, value| attribute.varint(8, value.cast_unsigned()));
            node = node.message(5, &attribute.varint(20, 7));
        }
        graph = graph.message(1, &node);
    }
    graph = graph.text(2, "test");
    for input in inputs {
        graph = graph.message(11, &input.message());
    }
    for output in outputs {
        graph = graph.message(12, &output.message());
    }
    let opset = Message::default().text(1, "").varint(2, 13);
    Message::default().varint(1, 8).message(7, &graph).message(8, &opset).0
}
