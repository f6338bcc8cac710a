//! What of a model is fed and read, whichever engine runs it.

use ort::value::TensorElementType;

/// An input; its f32 values are converted to `element`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Feed {
    pub name: String,
    pub element: Element,
    pub shape: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    F32,
    F16,
    U8,
}

impl Element {
    pub(crate) const fn from_ort(element: TensorElementType) -> Option<Self> {
        match element {
            TensorElementType::Float32 => Some(Self::F32),
            TensorElementType::Float16 => Some(Self::F16),
            TensorElementType::Uint8 => Some(Self::U8),
            _ => None,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Binding {
    pub inputs: Vec<Feed>,
    pub outputs: Vec<String>,
}

/// An output: its shape and its values, row-major.
pub(crate) struct OutputTensor {
    pub shape: Vec<i64>,
    pub values: Vec<f32>,
}

/// Rounds half to even and saturates.
pub(crate) fn bytes(tensor: &[f32]) -> Vec<u8> {
    tensor.iter().map(|value| value.round_ties_even() as u8).collect()
}
