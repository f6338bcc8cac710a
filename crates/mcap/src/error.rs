//! Why bytes of a file cannot be read: file, byte and remedy.

use std::io;
use std::path::PathBuf;

use depthloom_graphs::{ErrorMessage, Fault, Remedied};

/// The remedy for a bag that is not as it was written.
pub const COPY_AGAIN: &str =
    "copy the bag again, or repair it with `ros2 bag reindex` (folder) or `mcap recover` (file)";

/// Why bytes of a file cannot be read.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum FileError {
    /// The file could not be opened.
    #[error("failed to open {}", path.display())]
    Open { path: PathBuf, source: io::Error },
    /// The system could not read bytes.
    #[error("failed to read {} at byte {offset}", path.display())]
    Read { path: PathBuf, offset: u64, source: io::Error },
    /// Bytes that are not what was written.
    #[error("{} is damaged at byte {offset}: {what}", path.display())]
    Damaged { path: PathBuf, offset: u64, what: String },
    /// A chunk whose compression is not known.
    #[error("{}: the chunk at byte {offset} is compressed as `{compression}`", path.display())]
    Compression { path: PathBuf, offset: u64, compression: String },
    /// The bytes do not fit into memory.
    #[error("{} holds {bytes} bytes at byte {offset} that do not fit into this machine's memory", path.display())]
    Memory { path: PathBuf, offset: u64, bytes: u64 },
}

impl Remedied for FileError {
    fn remedy(&self) -> Option<String> {
        let remedy = match self {
            Self::Open { .. } | Self::Read { .. } => return None,
            Self::Damaged { .. } => COPY_AGAIN,
            Self::Compression { .. } => {
                "zstd, lz4 and none are read; `mcap compress` or `ros2 bag convert` writes it again"
            }
            Self::Memory { .. } => "read it on a machine with more memory",
        };
        Some(remedy.to_owned())
    }
}

impl From<FileError> for Fault {
    fn from(error: FileError) -> Self {
        Self::Failed(ErrorMessage { what: error.to_string(), remedy: error.remedy(), source: Some(Box::new(error)) })
    }
}
