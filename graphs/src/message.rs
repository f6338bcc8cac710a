//! Errors in words, for the person who runs the experiment.

use std::error::Error;

/// What is wrong and where, the remedy, and the cause.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct ErrorMessage {
    /// A lower-case fragment that names file and place.
    pub what: String,
    /// The remedy, in the imperative.
    pub remedy: Option<String>,
    /// The cause.
    #[source]
    pub source: Option<Box<dyn Error + Send + Sync>>,
}

impl ErrorMessage {
    /// A lower-case fragment.
    pub fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), remedy: None, source: None }
    }

    /// Adds the remedy.
    #[must_use]
    pub fn remedy(self, text: impl Into<String>) -> Self {
        Self { remedy: Some(text.into()), ..self }
    }

    /// Adds the cause.
    #[must_use]
    pub fn because(self, error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { source: Some(error.into()), ..self }
    }
}

/// An error that may have a remedy.
pub trait Remedied: Error {
    /// What helps, in the imperative; `None` if nothing is known.
    fn remedy(&self) -> Option<String>;
}

impl Remedied for ErrorMessage {
    fn remedy(&self) -> Option<String> {
        self.remedy.clone()
    }
}

/// An error and its causes, joined by colons.
pub fn chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut below = error.source();
    while let Some(error) = below {
        // Some errors end with their source.
        let next = error.to_string();
        if !text.ends_with(&next) {
            text.push_str(": ");
            text.push_str(&next);
        }
        below = error.source();
    }
    text
}
