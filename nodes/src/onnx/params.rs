//! Parameters of `mono/onnx`: input format, meaning of the output, provider.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fit::Fit;
use super::flip::Flip;
use super::provider::Provider;

/// The order of the input tensor's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum TensorLayout {
    /// Batch, channels, rows, columns: PyTorch's.
    #[default]
    Nchw,
    /// Batch, rows, columns, channels: TensorFlow's.
    Nhwc,
}

impl TensorLayout {
    pub(super) const fn axes(self) -> &'static str {
        match self {
            Self::Nchw => "batch x channels x rows x columns (layout: nchw)",
            Self::Nhwc => "batch x rows x columns x channels (layout: nhwc)",
        }
    }
}

/// The order of the input's channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Channels {
    /// Red first.
    #[default]
    Rgb,
    /// Blue first.
    Bgr,
}

/// How the image is brought to the network's size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Resize {
    /// Mean over each pixel's area, rounded to 8 bits: OpenCV's `INTER_AREA`.
    #[default]
    Area,
    /// Bilinear with half-pixel centres, in f32.
    Bilinear,
}

pub(crate) fn check_preprocessing(std: [f64; 3], resize: Resize, round: bool) -> Result<(), (&'static str, String)> {
    if std.contains(&0.0) {
        return Err(("std", "std must not be 0: every channel is divided by it".to_owned()));
    }
    check_resize(resize, round)
}

pub(crate) fn check_resize(resize: Resize, round: bool) -> Result<(), (&'static str, String)> {
    match (resize, round) {
        (Resize::Area, false) => {
            Err(("round", "resize: area always rounds to 8 bits; round: false goes with resize: bilinear".to_owned()))
        }
        _ => Ok(()),
    }
}

/// What the network's output means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Output {
    /// Disparity as a share of the image's width.
    #[default]
    DisparityShare,
    /// Disparity in pixels of the network's own input.
    DisparityPx,
    /// 1 / depth, 1/m.
    InverseDepth,
    /// Depth, metres.
    Depth,
}

/// Parameters of `mono/onnx`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct OnnxParams {
    /// Order of the input tensor's axes: `nchw` or `nhwc`.
    pub layout: TensorLayout,
    /// Order of the input's channels: `rgb` or `bgr`.
    pub channels: Channels,
    /// What white is before `mean` and `std`: 1, or 255 of networks that take bytes.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub white: f64,
    /// Subtracted from each channel, in the network's order of channels.
    pub mean: [f64; 3],
    /// Each channel is then divided by this.
    pub std: [f64; 3],
    /// How the image comes to the network's size: `resize`, or `pad` (rows and columns are added below and to the
    /// right, and no pixel is changed).
    pub fit: Fit,
    /// Columns and rows of the network's image, px; `null`: the network says it itself, or `multiple`.
    #[schemars(inner(range(min = 1, max = 16384)))]
    pub size: Option<[u32; 2]>,
    /// Where neither the network nor `size` fixes columns and rows: the image's own are raised to a multiple of this,
    /// px. 14 of networks with patches of 14 px; `null`: such a network needs a `size`.
    #[schemars(range(min = 1, max = 1024))]
    pub multiple: Option<u32>,
    /// How the image is resized, where it is: `area` or `bilinear`.
    pub resize: Resize,
    /// Whether the resized image is rounded to 8 bits; `area` always is.
    pub round: bool,
    /// Name of the network's input; `null`: its only one.
    pub input_name: Option<String>,
    /// Name of the network's output; `null`: the first whose shape can be that of a map.
    pub output_name: Option<String>,
    /// Of an output that holds several maps (heads, channels) the one to take: from 0, or -1 for the last.
    pub head: Option<i64>,
    /// What the output means: `disparity-share`, `disparity-px`, `inverse-depth` or `depth`; `null`: what the model
    /// says of itself (those of `learn/ssl` do), else `disparity-share`.
    pub output: Option<Output>,
    /// The output is multiplied by this first.
    pub output_scale: f64,
    /// Smallest disparity taken, px of the image; smaller ones are raised to it.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub floor_px: f64,
    /// Largest depth given, metres, before any scaling; `null` leaves depth uncapped.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
    /// Whether the network sees the mirrored image too, and how both answers are joined: `none`, `mean` or `godard`.
    pub flip: Flip,
    /// On what the network runs: `cpu`, `cuda`, `tensorrt`, ...; an error where the machine's ONNX Runtime has it not.
    pub provider: Provider,
    /// Threads of ONNX Runtime per frame. More are faster for one frame, and no faster for many: frames run side by
    /// side. tract always has one.
    #[schemars(range(min = 1, max = 256), extend("operational" = true))]
    pub threads: u32,
}

impl Default for OnnxParams {
    fn default() -> Self {
        Self {
            layout: TensorLayout::Nchw,
            channels: Channels::Rgb,
            white: 1.0,
            mean: [0.0; 3],
            std: [1.0; 3],
            fit: Fit::Resize,
            size: None,
            multiple: None,
            resize: Resize::Area,
            round: true,
            input_name: None,
            output_name: None,
            head: None,
            output: None,
            output_scale: 1.0,
            floor_px: 1e-3,
            cap: Some(80.0),
            flip: Flip::None,
            provider: Provider::Cpu,
            threads: 1,
        }
    }
}
