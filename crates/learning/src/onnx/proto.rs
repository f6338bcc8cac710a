//! The part of `onnx.proto` that networks and weights need, field numbers as in the public schema (onnx/onnx.proto3).
//!
//! Fields that are not named here are skipped in reading. The schema has two forms, of which proto2 tells an absent number from a zero;
//! attributes and dimensions are written so that a zero is there in both.

use prost::{Message, Oneof};

/// `TensorProto.DataType`: the element types that are read or written.
pub(crate) mod data_type {
    /// IEEE single.
    pub(crate) const FLOAT: i32 = 1;
    /// 64-bit integer.
    pub(crate) const INT64: i32 = 7;
    /// IEEE half.
    pub(crate) const FLOAT16: i32 = 10;
    /// IEEE double.
    pub(crate) const DOUBLE: i32 = 11;
    /// The upper half of an IEEE single.
    pub(crate) const BFLOAT16: i32 = 16;
}

/// `AttributeProto.AttributeType`.
pub(crate) mod attribute_type {
    /// One integer.
    pub(crate) const INT: i32 = 2;
    /// Integers.
    pub(crate) const INTS: i32 = 7;
}

/// A model: a graph, what it is written in and by whom.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct ModelProto {
    /// Version of the file format.
    #[prost(int64, tag = "1")]
    pub(crate) ir_version: i64,
    /// Who wrote it.
    #[prost(string, tag = "2")]
    pub(crate) producer_name: String,
    /// And its version.
    #[prost(string, tag = "3")]
    pub(crate) producer_version: String,
    /// The graph.
    #[prost(message, optional, tag = "7")]
    pub(crate) graph: Option<GraphProto>,
    /// The operators' versions.
    #[prost(message, repeated, tag = "8")]
    pub(crate) opset_import: Vec<OperatorSetIdProto>,
    /// What the writer says of it.
    #[prost(message, repeated, tag = "14")]
    pub(crate) metadata_props: Vec<StringStringEntryProto>,
}

/// A set of operators.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct OperatorSetIdProto {
    /// Empty: ONNX's own.
    #[prost(string, tag = "1")]
    pub(crate) domain: String,
    /// Its version.
    #[prost(int64, tag = "2")]
    pub(crate) version: i64,
}

/// A name and a text.
#[derive(Clone, PartialEq, Eq, Message)]
pub(crate) struct StringStringEntryProto {
    /// The name.
    #[prost(string, tag = "1")]
    pub(crate) key: String,
    /// The text.
    #[prost(string, tag = "2")]
    pub(crate) value: String,
}

/// Operators in an order in which each comes after what it reads.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct GraphProto {
    /// The operators.
    #[prost(message, repeated, tag = "1")]
    pub(crate) node: Vec<NodeProto>,
    /// The graph's name.
    #[prost(string, tag = "2")]
    pub(crate) name: String,
    /// Constants.
    #[prost(message, repeated, tag = "5")]
    pub(crate) initializer: Vec<TensorProto>,
    /// Inputs.
    #[prost(message, repeated, tag = "11")]
    pub(crate) input: Vec<ValueInfoProto>,
    /// Outputs.
    #[prost(message, repeated, tag = "12")]
    pub(crate) output: Vec<ValueInfoProto>,
}

/// An operator.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct NodeProto {
    /// Names of the values it reads; empty for an optional one left out.
    #[prost(string, repeated, tag = "1")]
    pub(crate) input: Vec<String>,
    /// Names of the values it gives.
    #[prost(string, repeated, tag = "2")]
    pub(crate) output: Vec<String>,
    /// Its own name.
    #[prost(string, tag = "3")]
    pub(crate) name: String,
    /// The operator, e.g. `Conv`.
    #[prost(string, tag = "4")]
    pub(crate) op_type: String,
    /// Its parameters.
    #[prost(message, repeated, tag = "5")]
    pub(crate) attribute: Vec<AttributeProto>,
}

/// A parameter of an operator.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct AttributeProto {
    /// Its name.
    #[prost(string, tag = "1")]
    pub(crate) name: String,
    /// [`attribute_type::INT`].
    #[prost(int64, optional, tag = "3")]
    pub(crate) i: Option<i64>,
    /// [`attribute_type::INTS`]. Readers take both forms; this is the one proto2 writes.
    #[prost(int64, repeated, packed = "false", tag = "8")]
    pub(crate) ints: Vec<i64>,
    /// Which of the fields holds the value.
    #[prost(int32, tag = "20")]
    pub(crate) r#type: i32,
}

/// A constant.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct TensorProto {
    /// Its sides; none for a scalar.
    #[prost(int64, repeated, packed = "false", tag = "1")]
    pub(crate) dims: Vec<i64>,
    /// Its element type, see [`data_type`].
    #[prost(int32, tag = "2")]
    pub(crate) data_type: i32,
    /// Elements of type float, unless they are in `raw_data`.
    #[prost(float, repeated, tag = "4")]
    pub(crate) float_data: Vec<f32>,
    /// Halves, one each, likewise.
    #[prost(int32, repeated, tag = "5")]
    pub(crate) int32_data: Vec<i32>,
    /// Its name.
    #[prost(string, tag = "8")]
    pub(crate) name: String,
    /// All elements, little-endian.
    #[prost(bytes = "vec", optional, tag = "9")]
    pub(crate) raw_data: Option<Vec<u8>>,
    /// Doubles, unless they are in `raw_data`.
    #[prost(double, repeated, tag = "10")]
    pub(crate) double_data: Vec<f64>,
    /// 1: the elements lie in another file.
    #[prost(int32, tag = "14")]
    pub(crate) data_location: i32,
}

/// The name and type of a value.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct ValueInfoProto {
    /// Its name.
    #[prost(string, tag = "1")]
    pub(crate) name: String,
    /// Its type.
    #[prost(message, optional, tag = "2")]
    pub(crate) r#type: Option<TypeProto>,
}

/// A type; of all kinds of type only tensors are known here.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct TypeProto {
    /// A tensor.
    #[prost(message, optional, tag = "1")]
    pub(crate) tensor_type: Option<TensorTypeProto>,
}

/// `TypeProto.Tensor`.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct TensorTypeProto {
    /// Its element type, see [`data_type`].
    #[prost(int32, tag = "1")]
    pub(crate) elem_type: i32,
    /// Its shape.
    #[prost(message, optional, tag = "2")]
    pub(crate) shape: Option<TensorShapeProto>,
}

/// A shape.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct TensorShapeProto {
    /// Its sides.
    #[prost(message, repeated, tag = "1")]
    pub(crate) dim: Vec<DimensionProto>,
}

/// `TensorShapeProto.Dimension`: a side.
#[derive(Clone, PartialEq, Eq, Message)]
pub(crate) struct DimensionProto {
    /// Its length.
    #[prost(oneof = "Dimension", tags = "1, 2")]
    pub(crate) value: Option<Dimension>,
}

/// The length of a side.
#[derive(Clone, PartialEq, Eq, Oneof)]
pub(crate) enum Dimension {
    /// Fixed.
    #[prost(int64, tag = "1")]
    Value(i64),
    /// Open, by name.
    #[prost(string, tag = "2")]
    Param(String),
}
