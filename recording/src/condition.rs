//! In what condition a recording was found.

use std::fmt;

/// In what condition a recording was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// Its writer finished it, and all that was read of it is what was written.
    Whole,
    /// Its writer did not finish it: it was killed or still writes, or it says that its run was interrupted or failed.
    /// Every frame that was committed is there.
    Unfinished {
        /// How many bytes stand behind the last of them, and belong to no frame.
        rest_bytes: u64,
    },
    /// `recover` made it of one that was unfinished or damaged: frames may be missing at its end.
    Recovered,
    /// Bytes are not what was written.
    Damaged {
        /// Where.
        offset: u64,
        /// What is wrong there.
        what: String,
        /// Whether frames or once-values that stood behind may be lost: then it is read up to the last commit before.
        /// Otherwise only the summary was damaged, and was not needed.
        cut: bool,
    },
}

impl Condition {
    /// Its name, for programs: `whole`, `unfinished`, `recovered` or `damaged`.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Whole => "whole",
            Self::Unfinished { .. } => "unfinished",
            Self::Recovered => "recovered",
            Self::Damaged { .. } => "damaged",
        }
    }
}

impl fmt::Display for Condition {
    /// What is wrong, as a lower-case fragment.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => f.write_str("whole"),
            Self::Unfinished { rest_bytes: 0 } => f.write_str("unfinished"),
            Self::Unfinished { rest_bytes } => {
                write!(f, "unfinished, and its last {rest_bytes} bytes belong to no whole frame")
            }
            Self::Recovered => f.write_str("recovered from an unfinished or damaged one"),
            Self::Damaged { offset, what, cut: true } => {
                write!(f, "damaged at byte {offset}: {what}; what comes behind was left out")
            }
            Self::Damaged { offset, what, cut: false } => {
                write!(f, "damaged at byte {offset}: {what}; nothing is lost")
            }
        }
    }
}
