//! The errors of recordings, which name file, place and remedy.

use std::io;
use std::path::PathBuf;

use depthloom_durable::remedy_of_writing;
use depthloom_graphs::{ErrorMessage, Remedied};
use depthloom_mcap::FileError;

use crate::FORMAT;
use crate::read::damaged_content::DamagedContent;

/// Why a recording cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum RecordingError {
    /// The file could not be created.
    #[error("failed to create {}", path.display())]
    Create { path: PathBuf, source: io::Error },
    /// Bytes of the file cannot be read or are damaged.
    #[error(transparent)]
    File(FileError),
    /// The system refused to write bytes.
    #[error("failed to write {} at byte {offset}", path.display())]
    Write { path: PathBuf, offset: u64, source: io::Error },
    /// A write after a failure, or after the end.
    #[error("{} cannot be written any more: {why}", path.display())]
    Closed { path: PathBuf, why: &'static str },
    /// The plan cannot be recorded.
    #[error("topic {topic}: {what}")]
    Plan { topic: String, what: String },
    /// A value cannot be recorded.
    #[error("frame {frame}, topic {topic}: {what}")]
    Value { frame: String, topic: String, what: String },
    /// The file does not start like an MCAP file.
    #[error("{} is not an MCAP file", path.display())]
    NotMcap { path: PathBuf },
    /// An MCAP file that another program wrote, or one that was cut off before its plan was written.
    #[error("{} is an MCAP file, but not a recording of depthloom: it has no plan", path.display())]
    NotARecording { path: PathBuf },
    /// A recording of another format version.
    #[error("{} has recording format {found}, but this version of depthloom reads format {FORMAT} only", path.display())]
    Format { path: PathBuf, found: String },
    /// The checksums are right, but the content is invalid: depthloom does not write this.
    #[error("{} has invalid content, although its checksums are right: {what}", path.display())]
    Content { path: PathBuf, what: String },
    /// A topic that the stage run does not have, or that was not recorded.
    #[error("{} has no values of topic {topic} in {prefix}", path.display())]
    UnknownTopic { path: PathBuf, prefix: String, topic: String, known: Vec<String> },
    /// A stage run, frame or attachment that the recording does not have.
    #[error("{} has no {what}", path.display())]
    Missing { path: PathBuf, what: String },
}

impl Remedied for RecordingError {
    fn remedy(&self) -> Option<String> {
        match self {
            Self::Create { source, .. } | Self::Write { source, .. } => match source.kind() {
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Some(
                    "free some space or choose another folder with --out; `record:` keeps fewer topics, `every` fewer frames"
                        .to_owned(),
                ),
                _ => remedy_of_writing(source).map(ToOwned::to_owned),
            },
            Self::NotMcap { .. } => {
                Some("give the recording.mcap of a run's folder; if it is one, copy it again, or run again".to_owned())
            }
            Self::NotARecording { .. } => Some(
                "give a recording that `depthloom run` made; if it is one, it was cut off: copy it again, or run again"
                    .to_owned(),
            ),
            Self::Format { found, .. } if matches!(found.as_str(), "1" | "2" | "3" | "4" | "5") => {
                Some("run the experiment again, or read it with depthloom 0.1, which wrote it".to_owned())
            }
            Self::Format { .. } => {
                Some("run the experiment again, or read it with the version of depthloom that wrote it".to_owned())
            }
            Self::File(FileError::Damaged { .. }) => Some("copy the file again, or run the experiment again".to_owned()),
            Self::File(error) => error.remedy(),
            Self::Content { .. } => Some("run the experiment again".to_owned()),
            Self::UnknownTopic { known, .. } => Some(format!("it has {}", known.join(", "))),
            Self::Closed { .. } | Self::Plan { .. } | Self::Value { .. } | Self::Missing { .. } => None,
        }
    }
}

impl From<RecordingError> for ErrorMessage {
    fn from(error: RecordingError) -> Self {
        Self { what: error.to_string(), remedy: error.remedy(), source: Some(Box::new(error)) }
    }
}

impl RecordingError {
    /// Whether the error is damage: bytes were changed after they were written.
    #[must_use]
    pub const fn is_damage(&self) -> bool {
        matches!(self, Self::File(FileError::Damaged { .. }))
    }

    /// Adds to the message what the damaged bytes contained.
    pub(crate) fn with_content(self, content: &DamagedContent) -> Self {
        match self {
            Self::File(FileError::Damaged { path, offset, what }) => {
                Self::File(FileError::Damaged { path, offset, what: format!("{what}; it contained {content}") })
            }
            other => other,
        }
    }
}

impl From<FileError> for RecordingError {
    fn from(error: FileError) -> Self {
        Self::File(match error {
            // depthloom compresses only with zstd.
            FileError::Compression { path, offset, compression } => {
                FileError::Damaged { path, offset, what: format!("a chunk is compressed as `{compression}`") }
            }
            other => other,
        })
    }
}
