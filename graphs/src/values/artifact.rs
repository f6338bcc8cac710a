//! An aggregate value stored as bytes: a trained model, collected samples.

use std::sync::Arc;

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

    /// A network in an ONNX file.
    pub fn model(file: impl Into<Arc<[u8]>>) -> Self {
        Self::new(Self::MODEL, file)
    }

    /// Training samples as `learn/samples` collects them.
    pub fn samples(bytes: impl Into<Arc<[u8]>>) -> Self {
        Self::new(Self::SAMPLES, bytes)
    }

    /// Wraps bytes and hashes them.
    pub fn new(media_type: impl Into<String>, bytes: impl Into<Arc<[u8]>>) -> Self {
        let bytes = bytes.into();
        Self { media_type: media_type.into(), hash: Key::of_content(&bytes), bytes }
    }
}
