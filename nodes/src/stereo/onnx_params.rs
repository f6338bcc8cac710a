//! Parameters of `stereo/onnx`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::onnx::{Channels, Fit, PadAt, PadWith, Provider, Resize, TensorLayout};

/// What the output of a stereo network means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum StereoOutput {
    /// Disparity in pixels of what the network sees.
    #[default]
    DisparityPx,
    /// Disparity as a share of the width of what the network sees.
    DisparityShare,
    /// 1 / depth, 1/m.
    InverseDepth,
    /// Depth, metres.
    Depth,
}

/// The order of the images in an input that takes both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum PairOrder {
    /// The left image's channels first.
    #[default]
    LeftRight,
    /// The right image's channels first.
    RightLeft,
}

/// Parameters of `stereo/onnx`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct StereoOnnxParams {
    /// Name of the input for the left image; `null` uses the network's first.
    pub left_name: Option<String>,
    /// Name of the input for the right image; `null` uses the network's second. A network with one input takes both
    /// images as its channels.
    pub right_name: Option<String>,
    /// Order of the images in an input that takes both: `left-right` or `right-left`.
    pub order: PairOrder,
    /// Order of the input tensors' axes: `nchw` or `nhwc`.
    pub layout: TensorLayout,
    /// Order of an image's channels: `rgb` or `bgr`. The shape of the inputs decides whether the network sees grey or
    /// colour.
    pub channels: Channels,
    /// Value of white before `mean` and `std`: 1 (default), or 255 for networks that take bytes.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub white: f64,
    /// Subtracted from each channel, in the network's channel order.
    pub mean: [f64; 3],
    /// Divisor of each channel, after `mean`.
    pub std: [f64; 3],
    /// How images are brought to the network's size: `pad` (no pixel is changed) or `resize` (disparities are scaled
    /// back).
    pub fit: Fit,
    /// Columns and rows of the network's input, px; `null` uses what the model fixes, else the size of the image,
    /// rounded up to `multiple`.
    #[schemars(inner(range(min = 1, max = 16384)))]
    pub size: Option<[u32; 2]>,
    /// Columns and rows are rounded up to a multiple of this where nothing fixes them, px. Use the largest stride of
    /// the network.
    #[schemars(range(min = 1, max = 1024))]
    pub multiple: u32,
    /// Where rows and columns are added: `bottom-right`, `top-right`, `top-left` or `centre`.
    pub pad_at: PadAt,
    /// Value of added pixels: `edge` (the nearest pixel), or `zero` in the normalised image.
    pub pad_with: PadWith,
    /// Interpolation of resized images: `area` or `bilinear` (default; `mono/onnx` uses `area`).
    pub resize: Resize,
    /// Whether the resized image is rounded to 8 bits. `area` always rounds.
    pub round: bool,
    /// Name of the network's output; `null` uses the first whose shape is that of a map.
    pub output_name: Option<String>,
    /// Index of the map to use if an output holds several (heads, channels, refinement steps): from 0, or -1 for the
    /// last.
    pub head: Option<i64>,
    /// What the output means: `disparity-px`, `disparity-share`, `inverse-depth` or `depth`.
    pub output: StereoOutput,
    /// Factor on the output, applied before `output` interprets it (`scale` in the ports of `onnx`). Use -1 if the
    /// network outputs negative disparities.
    pub output_scale: f64,
    /// Smaller disparities are invalid, px of the image.
    #[schemars(range(min = -2046, max = 2046))]
    pub min_disparity: i32,
    /// Whether the node also outputs depth, from the network's unrounded numbers; requires `calibration`.
    pub depth: bool,
    /// Largest depth in the output, metres; `null` does not limit depth.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
    /// Whether the node also outputs the right image's disparity, for `disparity/left-right`. The network then also
    /// sees both images mirrored and exchanged.
    pub right_view: bool,
    /// Hardware that runs the network: `cpu`, `cuda`, `tensorrt`, ... It is an error if this machine's ONNX Runtime
    /// lacks it.
    pub provider: Provider,
    /// Threads of ONNX Runtime per frame. More threads speed up one frame, not many frames, because frames run in
    /// parallel. tract always uses one.
    #[schemars(range(min = 1, max = 256), extend("operational" = true))]
    pub threads: u32,
}

impl Default for StereoOnnxParams {
    fn default() -> Self {
        Self {
            left_name: None,
            right_name: None,
            order: PairOrder::LeftRight,
            layout: TensorLayout::Nchw,
            channels: Channels::Rgb,
            white: 1.0,
            mean: [0.0; 3],
            std: [1.0; 3],
            fit: Fit::Pad,
            size: None,
            multiple: 32,
            pad_at: PadAt::BottomRight,
            pad_with: PadWith::Edge,
            resize: Resize::Bilinear,
            round: false,
            output_name: None,
            head: None,
            output: StereoOutput::DisparityPx,
            output_scale: 1.0,
            min_disparity: 0,
            depth: true,
            cap: Some(80.0),
            right_view: false,
            provider: Provider::Cpu,
            threads: 1,
        }
    }
}

impl StereoOnnxParams {
    pub(super) const fn wants_calibration(&self) -> bool {
        self.depth || matches!(self.output, StereoOutput::InverseDepth | StereoOutput::Depth)
    }
}
