//! Parameters of `ros2/bag`.

use depthloom_graphs::contracts::{DataPath, FrameSelection};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(super) const KIND: &str = "ros2/bag";
pub(super) const VERSION: u32 = 2;

/// Whether R of the left camera turns points before P projects them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PointRotation {
    /// Where the images are rectified here; otherwise the frame of the images is the rectified camera's.
    #[default]
    Auto,
    /// The frame of the images is the camera's as it is mounted.
    Always,
    /// The frame of the images is the rectified camera's.
    Never,
}

/// By which time messages belong together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum BagClock {
    /// The time in a message's header: when it was taken.
    #[default]
    Header,
    /// The time when it was recorded.
    Log,
}

/// Parameters of `ros2/bag`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Ros2BagParams {
    /// The bag's folder (with `metadata.yaml`), or one file of it: `.mcap` or `.db3`.
    pub path: DataPath,
    /// The left camera's images. By default of the one stereo pair that there is: `/.../left/image_rect` and
    /// `/.../right/image_rect`, `infra1` and `infra2`, `cam0` and `cam1`; rectified ones before others.
    pub left: Option<String>,
    /// The right camera's images. By default what `left` is called with `right` in place of `left`.
    pub right: Option<String>,
    /// The left camera's `camera_info`. By default the one beside its images.
    pub left_info: Option<String>,
    /// The right camera's `camera_info`. By default the one beside its images.
    pub right_info: Option<String>,
    /// By which time messages belong together: `header` (when they were taken) or `log` (when they were recorded:
    /// nothing but the index is read for it).
    pub clock: BagClock,
    /// How far a right image may be from its left one, and truth from both, milliseconds.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub tolerance_ms: f64,
    /// Whether the images are rectified. By default they are where the topic's name says so (`image_rect`), or where
    /// the camera neither distorts nor is turned; others are rectified here, by D, K, R and P of `camera_info`.
    pub rectified: Option<bool>,
    /// How many bits the samples of 16-bit images (`mono16`) use: 12 of a 12-bit camera that stores them as numbers up
    /// to 4095. Of these the upper 8 are taken. Default: 16.
    #[schemars(range(min = 8, max = 16))]
    pub bits: Option<u32>,
    /// Metres between the cameras, where `camera_info` does not say it (`P[3]` of the right camera is 0).
    #[schemars(range(min = 1e-4, max = 1e4))]
    pub baseline_m: Option<f64>,
    /// A topic of depths as truth, registered to the left image: `16UC1` (millimetres), `32FC1` (metres), or
    /// `compressedDepth` of these.
    pub depth: Option<String>,
    /// How many metres a unit of `depth` is. By default 0.001 of `16UC1` and 1 of `32FC1`.
    #[schemars(range(min = 1e-9, max = 1e3))]
    pub depth_unit_m: Option<f64>,
    /// A topic of points (`PointCloud2`) as truth, projected into the left image through the transforms of
    /// `/tf_static`.
    pub points: Option<String>,
    /// Whether R of the left camera turns the points before P projects them: `auto` (where the images are rectified
    /// here), `always` or `never`.
    pub points_rotation: PointRotation,
    /// Seconds from the recording of the first image to the first that is taken.
    #[schemars(range(min = 0.0))]
    pub start_s: f64,
    /// Seconds from the recording of the first image to the first that is no longer taken. By default all are.
    #[schemars(range(min = 0.0))]
    pub end_s: Option<f64>,
    /// Of the pairs between `start_s` and `end_s` the first and every so many after it.
    #[schemars(range(min = 1))]
    pub every: u64,
    /// Which frames, by their count among the pairs between `start_s` and `end_s`, from 0. By default all.
    pub frames: FrameSelection,
}

impl Default for Ros2BagParams {
    fn default() -> Self {
        Self {
            path: DataPath::default(),
            left: None,
            right: None,
            left_info: None,
            right_info: None,
            clock: BagClock::Header,
            tolerance_ms: 10.0,
            rectified: None,
            bits: None,
            baseline_m: None,
            depth: None,
            depth_unit_m: None,
            points: None,
            points_rotation: PointRotation::Auto,
            start_s: 0.0,
            end_s: None,
            every: 1,
            frames: FrameSelection::All,
        }
    }
}
