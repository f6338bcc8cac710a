//! Fusion of stereo and mono depth, as the paper has it. It may use `filter`.

pub mod align;
pub mod confidence;
pub mod fuse;
pub mod scale;
