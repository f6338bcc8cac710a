//! What went wrong, in words for the person who runs the experiment.

use std::error::Error;

/// An error in words: what is wrong and where, what helps, and the error beneath.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct ErrorMessage {
    /// A lower-case fragment that names file and place.
    pub what: String,
    /// What the person can do about it, in the imperative.
    pub remedy: Option<String>,
    /// The error beneath.
    #[source]
    pub source: Option<Box<dyn Error + Send + Sync>>,
}

impl ErrorMessage {
    /// A lower-case fragment and nothing else.
    #[must_use]
    pub fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), remedy: None, source: None }
    }

    /// Adds what the person can do about it.
    #[must_use]
    pub fn remedy(self, text: impl Into<String>) -> Self {
        Self { remedy: Some(text.into()), ..self }
    }

    /// Adds the error beneath.
    #[must_use]
    pub fn because(self, error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { source: Some(error.into()), ..self }
    }
}

/// An error that may know what a person can do about it.
pub trait Remedied: Error {
    /// What helps, in the imperative; `None` if nothing is known.
    fn remedy(&self) -> Option<String>;
}

impl Remedied for ErrorMessage {
    fn remedy(&self) -> Option<String> {
        self.remedy.clone()
    }
}

/// An error and everything beneath it, joined by colons.
#[must_use]
pub fn chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut below = error.source();
    while let Some(error) = below {
        // Some errors repeat their source in their own words.
        let next = error.to_string();
        if !text.ends_with(&next) {
            text.push_str(": ");
            text.push_str(&next);
        }
        below = error.source();
    }
    text
}
