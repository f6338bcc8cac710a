//! Where frames come from: data sets and renderers.

mod asked;
mod dataset;
mod image_file;
mod kitti_calibration;
mod kitti_depth;
mod kitti_odometry;
mod kitti_raw;
mod kitti_stems;
mod kitti_stereo_2012;
mod kitti_stereo_2015;
mod kitti_time;
mod synthetic_road;
pub(crate) mod true_disparity;

pub use synthetic_road::{SyntheticRoadParams, SyntheticTruth};

pub(crate) use kitti_depth::KittiDepth;
pub(crate) use kitti_odometry::KittiOdometry;
pub(crate) use kitti_raw::KittiRaw;
pub(crate) use kitti_stereo_2012::KittiStereo2012;
pub(crate) use kitti_stereo_2015::KittiStereo2015;
pub(crate) use synthetic_road::{Road, SyntheticRoad};
