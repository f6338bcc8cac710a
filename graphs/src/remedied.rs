//! Errors that know what helps.

use std::error::Error;

/// An error that may know what a person can do about it.
pub trait Remedied: Error {
    /// What helps, in the imperative; `None` where nothing is known.
    fn remedy(&self) -> Option<String>;
}
