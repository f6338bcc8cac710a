//! What can go wrong with a recording, naming file, place and remedy.

use std::io;
use std::path::{Path, PathBuf};

use depthloom_durable::remedy_of_writing;
use depthloom_graphs::{ErrorMessage, Remedied};

use crate::read::damaged_content::DamagedContent;

/// Why a recording cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file could not be made.
    #[error("failed to create {}", path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// The file could not be opened.
    #[error("failed to open {}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// The disk refused bytes.
    #[error("failed to write {} at byte {offset}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// How many bytes it held.
        offset: u64,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// The disk refused to give bytes.
    #[error("failed to read {} at byte {offset}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// Something was written after a failure, or after the end.
    #[error("{} takes no more values: {why}", path.display())]
    Closed {
        /// The file.
        path: PathBuf,
        /// What happened before.
        why: &'static str,
    },
    /// The plan cannot be recorded.
    #[error("topic {topic}: {what}")]
    Plan {
        /// The topic at fault.
        topic: String,
        /// What is wrong with it.
        what: String,
    },
    /// A value cannot be kept.
    #[error("frame {frame}, topic {topic}: {what}")]
    Value {
        /// The frame's id.
        frame: String,
        /// The topic.
        topic: String,
        /// What is wrong with it.
        what: String,
    },
    /// The file does not start as an MCAP file does.
    #[error("{} is not an MCAP file", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// An MCAP file of somebody else, or one cut off before its plan was written.
    #[error("{} is an MCAP file, but holds no plan of depthloom", path.display())]
    NotARecording {
        /// The file.
        path: PathBuf,
    },
    /// A recording of another format version.
    #[error("{} has recording format {found}; this engine reads formats {}", path.display(), known.join(" and "))]
    Format {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: String,
        /// The formats known here.
        known: &'static [&'static str],
    },
    /// Bytes that are not what was written.
    #[error("{} is damaged at byte {offset}: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What is wrong there.
        what: String,
    },
    /// What is to be read does not fit into memory.
    #[error("{} holds {bytes} bytes at byte {offset} that do not fit into this machine's memory", path.display())]
    Memory {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// How many bytes.
        bytes: u64,
    },
    /// A recording that says what none of ours does, though its checksums hold.
    #[error("{} cannot be what depthloom wrote: {what}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What it says.
        what: String,
    },
    /// A topic that the stage run does not have, or that was not recorded.
    #[error("{} has no values of topic {topic} in {prefix}", path.display())]
    UnknownTopic {
        /// The file.
        path: PathBuf,
        /// The stage run's prefix.
        prefix: String,
        /// The topic asked for.
        topic: String,
        /// The topics it has.
        known: Vec<String>,
    },
    /// A stage run, frame or attachment that the recording does not have.
    #[error("{} has no {what}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// What was asked for.
        what: String,
    },
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
            Self::NotMcap { .. } => Some("give the recording.mcap of a run's folder".to_owned()),
            Self::NotARecording { .. } => Some("give a recording that `depthloom run` made".to_owned()),
            Self::Format { found, .. } if found == "1" => {
                Some("read it with depthloom 0.1.0, which made it, or run the experiment again".to_owned())
            }
            Self::Format { .. } => Some("read it with the version that made it, or run the experiment again".to_owned()),
            Self::Damaged { .. } => Some("copy the file again, or run the experiment again".to_owned()),
            Self::Content { .. } => Some("run the experiment again".to_owned()),
            Self::Memory { .. } => Some("read it on a machine with more memory".to_owned()),
            Self::UnknownTopic { known, .. } => Some(format!("it has {}", known.join(", "))),
            Self::Open { .. }
            | Self::Read { .. }
            | Self::Closed { .. }
            | Self::Plan { .. }
            | Self::Value { .. }
            | Self::Missing { .. } => None,
        }
    }
}

impl From<RecordingError> for ErrorMessage {
    fn from(error: RecordingError) -> Self {
        Self { what: error.to_string(), remedy: error.remedy(), source: Some(Box::new(error)) }
    }
}

impl RecordingError {
    /// What the system said, if it was asked.
    pub(crate) fn into_cause(self) -> Option<io::Error> {
        match self {
            Self::Create { source, .. }
            | Self::Open { source, .. }
            | Self::Write { source, .. }
            | Self::Read { source, .. } => Some(source),
            _ => None,
        }
    }

    /// Whether bytes were found that are not what was written.
    #[must_use]
    pub const fn is_damage(&self) -> bool {
        matches!(self, Self::Damaged { .. })
    }

    /// Says what the damaged bytes held.
    pub(crate) fn with_content(self, content: &DamagedContent) -> Self {
        match self {
            Self::Damaged { path, offset, what } => {
                Self::Damaged { path, offset, what: format!("{what}; it held {content}") }
            }
            other => other,
        }
    }

    pub(crate) fn damaged(path: &Path, offset: u64, what: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), offset, what: what.into() }
    }
}
