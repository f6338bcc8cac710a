//! Messages that cannot be read, as failures of the frame that they belong to.

use std::path::Path;

use depthloom_graphs::{ErrorMessage, Fault};

/// The failure of a message with this name (for example its time) in a topic of a bag.
#[must_use]
pub fn message_fault(error: ErrorMessage, bag: &Path, topic: &str, message: &str) -> Fault {
    let ErrorMessage { what, remedy, .. } = error;
    let what = format!("{}: message {message} of {topic}: {what}", bag.display());
    let default = "the message is damaged or has another type than its topic; exclude it with `frames`";
    Fault::new(what).remedy(remedy.as_deref().unwrap_or(default))
}
