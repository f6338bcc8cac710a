//! The content of a damaged part of a recording.

use depthloom_graphs::plan::FrameIndex;
use std::fmt;
use std::sync::Arc;

/// The content of a part of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DamagedContent {
    /// Values of a frame.
    Frame {
        /// The stage run's name.
        stage: String,
        /// The frame's position in the stage run.
        position: FrameIndex,
        /// Its id.
        id: Arc<str>,
        /// The topics of the values.
        topics: Vec<String>,
    },
    /// The learning curve of that topic.
    Curve(String),
    /// The attachment of that name.
    Attachment(String),
    /// No value: bytes between values, or a second index of them.
    NoValue,
}

impl fmt::Display for DamagedContent {
    /// The content as a lower-case fragment; of many topics only the first.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN: usize = 4;
        match self {
            Self::Frame { stage, position, id, topics } => {
                let shown = topics[..topics.len().min(SHOWN)].join(", ");
                write!(f, "{shown}")?;
                if topics.len() > SHOWN {
                    write!(f, " and {} more", topics.len() - SHOWN)?;
                }
                write!(f, " of frame `{id}` (position {position} of stage `{stage}`)")
            }
            Self::Curve(topic) => write!(f, "the learning curve {topic}"),
            Self::Attachment(name) => write!(f, "the attachment `{name}`"),
            Self::NoValue => f.write_str("no value, but an index or a header"),
        }
    }
}
