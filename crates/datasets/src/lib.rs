//! Data sets as files: contradictions within a frame ([`inspection`]), and a synthetic street in KITTI's layout
//! ([`kitti_layout`]).

pub mod inspection;
pub mod kitti_layout;
