//! Where frames come from: data sets and renderers.

mod asked;
mod kitti_calibration;
mod kitti_stereo_2015;
mod png;
mod synthetic_road;

pub use kitti_stereo_2015::{KittiStereo2015, KittiStereo2015Params, KittiTruth, Split};
pub use synthetic_road::{SyntheticRoad, SyntheticRoadParams, SyntheticTruth};

pub(crate) use synthetic_road::Road;
