//! Self-supervised learning of still-mono networks.

pub mod samples;
pub mod networks;
pub mod ops;
pub mod random;
pub mod ssl;
