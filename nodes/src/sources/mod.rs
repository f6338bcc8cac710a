//! Where frames come from: data sets and renderers.

mod asked;
mod kitti_calibration;
mod kitti_stereo_2015;
mod png;
mod synthetic_road;
pub(crate) mod true_disparity;

pub use synthetic_road::{SyntheticRoadParams, SyntheticTruth};

pub(crate) use kitti_stereo_2015::KittiStereo2015;
pub(crate) use synthetic_road::{Road, SyntheticRoad};
