//! What an ONNX file declares, read without an engine: inputs, outputs, metadata, sizes, files beside it.
//!
//! So both engines refuse the same models, in the same words, before they see a byte. Field numbers are those of the public schema
//! (onnx/onnx.proto3); fields that are not named here, weights above all, are skipped in reading.

use std::collections::BTreeMap;

use depthloom_graphs::regular_file;
use ort::value::TensorElementType;
use prost::{Message, Oneof};

/// An input or output, as the model declares it.
#[derive(Clone)]
pub(crate) struct Outlet {
    pub name: String,
    /// Element type and shape, open sides -1; `None`: no tensor.
    pub tensor: Option<(TensorElementType, Vec<i64>)>,
}

/// A model, as far as it declares itself.
pub(crate) struct Declared {
    /// What must be fed: the graph's inputs that are no weights.
    pub inputs: Vec<Outlet>,
    /// What it gives.
    pub outputs: Vec<Outlet>,
    /// The first file of weights that is not in the model's own.
    pub external: Option<String>,
    /// The largest tensor that it states whole: its name and sides.
    pub largest: Option<(String, Vec<i64>)>,
    metadata: Vec<Entry>,
}

impl Declared {
    /// Reads a model.
    ///
    /// # Errors
    /// Why it is no ONNX file.
    pub fn read(model: &[u8]) -> Result<Self, String> {
        let Model { graph, metadata, .. } = Model::read(model)?;
        let graph = graph.ok_or(NO_GRAPH)?;
        // Old models list their weights among the inputs.
        let is_weight = |input: &&ValueInfo| graph.initializers.iter().any(|weight| weight.name == input.name);
        let outlets: [Vec<Outlet>; 2] = [
            graph.inputs.iter().filter(|input| !is_weight(input)).map(ValueInfo::outlet).collect(),
            graph.outputs.iter().map(ValueInfo::outlet).collect(),
        ];
        let mut weights = Vec::new();
        graph.weights(&mut weights);
        let external = weights.iter().find(|weight| weight.location == EXTERNAL).map(|weight| {
            let place = weight.external.iter().find(|entry| entry.key == "location");
            place.map_or_else(|| "a file it does not name".to_owned(), |place| place.value.clone())
        });
        let stated = graph.inputs.iter().chain(&graph.outputs).chain(&graph.within).map(ValueInfo::outlet);
        let stated = stated.filter_map(|outlet| Some((outlet.name, outlet.tensor?.1)));
        let of_weights = weights.iter().map(|weight| (weight.name.clone(), weight.dims.clone()));
        let largest = stated.chain(of_weights).max_by_key(|(_, sides)| elements(sides));
        let [inputs, outputs] = outlets;
        Ok(Self { inputs, outputs, external, largest, metadata })
    }

    /// What the model says of itself under a name.
    pub fn metadata(&self, name: &str) -> Option<&str> {
        self.metadata.iter().find(|said| said.key == name).map(|said| said.value.as_str())
    }
}

/// All that an ONNX file says of itself, for a person to look at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// Who wrote it: `pytorch 2.9.1`; empty where it does not say.
    pub producer: String,
    /// The version of the file's form.
    pub ir_version: i64,
    /// The operator sets: domain (empty of the standard one) and version.
    pub opsets: Vec<(String, i64)>,
    /// What must be fed.
    pub inputs: Vec<Tensor>,
    /// What it gives.
    pub outputs: Vec<Tensor>,
    /// What it says of itself, by name.
    pub metadata: Vec<(String, String)>,
    /// How often each operator stands in it.
    pub operators: BTreeMap<String, u64>,
    /// Numbers in its weights.
    pub parameters: u64,
    /// The first file of weights that is not in its own.
    pub external: Option<String>,
}

/// An input or output of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
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
    /// Why it is no ONNX file.
    pub fn read(model: &[u8]) -> Result<Self, String> {
        let declared = Declared::read(model)?;
        let Model { ir_version, producer, producer_version, graph, opsets, .. } = Model::read(model)?;
        let graph = graph.ok_or(NO_GRAPH)?;
        let mut operators = BTreeMap::new();
        graph.operators(&mut operators);
        let mut weights = Vec::new();
        graph.weights(&mut weights);
        let tensors = |outlets: Vec<Outlet>| outlets.into_iter().map(Tensor::from).collect();
        Ok(Self {
            producer: format!("{producer} {producer_version}").trim().to_owned(),
            ir_version,
            opsets: opsets.into_iter().map(|set| (set.domain, set.version)).collect(),
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

/// How many numbers a tensor has as far as its sides are fixed.
pub(crate) fn elements(sides: &[i64]) -> u64 {
    sides.iter().fold(1, |product: u64, &side| product.saturating_mul(u64::try_from(side).unwrap_or(1)))
}

/// `TensorProto.DataLocation`: the values lie in another file.
const EXTERNAL: i32 = 1;

const NO_GRAPH: &str = "it is no ONNX file: it holds no graph";

#[derive(Clone, PartialEq, Message)]
struct Model {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(string, tag = "2")]
    producer: String,
    #[prost(string, tag = "3")]
    producer_version: String,
    #[prost(message, optional, tag = "7")]
    graph: Option<Graph>,
    #[prost(message, repeated, tag = "8")]
    opsets: Vec<OperatorSet>,
    #[prost(message, repeated, tag = "14")]
    metadata: Vec<Entry>,
}

impl Model {
    fn read(model: &[u8]) -> Result<Self, String> {
        if regular_file::is_lfs_pointer(model) {
            return Err(format!("it is a pointer of Git LFS, not the file itself: {}", regular_file::LFS_REMEDY));
        }
        Self::decode(model).map_err(|error| format!("it is no ONNX file: {error}"))
    }
}

#[derive(Clone, PartialEq, Message)]
struct OperatorSet {
    #[prost(string, tag = "1")]
    domain: String,
    #[prost(int64, tag = "2")]
    version: i64,
}

#[derive(Clone, PartialEq, Message)]
struct Entry {
    #[prost(string, tag = "1")]
    key: String,
    #[prost(string, tag = "2")]
    value: String,
}

#[derive(Clone, PartialEq, Message)]
struct Graph {
    #[prost(message, repeated, tag = "1")]
    nodes: Vec<GraphNode>,
    #[prost(message, repeated, tag = "5")]
    initializers: Vec<Weight>,
    #[prost(message, repeated, tag = "11")]
    inputs: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "12")]
    outputs: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "13")]
    within: Vec<ValueInfo>,
}

impl Graph {
    /// Counts the operators, those of graphs within nodes too.
    fn operators(&self, found: &mut BTreeMap<String, u64>) {
        for node in &self.nodes {
            let domain = if node.domain.is_empty() { String::new() } else { format!("{}.", node.domain) };
            *found.entry(format!("{domain}{}", node.operator)).or_default() += 1;
            for graph in node.attributes.iter().flat_map(|one| one.graph.as_deref().into_iter().chain(&one.graphs)) {
                graph.operators(found);
            }
        }
    }

    /// All weights: those of the graph, those that nodes hold as attributes, and those of graphs within nodes.
    fn weights<'a>(&'a self, found: &mut Vec<&'a Weight>) {
        found.extend(&self.initializers);
        for attribute in self.nodes.iter().flat_map(|node| &node.attributes) {
            found.extend(attribute.tensor.iter().chain(&attribute.tensors));
            for graph in attribute.graph.as_deref().into_iter().chain(&attribute.graphs) {
                graph.weights(found);
            }
        }
    }
}

#[derive(Clone, PartialEq, Message)]
struct GraphNode {
    #[prost(string, tag = "4")]
    operator: String,
    #[prost(message, repeated, tag = "5")]
    attributes: Vec<Attribute>,
    #[prost(string, tag = "7")]
    domain: String,
}

#[derive(Clone, PartialEq, Message)]
struct Attribute {
    #[prost(message, optional, tag = "5")]
    tensor: Option<Weight>,
    #[prost(message, optional, boxed, tag = "6")]
    graph: Option<Box<Graph>>,
    #[prost(message, repeated, tag = "10")]
    tensors: Vec<Weight>,
    #[prost(message, repeated, tag = "11")]
    graphs: Vec<Graph>,
}

/// `TensorProto`, without its values.
#[derive(Clone, PartialEq, Message)]
struct Weight {
    #[prost(int64, repeated, tag = "1")]
    dims: Vec<i64>,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(message, repeated, tag = "13")]
    external: Vec<Entry>,
    #[prost(int32, tag = "14")]
    location: i32,
}

#[derive(Clone, PartialEq, Message)]
struct ValueInfo {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    of: Option<Type>,
}

impl ValueInfo {
    fn outlet(&self) -> Outlet {
        let tensor = self.of.as_ref().and_then(|of| of.tensor.as_ref()).map(|tensor| {
            let side = |side: &Side| match side.value {
                Some(Value::Fixed(fixed)) => fixed,
                Some(Value::Named(_)) | None => -1,
            };
            let shape = tensor.shape.as_ref().map(|shape| shape.sides.iter().map(side).collect());
            (element(tensor.element), shape.unwrap_or_default())
        });
        Outlet { name: self.name.clone(), tensor }
    }
}

#[derive(Clone, PartialEq, Message)]
struct Type {
    #[prost(message, optional, tag = "1")]
    tensor: Option<TensorType>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorType {
    #[prost(int32, tag = "1")]
    element: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<Shape>,
}

#[derive(Clone, PartialEq, Message)]
struct Shape {
    #[prost(message, repeated, tag = "1")]
    sides: Vec<Side>,
}

#[derive(Clone, PartialEq, Message)]
struct Side {
    #[prost(oneof = "Value", tags = "1, 2")]
    value: Option<Value>,
}

#[derive(Clone, PartialEq, Oneof)]
enum Value {
    #[prost(int64, tag = "1")]
    Fixed(i64),
    #[prost(string, tag = "2")]
    Named(String),
}

/// The element type by its number in the schema.
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
