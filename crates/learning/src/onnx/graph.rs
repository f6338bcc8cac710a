//! Networks as ONNX files, layer by layer.

mod layers;

use prost::Message;

use super::metadata::{Metadata, names};
use depthloom_onnx::{
    AttributeProto, Dimension, DimensionProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    StringStringEntryProto, TensorProto, TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto, data_type,
};

/// The version of ONNX's operators that is written.
pub(crate) const OPSET: i64 = 13;
/// The version of the file format: that of ONNX 1.9 to 1.12, which every engine of today reads.
const IR_VERSION: i64 = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tensor(usize);

#[derive(Clone, Copy, Debug)]
pub(crate) struct Weights<'a> {
    /// Sides; which channels come first depends on the layer.
    pub(crate) dims: [usize; 4],
    pub(crate) values: &'a [f32],
}

struct NamedValue {
    name: String,
    /// Sides after the batch's.
    dims: Vec<usize>,
}

/// A network that is being built. The bytes depend only on the calls.
///
/// Layers check their inputs and panic if they do not fit: a network is written by code, not by a user.
pub(crate) struct GraphBuilder {
    name: String,
    values: Vec<NamedValue>,
    inputs: Vec<Tensor>,
    nodes: Vec<NodeProto>,
    initializers: Vec<TensorProto>,
}

impl GraphBuilder {
    pub(crate) fn new(name: &str) -> Self {
        let (values, inputs, nodes, initializers) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { name: name.to_owned(), values, inputs, nodes, initializers }
    }

    /// An input of f32; `dims` are its sides after the batch's, e.g. `[3, 96, 320]`.
    pub(crate) fn input(&mut self, name: &str, dims: &[usize]) -> Tensor {
        let input = self.value(name, dims.to_vec());
        self.inputs.push(input);
        input
    }

    /// The sides of a value after the batch's.
    pub(crate) fn dims(&self, tensor: Tensor) -> &[usize] {
        &self.values[tensor.0].dims
    }

    /// The file: the graph with its outputs, each with its meaning, e.g. `disparity-share`; their names are the
    /// meanings, with underscores.
    pub(crate) fn finish(mut self, outputs: &[(Tensor, &str)], metadata: &Metadata<'_>) -> Vec<u8> {
        for (output, meaning) in outputs {
            self.rename(*output, &meaning.replace('-', "_"));
        }
        let [width, height] = metadata.size;
        let metadata = [
            (names::INPUT_SIZE, format!("{width}x{height}")),
            (names::NORMALISATION, metadata.normalisation.to_owned()),
            (names::OUTPUT, outputs[0].1.to_owned()),
            (names::TRAINING_KEY, metadata.training_key.to_owned()),
        ];
        let graph = GraphProto {
            input: self.inputs.iter().map(|&input| self.value_info(input)).collect(),
            output: outputs.iter().map(|(output, _)| self.value_info(*output)).collect(),
            node: self.nodes,
            name: self.name,
            initializer: self.initializers,
            value_info: Vec::new(),
        };
        let model = ModelProto {
            ir_version: IR_VERSION,
            producer_name: "depthloom".to_owned(),
            producer_version: env!("CARGO_PKG_VERSION").to_owned(),
            graph: Some(graph),
            opset_import: vec![OperatorSetIdProto { domain: String::new(), version: OPSET }],
            metadata_props: metadata
                .into_iter()
                .map(|(key, value)| StringStringEntryProto { key: key.to_owned(), value })
                .collect(),
        };
        model.encode_to_vec()
    }

    fn rename(&mut self, output: Tensor, name: &str) {
        let before = self.name_of(output);
        let is_used = self.values.iter().any(|known| known.name == name && known.name != before);
        assert!(!is_used, "the name {name} is used twice");
        assert!(!self.inputs.contains(&output), "the output is calculated");
        let mentions = self.nodes.iter_mut().flat_map(|node| node.input.iter_mut().chain(&mut node.output));
        mentions.filter(|mention| **mention == before).for_each(|mention| name.clone_into(mention));
        name.clone_into(&mut self.values[output.0].name);
    }

    fn value(&mut self, name: &str, dims: Vec<usize>) -> Tensor {
        assert!(self.is_unused(name), "the name {name} is taken");
        self.values.push(NamedValue { name: name.to_owned(), dims });
        Tensor(self.values.len() - 1)
    }

    fn is_unused(&self, name: &str) -> bool {
        self.values.iter().all(|known| known.name != name) && self.initializers.iter().all(|known| known.name != name)
    }

    fn unused(&self, stem: &str) -> String {
        let stem = stem.to_ascii_lowercase();
        let numbered = (1..).map(|number| format!("{stem}_{number}"));
        numbered.into_iter().find(|name| self.is_unused(name)).expect("numbers do not end")
    }

    fn name_of(&self, tensor: Tensor) -> String {
        self.values[tensor.0].name.clone()
    }

    /// Channels, rows and columns.
    fn map_dims(&self, tensor: Tensor) -> [usize; 3] {
        let known = &self.values[tensor.0];
        let dims = known.dims.as_slice().try_into();
        dims.unwrap_or_else(|_| panic!("{} has the sides {:?}: it is not an image", known.name, known.dims))
    }

    fn constant(&mut self, name: String, dims: &[usize], values: &[f32]) -> String {
        assert_eq!(values.len(), dims.iter().product::<usize>(), "{name} has the sides {dims:?}");
        let raw = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(name, dims, data_type::FLOAT, raw)
    }

    fn integers(&mut self, values: &[i64]) -> String {
        let raw = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(self.unused("sides"), &[values.len()], data_type::INT64, raw)
    }

    fn initializer(&mut self, name: String, dims: &[usize], data_type: i32, raw: Vec<u8>) -> String {
        assert!(self.is_unused(&name), "the name {name} is taken");
        let dims = dims.iter().map(|&side| side as i64).collect();
        let raw_data = Some(raw);
        self.initializers.push(TensorProto { name: name.clone(), dims, data_type, raw_data, ..TensorProto::default() });
        name
    }

    fn node(
        &mut self,
        name: &str,
        op: &str,
        input: Vec<String>,
        attribute: Vec<AttributeProto>,
        dims: Vec<usize>,
    ) -> Tensor {
        let output = self.value(name, dims);
        let (name, op_type) = (name.to_owned(), op.to_owned());
        self.nodes.push(NodeProto {
            input,
            output: vec![name.clone()],
            name,
            op_type,
            attribute,
            ..NodeProto::default()
        });
        output
    }

    fn value_info(&self, tensor: Tensor) -> ValueInfoProto {
        let known = &self.values[tensor.0];
        let batch = Dimension::Param("N".to_owned());
        let sides = known.dims.iter().map(|&side| Dimension::Value(side as i64));
        let dim = std::iter::once(batch).chain(sides).map(|side| DimensionProto { value: Some(side) }).collect();
        let shape = Some(TensorShapeProto { dim });
        let tensor_type = Some(TensorTypeProto { elem_type: data_type::FLOAT, shape });
        ValueInfoProto { name: known.name.clone(), r#type: Some(TypeProto { tensor_type }) }
    }
}
