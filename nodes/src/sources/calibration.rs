//! Calibrations of camera pairs: from files, checked, and applied to images.

pub(crate) mod camera_files;
pub(crate) mod rectified_pair;
pub(crate) mod rectifier;
