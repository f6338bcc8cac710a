//! What went wrong in a node or source, in words for the person who runs the experiment.

use std::error::Error;

/// A failure of a node, a source or a file they read. The runner adds node, variant and frame.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Something failed; `what` is a lower-case sentence fragment that names file and place.
    #[error("{what}")]
    Failed {
        /// What failed, and where.
        what: String,
        /// What the person can do about it.
        remedy: Option<String>,
        /// The error beneath, if any.
        #[source]
        source: Option<Box<dyn Error + Send + Sync>>,
    },
    /// The run was cancelled and the node stopped early.
    #[error("cancelled")]
    Cancelled,
}

impl Fault {
    /// A failure described by a lower-case fragment.
    #[must_use]
    pub fn new(what: impl Into<String>) -> Self {
        Self::Failed { what: what.into(), remedy: None, source: None }
    }

    /// Adds what the person can do about it.
    #[must_use]
    pub fn remedy(self, text: impl Into<String>) -> Self {
        match self {
            Self::Failed { what, source, .. } => Self::Failed { what, remedy: Some(text.into()), source },
            Self::Cancelled => self,
        }
    }

    /// Adds the error beneath.
    #[must_use]
    pub fn because(self, error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        match self {
            Self::Failed { what, remedy, .. } => Self::Failed { what, remedy, source: Some(error.into()) },
            Self::Cancelled => self,
        }
    }

    /// The remedy, if one is known.
    #[must_use]
    pub fn remedy_text(&self) -> Option<&str> {
        match self {
            Self::Failed { remedy, .. } => remedy.as_deref(),
            Self::Cancelled => None,
        }
    }

    /// The failure and everything beneath it, joined by colons.
    #[must_use]
    pub fn chain(&self) -> String {
        let mut text = self.to_string();
        let mut below = self.source();
        while let Some(error) = below {
            text.push_str(": ");
            text.push_str(&error.to_string());
            below = error.source();
        }
        text
    }
}
