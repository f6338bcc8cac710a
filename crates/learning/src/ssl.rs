//! `learn/ssl`: trains a network with the robot's own stereo.

mod batch;
mod fits;
mod loss;
mod node;
mod objective;
mod params;
mod photometric;
mod weights;

pub(crate) use loss::{Loss, Penalty};
pub(crate) use node::Ssl;
pub(crate) use objective::SelfSupervision;
pub(crate) use params::SslParams;
pub(crate) use weights::{fill, matched};

#[cfg(test)]
mod tests;
