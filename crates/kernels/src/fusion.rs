//! Fusion of stereo and mono depth: the paper's, mixtures and baselines. It may use `filter`, and `stereo::depth`.

pub mod align;
pub mod confidence;
pub mod facil;
mod functions;
pub mod fuse;
pub mod inverse_variance;
pub mod learned;
pub mod median_of;
pub mod mixture;
pub mod scale;
