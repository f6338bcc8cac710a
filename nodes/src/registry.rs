//! The kinds this engine knows.

use depthloom_graphs::Registry;

use crate::confidence::{Edges, Sobel};
use crate::depth::{DepthFiles, FromDisparity, GuidedUpsampling};
use crate::disparity::{DisparityFiles, Fill, LeftRight, Speckle, WeightedLeastSquares};
use crate::dora::Dora;
use crate::filter::Median;
use crate::fusion::{Confidence, Facil, InverseVariance, LearnReliability, Learned, MedianOf, Mixture, Scale};
use crate::mono::{GroundPlane, Onnx};
use crate::network::OnnxNetwork;
use crate::process::{Process, ProcessSource};
use crate::score::{ScoreDepth, ScoreDisparity};
use crate::sources::{
    DrivingStereo, Eth3dTwoView, Images, KittiDepth, KittiOdometry, KittiRaw, KittiStereo2012, KittiStereo2015,
    Middlebury, OnDisk, Ros2Bag, SceneFlow, SintelStereo, SyntheticRoad,
};
use crate::stereo::{Bm, CensusSgm, Sgbm, StereoOnnx};

/// Every source and node kind of this crate, one line each.
#[must_use]
pub fn registry() -> Registry {
    let registry = Registry::default();
    #[cfg(feature = "v4l2")]
    let registry = registry.source::<crate::sources::V4l2>();
    registry
        .source::<OnDisk<KittiStereo2015>>()
        .source::<OnDisk<KittiStereo2012>>()
        .source::<OnDisk<KittiRaw>>()
        .source::<OnDisk<KittiDepth>>()
        .source::<OnDisk<KittiOdometry>>()
        .source::<OnDisk<Images>>()
        .source::<Ros2Bag>()
        .source::<OnDisk<Middlebury>>()
        .source::<OnDisk<Eth3dTwoView>>()
        .source::<OnDisk<SintelStereo>>()
        .source::<OnDisk<SceneFlow>>()
        .source::<OnDisk<DrivingStereo>>()
        .source::<SyntheticRoad>()
        .source::<ProcessSource>()
        .node::<Sgbm>()
        .node::<Bm>()
        .node::<CensusSgm>()
        .node::<StereoOnnx>()
        .node::<LeftRight>()
        .node::<Speckle>()
        .node::<Fill>()
        .node::<WeightedLeastSquares>()
        .node::<DisparityFiles>()
        .node::<DepthFiles>()
        .node::<FromDisparity>()
        .node::<GuidedUpsampling>()
        .node::<Edges>()
        .node::<Sobel>()
        .node::<GroundPlane>()
        .node::<Onnx>()
        .node::<OnnxNetwork>()
        .node::<Scale>()
        .node::<Confidence>()
        .node::<Learned>()
        .node::<Mixture>()
        .node::<LearnReliability>()
        .node::<Facil>()
        .node::<InverseVariance>()
        .node::<MedianOf>()
        .node::<Median>()
        .node::<Process>()
        .node::<Dora>()
        .node::<ScoreDepth>()
        .node::<ScoreDisparity>()
}
