//! `learn/ssl`: a network taught by the robot's own stereo.

mod batch;
mod checkpoint;
mod fits;
mod loss;
mod node;
mod params;
mod photometric;
mod train;
mod weights;

pub use loss::Loss;
pub use node::Ssl;
pub use params::{Schedule, SslParams};

#[cfg(test)]
mod tests;
