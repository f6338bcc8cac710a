//! Numbers that a node computes for each frame.

/// A number of a frame, for example the version of the network that computed it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    /// The number; finite.
    pub value: f64,
}
