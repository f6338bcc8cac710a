//! Where frames come from: data sets and renderers.

mod asked;
mod camera_files;
mod dataset;
mod driving_stereo;
mod eth3d_two_view;
mod evaluation;
mod float_file;
mod image_file;
mod images;
mod kitti_calibration;
mod kitti_depth;
mod kitti_odometry;
mod kitti_raw;
mod kitti_stems;
mod kitti_stereo_2012;
mod kitti_stereo_2015;
mod kitti_time;
mod middlebury;
mod middlebury_scene;
mod possible;
mod rectified_pair;
mod rectifier;
mod ros2_bag;
mod ros2_frame;
mod scene_flow;
mod sintel_stereo;
mod synthetic_road;
pub(crate) mod true_disparity;

pub use synthetic_road::{Road, SyntheticRoadParams, SyntheticTruth};

pub(crate) use driving_stereo::DrivingStereo;
pub(crate) use eth3d_two_view::Eth3dTwoView;
pub(crate) use images::Images;
pub(crate) use kitti_depth::KittiDepth;
pub(crate) use kitti_odometry::KittiOdometry;
pub(crate) use kitti_raw::KittiRaw;
pub(crate) use kitti_stereo_2012::KittiStereo2012;
pub(crate) use kitti_stereo_2015::KittiStereo2015;
pub(crate) use middlebury::Middlebury;
pub(crate) use ros2_bag::Ros2Bag;
pub(crate) use scene_flow::SceneFlow;
pub(crate) use sintel_stereo::SintelStereo;
pub(crate) use synthetic_road::SyntheticRoad;
