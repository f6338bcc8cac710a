//! `learn/fusion`: trains a network to fuse stereo with a monocular estimate.
//!
//! Parts of stereo are hidden from the network or replaced by wrong disparities; trusted stereo is the target
//! there.

mod batch;
mod blocks;
mod loss;
mod node;
mod objective;
mod params;

pub(crate) use node::TrainFusion;

#[cfg(test)]
mod tests;
