//! `learn/ssl`: trains a network with the robot's own stereo.

mod batch;
mod checkpoint;
mod fits;
mod loss;
mod node;
mod params;
mod photometric;
mod train;
mod weights;

pub(crate) use node::Ssl;

#[cfg(test)]
mod tests;
