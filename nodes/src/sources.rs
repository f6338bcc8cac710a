//! Where frames come from: data sets and renderers.

mod calibration;
mod dataset;
mod driving_stereo;
mod eth3d_two_view;
mod evaluation;
pub(crate) mod files;
pub mod images;
mod kitti;
mod middlebury;
mod read_ahead;
mod ros2_bag;
mod scene_flow;
mod sintel_stereo;
mod synthetic_road;
pub(crate) mod true_disparity;
#[cfg(any(test, feature = "v4l2"))]
mod v4l2;

pub use synthetic_road::{Road, SyntheticRoadParams, SyntheticTruth};

pub(crate) use dataset::OnDisk;
pub(crate) use driving_stereo::DrivingStereo;
pub(crate) use eth3d_two_view::Eth3dTwoView;
pub(crate) use images::Images;
pub(crate) use kitti::{KittiDepth, KittiOdometry, KittiRaw, KittiStereo2012, KittiStereo2015};
pub(crate) use middlebury::Middlebury;
pub(crate) use ros2_bag::Ros2Bag;
pub(crate) use scene_flow::SceneFlow;
pub(crate) use sintel_stereo::SintelStereo;
pub(crate) use synthetic_road::SyntheticRoad;
#[cfg(feature = "v4l2")]
pub(crate) use v4l2::V4l2;
