//! Parameters of `ros2/bag`.

use depthloom_graphs::contracts::{DataPath, FrameSelection};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(super) const KIND: &str = "ros2/bag";
pub(super) const VERSION: u32 = 2;

/// Whether R of the left camera is applied to points before P projects them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PointRotation {
    /// If depthloom rectifies the images. Otherwise their frame is that of the rectified camera.
    #[default]
    Auto,
    /// The frame of the images is that of the camera as mounted.
    Always,
    /// The frame of the images is that of the rectified camera.
    Never,
}

/// Time by which messages are matched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum BagClock {
    /// Time in the header of the message: when it was captured.
    #[default]
    Header,
    /// Time when the message was recorded.
    Log,
}

/// Parameters of `ros2/bag`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Ros2BagParams {
    /// Folder of the bag (with `metadata.yaml`), or one of its files: `.mcap` or `.db3`.
    #[schemars(extend("mandatory" = true))]
    pub path: DataPath,
    /// Topic of the left images. By default that of the only stereo pair: `/.../left/image_rect` and
    /// `/.../right/image_rect`, `infra1` and `infra2`, `cam0` and `cam1`. Rectified topics are preferred.
    pub left: Option<String>,
    /// Topic of the right images. By default the name of `left` with `right` in place of `left`.
    pub right: Option<String>,
    /// Topic of the left `camera_info`. By default the one in the same namespace as the images.
    pub left_info: Option<String>,
    /// Topic of the right `camera_info`. By default the one in the same namespace as the images.
    pub right_info: Option<String>,
    /// Time by which messages are matched: `header` (when they were captured) or `log` (when they were recorded; only
    /// the index is read).
    pub clock: BagClock,
    /// Largest time difference between left and right image, and between both and the ground truth, milliseconds.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub tolerance_ms: f64,
    /// Whether the images are rectified. By default they are if the name of the topic contains `image_rect`, or if
    /// the camera has neither distortion nor rotation. Other images are rectified here by D, K, R and P of
    /// `camera_info`.
    pub rectified: Option<bool>,
    /// Number of bits that the samples of 16-bit images (`mono16`) use: 12 for a 12-bit camera that stores numbers up
    /// to 4095. The upper 8 of them are used. The default is 16.
    #[schemars(range(min = 8, max = 16))]
    pub bits: Option<u32>,
    /// Distance between the cameras, metres, if `camera_info` does not contain it (`P[3]` of the right camera is 0).
    #[schemars(range(min = 1e-4, max = 1e4))]
    pub baseline_m: Option<f64>,
    /// Topic of ground-truth depth, registered to the left image: `16UC1` (millimetres), `32FC1` (metres), or
    /// `compressedDepth` of these.
    pub depth: Option<String>,
    /// Length of one unit of `depth`, metres. The default is 0.001 for `16UC1` and 1 for `32FC1`.
    #[schemars(range(min = 1e-9, max = 1e3))]
    pub depth_unit_m: Option<f64>,
    /// Topic of ground-truth points (`PointCloud2`), projected into the left image through the transforms of
    /// `/tf_static`.
    pub points: Option<String>,
    /// Whether R of the left camera is applied to points before P projects them: `auto` (if depthloom rectifies the
    /// images), `always` or `never`.
    pub points_rotation: PointRotation,
    /// Start of the selected pairs, seconds after the first image was recorded.
    #[schemars(range(min = 0.0))]
    pub start_s: f64,
    /// End of the selected pairs (exclusive), seconds after the first image was recorded. By default the end of the
    /// bag.
    #[schemars(range(min = 0.0))]
    pub end_s: Option<f64>,
    /// Uses every nth pair between `start_s` and `end_s`, beginning with the first.
    #[schemars(range(min = 1))]
    pub every: u64,
    /// Selected frames, by their position among the pairs between `start_s` and `end_s`, from 0. All by default.
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
