//! Self-supervised learning of still-mono networks.

pub mod samples;
