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
    /// Name of the input of the left image; `null`: the network's first.
    pub left_name: Option<String>,
    /// Name of the input of the right image; `null`: the network's second. A network of one input takes both images as
    /// channels of it.
    pub right_name: Option<String>,
    /// In an input that takes both images: which comes first, `left-right` or `right-left`.
    pub order: PairOrder,
    /// Order of the input tensors' axes: `nchw` or `nhwc`.
    pub layout: TensorLayout,
    /// Order of an image's channels: `rgb` or `bgr`. Whether the network sees grey or colour, its inputs say.
    pub channels: Channels,
    /// What white is before `mean` and `std`: 1, or 255 of networks that take bytes.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub white: f64,
    /// Subtracted from each channel, in the network's order of channels.
    pub mean: [f64; 3],
    /// Each channel is then divided by this.
    pub std: [f64; 3],
    /// How images come to the network's size: `pad` (no pixel is changed) or `resize` (disparities are scaled back).
    pub fit: Fit,
    /// Columns and rows of what the network sees, px; `null`: what it fixes itself, else the image's, made a
    /// `multiple`.
    #[schemars(inner(range(min = 1, max = 16384)))]
    pub size: Option<[u32; 2]>,
    /// What columns and rows are made a multiple of where nothing fixes them, px: the network's largest stride.
    #[schemars(range(min = 1, max = 1024))]
    pub multiple: u32,
    /// Where rows and columns are added: `bottom-right`, `top-right`, `top-left` or `centre`.
    pub pad_at: PadAt,
    /// What is added: `edge`, the nearest pixel, or `zero`, in the normalised image.
    pub pad_with: PadWith,
    /// How images are resized: `area` or `bilinear`.
    pub resize: Resize,
    /// Whether the resized image is rounded to 8 bits; `area` always is.
    pub round: bool,
    /// Name of the network's output; `null`: the first whose shape can be that of a map.
    pub output_name: Option<String>,
    /// Of an output that holds several maps (heads, channels, steps of refinement) the one to take: from 0, or -1 for
    /// the last.
    pub head: Option<i64>,
    /// What the output means: `disparity-px`, `disparity-share`, `inverse-depth` or `depth`.
    pub output: StereoOutput,
    /// The output is multiplied by this first; -1 where disparities come out negative.
    pub output_scale: f64,
    /// Answers below are none, px of the image.
    #[schemars(range(min = -2046, max = 2046))]
    pub min_disparity: i32,
    /// Whether depth is given as well, of the network's own numbers; wants the calibration.
    pub depth: bool,
    /// Largest depth given, metres; `null` leaves depth uncapped.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
    /// Whether the right image's disparity is given as well, for `disparity/left-right`: the network sees both images
    /// mirrored and exchanged.
    pub right_view: bool,
    /// On what the network runs: `cpu`, `cuda`, `tensorrt`, ...; an error where the machine's ONNX Runtime has it not.
    pub provider: Provider,
    /// Threads of ONNX Runtime per frame. More are faster for one frame, and no faster for many: frames run side by
    /// side. tract always has one.
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
