//! The condition of a recording that was opened.

use std::fmt;

/// The condition of a recording that was opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// Its writer finished it, and no damage was found in what was read.
    Complete,
    /// Its writer did not finish it: the process was killed, still writes, or ended early after an interrupt or a
    /// failure. Every committed frame can be read.
    Unfinished {
        /// The number of bytes after the last complete frame; they belong to no frame.
        rest_bytes: u64,
    },
    /// `recover` copied it from an unfinished or damaged recording: frames may be missing at its end.
    Recovered,
    /// Some bytes were changed after they were written.
    Damaged {
        /// The offset of the damage.
        offset: u64,
        /// What is wrong there.
        what: String,
        /// Whether frames or aggregate values after the damage may be lost: then the recording is read up to the last
        /// commit before it. Otherwise only the summary is damaged, which was not needed.
        cut: bool,
    },
}

impl Condition {
    /// The name of the condition in JSON: `complete`, `unfinished`, `recovered` or `damaged`.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Complete => "complete",
            Self::Unfinished { .. } => "unfinished",
            Self::Recovered => "recovered",
            Self::Damaged { .. } => "damaged",
        }
    }
}

impl fmt::Display for Condition {
    /// The condition as a lower-case fragment.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Complete => f.write_str("complete"),
            Self::Unfinished { rest_bytes: 0 } => f.write_str("unfinished"),
            Self::Unfinished { rest_bytes } => {
                write!(f, "unfinished: its last {rest_bytes} bytes are not part of a complete frame")
            }
            Self::Recovered => f.write_str("recovered from an unfinished or damaged recording"),
            Self::Damaged { offset, what, cut: true } => {
                write!(f, "damaged at byte {offset}: {what}; what follows was left out")
            }
            Self::Damaged { offset, what, cut: false } => {
                write!(f, "damaged at byte {offset}: {what}; nothing is lost")
            }
        }
    }
}
