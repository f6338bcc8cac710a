//! `learn/ssl`: trains a network with the robot's own stereo.

mod batch;
mod fits;
mod loss;
mod node;
mod objective;
mod params;
mod photometric;
mod weights;

pub(crate) use node::Ssl;

#[cfg(test)]
mod tests;
