//! An aggregate value stored as bytes: a trained model, collected samples, an estimated reliability.

use std::sync::Arc;

use super::{Value, ValueType};
use crate::Key;

/// Bytes with a media type and their content hash.
#[derive(Clone, Debug)]
pub struct Artifact {
    /// What the bytes are, e.g. `application/onnx`.
    pub media_type: String,
    /// The bytes themselves.
    pub bytes: Arc<[u8]>,
    /// The content hash, used in keys and file names.
    pub hash: Key,
}

impl Artifact {
    /// The media type for [`Artifact::model`].
    pub const MODEL: &str = "application/onnx";
    /// The media type for [`Artifact::samples`].
    pub const SAMPLES: &str = "samples/depthloom";
    /// The media type for [`Artifact::reliability`].
    pub const RELIABILITY: &str = "application/json";

    /// A network in an ONNX file.
    pub fn model(file: impl Into<Arc<[u8]>>) -> Self {
        Self::new(Self::MODEL, file)
    }

    /// Training samples as `learn/samples` collects them.
    pub fn samples(bytes: impl Into<Arc<[u8]>>) -> Self {
        Self::new(Self::SAMPLES, bytes)
    }

    /// The reliability of stereo and a monocular estimate as `learn/reliability` estimates it.
    pub fn reliability(text: String) -> Self {
        Self::new(Self::RELIABILITY, text.into_bytes())
    }

    /// The content of a file as a value of a type; `None` for types of other values.
    pub(crate) fn of_type(value_type: ValueType, file: impl Into<Arc<[u8]>>) -> Option<Value> {
        let media_type = match value_type {
            ValueType::Samples => Self::SAMPLES,
            ValueType::Model => Self::MODEL,
            ValueType::Reliability => Self::RELIABILITY,
            _ => return None,
        };
        Value::from_artifact(value_type, Arc::new(Self::new(media_type, file)))
    }

    /// Wraps bytes and hashes them.
    pub fn new(media_type: impl Into<String>, bytes: impl Into<Arc<[u8]>>) -> Self {
        let bytes = bytes.into();
        Self { media_type: media_type.into(), hash: Key::of_content(&bytes), bytes }
    }
}
