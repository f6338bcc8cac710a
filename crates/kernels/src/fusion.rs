//! Fusion of stereo and mono depth, as the paper has it, and baselines. It may use `filter`.

pub mod confidence;
pub mod facil;
pub mod fuse;
pub mod inverse_variance;
pub mod median_of;
pub mod scale;
