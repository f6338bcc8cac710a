//! `learn/ssl`: a network taught by the robot's own stereo.

mod batch;
mod loss;
mod params;
mod photometric;
mod train;

pub use loss::Loss;
pub use params::{Schedule, SslParams};
