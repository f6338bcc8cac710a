//! A word of the file.

use super::source_file::Place;

/// A word, and where it is written.
#[derive(Clone, Debug)]
pub struct Word {
    /// The word.
    pub text: String,
    /// Where it is written.
    pub place: Place,
}
