//! Messages that are not what they are said to be.

use std::path::Path;

use depthloom_graphs::Fault;

/// What is wrong with a message, as a lower-case fragment, and the remedy if there is one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}")]
pub struct Malformed {
    what: String,
    remedy: Option<String>,
}

impl Malformed {
    pub(crate) fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), remedy: None }
    }

    pub(crate) fn remedy(self, text: impl Into<String>) -> Self {
        Self { remedy: Some(text.into()), ..self }
    }

    /// The failure of a message of a bag and a topic, of that name (its time, say).
    #[must_use]
    pub fn of(self, bag: &Path, topic: &str, message: &str) -> Fault {
        let fault = Fault::new(format!("{}: message {message} of {topic}: {}", bag.display(), self.what));
        let remedy = self.remedy.as_deref();
        fault.remedy(
            remedy.unwrap_or("the message is damaged, or of another type than its topic says; `frames` leaves it out"),
        )
    }
}
