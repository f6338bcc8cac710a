//! Why a node or a source failed.

use std::error::Error;

use crate::message::{ErrorMessage, Remedied, chain};

/// A failure of a node, a source or a file they read. The runner adds node, variant and frame.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Something failed.
    #[error(transparent)]
    Failed(ErrorMessage),
    /// The run was cancelled and the node stopped early.
    #[error("cancelled")]
    Cancelled,
}

impl Fault {
    /// A failure described by a lower-case fragment.
    pub fn new(what: impl Into<String>) -> Self {
        Self::Failed(ErrorMessage::new(what))
    }

    fn map(self, change: impl FnOnce(ErrorMessage) -> ErrorMessage) -> Self {
        match self {
            Self::Failed(message) => Self::Failed(change(message)),
            Self::Cancelled => self,
        }
    }

    /// Changes the message, for example to add the file.
    #[must_use]
    pub fn map_what(self, change: impl FnOnce(String) -> String) -> Self {
        self.map(|message| ErrorMessage { what: change(message.what), ..message })
    }

    /// Adds the remedy.
    #[must_use]
    pub fn remedy(self, text: impl Into<String>) -> Self {
        self.map(|message| message.remedy(text))
    }

    /// Adds the error beneath.
    #[must_use]
    pub fn because(self, error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        self.map(|message| message.because(error))
    }

    /// The remedy, if one is known.
    pub fn remedy_text(&self) -> Option<&str> {
        match self {
            Self::Failed(message) => message.remedy.as_deref(),
            Self::Cancelled => None,
        }
    }

    /// The failure and its causes, joined by colons.
    pub fn chain(&self) -> String {
        chain(self)
    }
}

impl Remedied for Fault {
    fn remedy(&self) -> Option<String> {
        self.remedy_text().map(ToOwned::to_owned)
    }
}

impl From<Fault> for ErrorMessage {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Failed(message) => message,
            Fault::Cancelled => Self::new(fault.to_string()),
        }
    }
}
