//! Fusion of stereo and mono depth. It may use `filter`, and `stereo::depth`.

pub mod align;
pub mod confidence;
pub mod fuse;
pub mod learned;
pub mod mixture;
pub mod scale;
