//! What an ONNX file declares, read without an engine: inputs, outputs, metadata, sizes, external files.
//!
//! So both engines refuse the same models, in the same words, before they see a byte. The elements of weights are
//! skipped in reading.

use std::collections::BTreeMap;

use depthloom_graphs::regular_file;
use depthloom_onnx::{
    AttributeProto, Dimension, DimensionProto, EXTERNAL, GraphProto, ModelProto, StringStringEntryProto, TensorHead,
    ValueInfoProto,
};
use ort::value::TensorElementType;
use prost::Message;
use schemars::JsonSchema;
use serde::Serialize;

#[derive(Clone)]
pub(crate) struct Outlet {
    pub name: String,
    /// Element type and shape, open sides -1; `None` if it is not a tensor.
    pub tensor: Option<(TensorElementType, Vec<i64>)>,
}

pub(crate) struct Declared {
    /// The graph's inputs without its weights.
    pub inputs: Vec<Outlet>,
    pub outputs: Vec<Outlet>,
    /// First file of weights outside the model file.
    pub external: Option<String>,
    /// Name and shape of the largest tensor with a declared shape.
    pub largest: Option<(String, Vec<i64>)>,
    metadata: Vec<StringStringEntryProto>,
}

impl Declared {
    pub(crate) fn read(model: &[u8]) -> Result<Self, String> {
        let ModelProto { graph, metadata_props: metadata, .. } = decode(model)?;
        let graph = graph.ok_or(NO_GRAPH)?;
        // Old models list their weights among the inputs.
        let is_weight = |input: &&ValueInfoProto| graph.initializer.iter().any(|weight| weight.name == input.name);
        let outlets: [Vec<Outlet>; 2] = [
            graph.input.iter().filter(|input| !is_weight(input)).map(outlet).collect(),
            graph.output.iter().map(outlet).collect(),
        ];
        let mut weights = Vec::new();
        add_weights(&graph, &mut weights);
        let external = weights.iter().find(|weight| weight.data_location == EXTERNAL).map(|weight| {
            let place = weight.external_data.iter().find(|entry| entry.key == "location");
            place.map_or_else(|| "a file it does not name".to_owned(), |place| place.value.clone())
        });
        let stated = graph.input.iter().chain(&graph.output).chain(&graph.value_info).map(outlet);
        let stated = stated.filter_map(|outlet| Some((outlet.name, outlet.tensor?.1)));
        let of_weights = weights.iter().map(|weight| (weight.name.clone(), weight.dims.clone()));
        let largest = stated.chain(of_weights).max_by_key(|(_, sides)| elements(sides));
        let [inputs, outputs] = outlets;
        Ok(Self { inputs, outputs, external, largest, metadata })
    }

    pub(crate) fn metadata(&self, name: &str) -> Option<&str> {
        self.metadata.iter().find(|entry| entry.key == name).map(|entry| entry.value.as_str())
    }
}

/// Description of an ONNX file, for display.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// The exporter: `pytorch 2.9.1`; empty if not stated.
    pub producer: String,
    /// The version of the file's form.
    pub ir_version: i64,
    /// The operator sets: domain (empty of the standard one) and version.
    pub opsets: Vec<(String, i64)>,
    /// What must be fed.
    pub inputs: Vec<Tensor>,
    /// Its outputs.
    pub outputs: Vec<Tensor>,
    /// Metadata, by name.
    pub metadata: Vec<(String, String)>,
    /// Number of uses of each operator.
    pub operators: BTreeMap<String, u64>,
    /// Numbers in its weights.
    pub parameters: u64,
    /// The first file of weights that is not in its own.
    pub external: Option<String>,
}

/// An input or output of a model.
#[derive(Clone, Debug, PartialEq, Eq, JsonSchema, Serialize)]
pub struct Tensor {
    /// Its name.
    pub name: String,
    /// What it holds: `f32`, `f16`, ...; `no tensor`.
    pub element: String,
    /// Its sides; -1 where one is open.
    pub shape: Vec<i64>,
}

impl Description {
    /// Reads a model without an engine.
    ///
    /// # Errors
    /// Why it is not an ONNX file.
    pub fn read(model: &[u8]) -> Result<Self, String> {
        let declared = Declared::read(model)?;
        let ModelProto { ir_version, producer_name, producer_version, graph, opset_import, .. } = decode(model)?;
        let graph = graph.ok_or(NO_GRAPH)?;
        let mut operators = BTreeMap::new();
        count_operators(&graph, &mut operators);
        let mut weights = Vec::new();
        add_weights(&graph, &mut weights);
        let tensors = |outlets: Vec<Outlet>| outlets.into_iter().map(Tensor::from).collect();
        Ok(Self {
            producer: format!("{producer_name} {producer_version}").trim().to_owned(),
            ir_version,
            opsets: opset_import.into_iter().map(|set| (set.domain, set.version)).collect(),
            inputs: tensors(declared.inputs),
            outputs: tensors(declared.outputs),
            metadata: declared.metadata.into_iter().map(|entry| (entry.key, entry.value)).collect(),
            operators,
            parameters: weights.iter().fold(0, |sum: u64, weight| sum.saturating_add(elements(&weight.dims))),
            external: declared.external,
        })
    }
}

impl Tensor {
    /// Whether its numbers can be read as a map's: f32, f16 or f64.
    #[must_use]
    pub fn is_number(&self) -> bool {
        matches!(self.element.as_str(), "f32" | "f16" | "f64")
    }
}

impl From<Outlet> for Tensor {
    fn from(outlet: Outlet) -> Self {
        match outlet.tensor {
            Some((element, shape)) => Self { name: outlet.name, element: element.to_string(), shape },
            None => Self { name: outlet.name, element: "no tensor".to_owned(), shape: Vec::new() },
        }
    }
}

/// Product of the fixed sides.
pub(crate) fn elements(sides: &[i64]) -> u64 {
    sides.iter().fold(1, |product: u64, &side| product.saturating_mul(u64::try_from(side).unwrap_or(1)))
}

const NO_GRAPH: &str = "it is not an ONNX file: it holds no graph";

fn decode(model: &[u8]) -> Result<ModelProto<TensorHead>, String> {
    if regular_file::is_lfs_pointer(model) {
        return Err(format!("it is a pointer of Git LFS, not the file itself: {}", regular_file::LFS_REMEDY));
    }
    ModelProto::decode(model).map_err(|error| format!("it is not an ONNX file: {error}"))
}

fn graphs(attribute: &AttributeProto<TensorHead>) -> impl Iterator<Item = &GraphProto<TensorHead>> {
    attribute.g.as_deref().into_iter().chain(&attribute.graphs)
}

fn count_operators(graph: &GraphProto<TensorHead>, found: &mut BTreeMap<String, u64>) {
    for node in &graph.node {
        let domain = if node.domain.is_empty() { String::new() } else { format!("{}.", node.domain) };
        *found.entry(format!("{domain}{}", node.op_type)).or_default() += 1;
        node.attribute.iter().flat_map(graphs).for_each(|graph| count_operators(graph, found));
    }
}

fn add_weights<'a>(graph: &'a GraphProto<TensorHead>, found: &mut Vec<&'a TensorHead>) {
    found.extend(&graph.initializer);
    for attribute in graph.node.iter().flat_map(|node| &node.attribute) {
        found.extend(attribute.t.iter().chain(&attribute.tensors));
        graphs(attribute).for_each(|graph| add_weights(graph, found));
    }
}

fn outlet(value: &ValueInfoProto) -> Outlet {
    let tensor = value.r#type.as_ref().and_then(|kind| kind.tensor_type.as_ref()).map(|tensor| {
        let side = |side: &DimensionProto| match side.value {
            Some(Dimension::Value(fixed)) => fixed,
            Some(Dimension::Param(_)) | None => -1,
        };
        let shape = tensor.shape.as_ref().map(|shape| shape.dim.iter().map(side).collect());
        (element(tensor.elem_type), shape.unwrap_or_default())
    });
    Outlet { name: value.name.clone(), tensor }
}

const fn element(number: i32) -> TensorElementType {
    match number {
        1 => TensorElementType::Float32,
        2 => TensorElementType::Uint8,
        3 => TensorElementType::Int8,
        4 => TensorElementType::Uint16,
        5 => TensorElementType::Int16,
        6 => TensorElementType::Int32,
        7 => TensorElementType::Int64,
        8 => TensorElementType::String,
        9 => TensorElementType::Bool,
        10 => TensorElementType::Float16,
        11 => TensorElementType::Float64,
        12 => TensorElementType::Uint32,
        13 => TensorElementType::Uint64,
        14 => TensorElementType::Complex64,
        15 => TensorElementType::Complex128,
        16 => TensorElementType::Bfloat16,
        _ => TensorElementType::Undefined,
    }
}
