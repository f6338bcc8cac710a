//! Why a recording could not be analysed.

use std::io;
use std::path::{Path, PathBuf};

use depthloom_recording::RecordingError;
use polars::error::PolarsError;

/// Why a recording could not be analysed.
#[derive(Debug, thiserror::Error)]
pub enum AnalysisError {
    /// The recording cannot be read.
    #[error("failed to read the recording")]
    Recording(#[from] RecordingError),
    /// The recording holds something an analysis cannot use.
    #[error("{what}")]
    Content {
        /// What, and where.
        what: String,
    },
    /// A file cannot be written.
    #[error("failed to write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// A file cannot be read.
    #[error("failed to read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// A table cannot be computed or written.
    #[error("failed to compute {what}")]
    Compute {
        /// What was being computed.
        what: String,
        /// What polars said.
        #[source]
        source: Box<PolarsError>,
    },
}

impl AnalysisError {
    /// For `map_err`: what was being computed.
    pub(crate) fn compute(what: impl Into<String>) -> impl FnOnce(PolarsError) -> Self {
        move |source| Self::Compute { what: what.into(), source: Box::new(source) }
    }

    /// For `map_err`: what was being written.
    pub(crate) fn write(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Write { path: path.to_owned(), source }
    }

    /// For `map_err`: what was being read.
    pub(crate) fn read(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Read { path: path.to_owned(), source }
    }

    /// Something in a recording that an analysis cannot use.
    pub(crate) fn content(what: impl Into<String>) -> Self {
        Self::Content { what: what.into() }
    }
}
