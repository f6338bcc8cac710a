//! Weights by name: the tensors of a `.safetensors` file, or the constants of an ONNX file.
//!
//! Reads IEEE single, half and double and bfloat16, all as f32. Integers are not weights (an ONNX file has shapes among
//! its constants, PyTorch counts batches) and are skipped; other types are an error.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use half::{bf16, f16};
use prost::Message;
use safetensors::tensor::{Dtype, SafeTensorError, SafeTensors};

use depthloom_onnx::{TensorProto, data_type};

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NamedTensor {
    pub(crate) name: String,
    /// Its sides, the last fastest; none for a scalar.
    pub(crate) dims: Vec<usize>,
    pub(crate) values: Vec<f32>,
}

#[derive(Debug, thiserror::Error)]
pub(crate) enum WeightsError {
    #[error("{} is neither a .safetensors nor an .onnx file, going by its name", .0.display())]
    Format(PathBuf),
    #[error("{} is damaged, or not a .safetensors file", path.display())]
    SafeTensors { path: PathBuf, source: SafeTensorError },
    #[error("{} is damaged, or not an ONNX file", path.display())]
    Onnx { path: PathBuf, source: prost::DecodeError },
    #[error("tensor `{name}` of {}", path.display())]
    Tensor { path: PathBuf, name: String, source: TensorError },
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum TensorError {
    /// Another one has its name.
    #[error("two tensors have this name")]
    Twice,
    /// Elements that are neither floats nor integers, or floats of a rare kind.
    #[error("its elements have type {0}; supported are f32, f16, bf16 and f64")]
    ElementType(String),
    #[error("invalid sides {0:?}")]
    Sides(Vec<i64>),
    #[error("it has {found} elements, but its sides {dims:?} require {wanted}")]
    Count {
        /// How many there are, a part of one included.
        found: usize,
        wanted: usize,
        dims: Vec<usize>,
    },
    /// The elements are not in this file.
    #[error("its elements are stored in another file: save the network as one file")]
    Elsewhere,
}

/// The tensors of a `.safetensors` file, in the order of their bytes, or the constants of an `.onnx` file, in the
/// file's order; `path` tells the format.
pub(crate) fn decode_weights(path: &Path, bytes: &[u8]) -> Result<Vec<NamedTensor>, WeightsError> {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if extension == "safetensors" {
        of_safetensors(path, bytes)
    } else if extension == "onnx" {
        of_onnx(path, bytes)
    } else {
        Err(WeightsError::Format(path.to_owned()))
    }
}

fn of_safetensors(path: &Path, bytes: &[u8]) -> Result<Vec<NamedTensor>, WeightsError> {
    let damaged = |source| WeightsError::SafeTensors { path: path.to_owned(), source };
    // Sides and places are checked against the file's length before anything is taken.
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
    let file = SafeTensors::deserialize(bytes).map_err(damaged)?;
    let mut order: Vec<_> = header.tensors().into_iter().map(|(name, info)| (info.data_offsets, name)).collect();
    order.sort_unstable(); // tensors without elements share a place: then by name
    let mut tensors = Vec::with_capacity(order.len());
    for (_, name) in order {
        let view = file.tensor(&name).map_err(damaged)?;
        let values = match view.dtype() {
            Dtype::F32 => numbers(view.data(), f32::from_le_bytes),
            Dtype::F16 => numbers(view.data(), |bytes| f16::from_le_bytes(bytes).to_f32()),
            Dtype::BF16 => numbers(view.data(), |bytes| bf16::from_le_bytes(bytes).to_f32()),
            Dtype::F64 => numbers(view.data(), |bytes| f64::from_le_bytes(bytes) as f32),
            Dtype::BOOL
            | Dtype::U8
            | Dtype::I8
            | Dtype::U16
            | Dtype::I16
            | Dtype::U32
            | Dtype::I32
            | Dtype::U64
            | Dtype::I64 => continue,
            rare => {
                let source = TensorError::ElementType(format!("{rare:?}"));
                return Err(WeightsError::Tensor { path: path.to_owned(), name, source });
            }
        };
        tensors.push(NamedTensor { dims: view.shape().to_vec(), values, name });
    }
    Ok(tensors)
}

/// `ModelProto`, of which constants alone are wanted: operators, of which a hostile file announces millions in a few
/// bytes each, are skipped.
#[derive(Clone, PartialEq, Message)]
struct ModelOfConstants {
    #[prost(message, optional, tag = "7")]
    graph: Option<GraphOfConstants>,
}

/// `GraphProto` likewise: each constant as the bytes of its `TensorProto`, decoded one by one.
#[derive(Clone, PartialEq, Message)]
struct GraphOfConstants {
    #[prost(bytes = "vec", repeated, tag = "5")]
    initializer: Vec<Vec<u8>>,
}

fn of_onnx(path: &Path, bytes: &[u8]) -> Result<Vec<NamedTensor>, WeightsError> {
    let damaged = |source| WeightsError::Onnx { path: path.to_owned(), source };
    let model = ModelOfConstants::decode(bytes).map_err(damaged)?;
    let mut tensors = Vec::new();
    let mut names = HashSet::new();
    for bytes in model.graph.unwrap_or_default().initializer {
        let tensor = TensorProto::decode(bytes.as_slice()).map_err(damaged)?;
        let name = tensor.name.clone();
        let read = if names.insert(name.clone()) { of_proto(tensor) } else { Err(TensorError::Twice) };
        tensors.extend(read.map_err(|source| WeightsError::Tensor { path: path.to_owned(), name, source })?);
    }
    Ok(tensors)
}

fn of_proto(tensor: TensorProto) -> Result<Option<NamedTensor>, TensorError> {
    let kind = tensor.data_type;
    if IS_INTEGER.contains(&kind) {
        return Ok(None);
    }
    if tensor.data_location != 0 {
        return Err(TensorError::Elsewhere);
    }
    let sides: Option<Vec<usize>> = tensor.dims.iter().map(|&side| usize::try_from(side).ok()).collect();
    let sides = sides.and_then(|sides| {
        let wanted = sides.iter().try_fold(1_usize, |product, &side| product.checked_mul(side))?;
        Some((sides, wanted))
    });
    let Some((dims, wanted)) = sides else { return Err(TensorError::Sides(tensor.dims)) };
    // Elements are in `raw_data`, or in the field of their type.
    let raw = tensor.raw_data.filter(|raw| !raw.is_empty());
    let halves = |of: fn(u16) -> f32| tensor.int32_data.iter().map(|&bits| of(bits as u16)).collect();
    let (size, values): (usize, Vec<f32>) = match (kind, &raw) {
        (data_type::FLOAT, Some(raw)) => (4, numbers(raw, f32::from_le_bytes)),
        (data_type::FLOAT, None) => (4, tensor.float_data),
        (data_type::FLOAT16, Some(raw)) => (2, numbers(raw, |bytes| f16::from_le_bytes(bytes).to_f32())),
        (data_type::FLOAT16, None) => (2, halves(|bits| f16::from_bits(bits).to_f32())),
        (data_type::BFLOAT16, Some(raw)) => (2, numbers(raw, |bytes| bf16::from_le_bytes(bytes).to_f32())),
        (data_type::BFLOAT16, None) => (2, halves(|bits| bf16::from_bits(bits).to_f32())),
        (data_type::DOUBLE, Some(raw)) => (8, numbers(raw, |bytes| f64::from_le_bytes(bytes) as f32)),
        (data_type::DOUBLE, None) => (8, tensor.double_data.iter().map(|&value| value as f32).collect()),
        (rare, _) => return Err(TensorError::ElementType(format!("{rare} (TensorProto.DataType)"))),
    };
    let found = raw.map_or(values.len(), |raw| raw.len().div_ceil(size));
    if found != wanted || values.len() != wanted {
        return Err(TensorError::Count { found, wanted, dims });
    }
    Ok(Some(NamedTensor { name: tensor.name, dims, values }))
}

/// `TensorProto.DataType`: 8, 16, 32 and 64 bits with and without sign, and bool.
const IS_INTEGER: [i32; 9] = [2, 3, 4, 5, 6, data_type::INT64, 9, 12, 13];

fn numbers<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks::<N>().0.iter().map(|&bytes| number(bytes)).collect()
}

#[cfg(test)]
mod tests;
