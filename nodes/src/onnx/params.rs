//! Parameters of `mono/onnx`: input format, meaning of the output, provider.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fit::{Fit, Side};
use super::flip::Flip;
use super::provider::Provider;

/// The order of the input tensor's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum TensorLayout {
    /// Batch, channels, rows, columns (PyTorch).
    #[default]
    Nchw,
    /// Batch, rows, columns, channels (TensorFlow).
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
    /// Bicubic with half-pixel centres, in f32: OpenCV's `INTER_CUBIC`.
    Bicubic,
}

/// How the channels of the image are normalised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Normalisation {
    /// By `mean` and `std`.
    #[default]
    Custom,
    /// ImageNet's: mean 0.485, 0.456, 0.406 and standard deviation 0.229, 0.224, 0.225 of red, green and blue.
    Imagenet,
    /// Mean and standard deviation 0.5: from -1 to 1.
    Half,
}

pub(crate) fn check_preprocessing(std: [f64; 3], resize: Resize, round: bool) -> Result<(), (&'static str, String)> {
    if std.contains(&0.0) {
        return Err(("std", "std contains 0: every channel is divided by `std`".to_owned()));
    }
    check_resize(resize, round)
}

pub(crate) fn check_resize(resize: Resize, round: bool) -> Result<(), (&'static str, String)> {
    match (resize, round) {
        (Resize::Area, false) => Err((
            "round",
            "round is false, but `resize: area` always rounds to 8 bits; use `resize: bilinear` or `bicubic`"
                .to_owned(),
        )),
        _ => Ok(()),
    }
}

/// What the network's output means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Output {
    /// Disparity divided by the image's width.
    #[default]
    DisparityShare,
    /// Disparity in pixels of the network's input.
    DisparityPx,
    /// 1 / depth, 1/m.
    InverseDepth,
    /// Inverse depth of unknown scale and shift, larger = nearer.
    RelativeInverseDepth,
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
    /// Value of white before `mean` and `std`: 1 (default), or 255 for networks that take bytes.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub white: f64,
    /// Subtracted from each channel, in the network's channel order.
    pub mean: [f64; 3],
    /// Divisor of each channel, after `mean`.
    pub std: [f64; 3],
    /// Mean and standard deviation of known data sets, in place of `mean` and `std`: `imagenet`, `half` (0.5), or
    /// `custom`, which uses `mean` and `std`.
    pub normalisation: Normalisation,
    /// How the image is brought to the size of the network: `resize`, or `pad` (adds rows below and columns at the
    /// right; no pixel is changed).
    pub fit: Fit,
    /// Columns and rows of the network's input, px; `null` uses the size that the model fixes, else `multiple`.
    #[schemars(inner(range(min = 1, max = 16384)))]
    pub size: Option<[u32; 2]>,
    /// The image is resized so that its shorter side has this length, px; each side is then rounded to the nearest
    /// multiple of `multiple`, and up where that would be shorter than this. The aspect ratio changes by the rounding
    /// only. Needs a model with an open size.
    #[schemars(range(min = 1, max = 16384))]
    pub short_side: Option<u32>,
    /// As `short_side`, for the longer side: sides are rounded down where they would be longer than this.
    #[schemars(range(min = 1, max = 16384))]
    pub long_side: Option<u32>,
    /// With `short_side` or `long_side`, what sides are multiples of, px; `null` is 1. Otherwise used if neither the
    /// model nor `size` fixes the size: columns and rows of the image are rounded up to a multiple of this, px. Use 14
    /// for networks with patches of 14 px. With `null` such a network needs `size`.
    #[schemars(range(min = 1, max = 1024))]
    pub multiple: Option<u32>,
    /// Interpolation if the image is resized: `area`, `bilinear` or `bicubic`. The default differs between kinds:
    /// `area` for
    /// `mono/onnx`, `bilinear` for `stereo/onnx` and `onnx`.
    pub resize: Resize,
    /// Whether the resized image is rounded to 8 bits. `area` always rounds, so `false` requires `bilinear` or
    /// `bicubic`.
    pub round: bool,
    /// Name of the network's input; `null` uses the only one.
    pub input_name: Option<String>,
    /// Name of the network's output; `null` uses the first whose shape is that of a map.
    pub output_name: Option<String>,
    /// Name of an output with the standard deviation of log depth, a map of its own; with it, the node has the output
    /// `deviation`. Networks that `learn/ssl` trained with `spread: true` name it `spread`.
    pub spread_name: Option<String>,
    /// Index of the map to use if an output holds several (heads, channels): from 0, or -1 for the last.
    pub head: Option<i64>,
    /// What the output means: `disparity-share`, `disparity-px`, `inverse-depth`, `relative-inverse-depth` or `depth`.
    /// `null` uses what the
    /// model's metadata state (networks trained by `learn/ssl` do), else `disparity-share`.
    pub output: Option<Output>,
    /// Factor on the output, applied before `output` interprets it (`scale` in the ports of `onnx`).
    pub output_scale: f64,
    /// Smallest disparity, px of the image; smaller ones are raised to it.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub floor_px: f64,
    /// Largest depth in the output, metres, applied before any scaling; `null` does not limit depth.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
    /// Whether the network also sees the mirrored image, and how both outputs are merged: `none`, `mean` or `godard`.
    pub flip: Flip,
    /// Hardware that runs the network: `cpu`, `cuda`, `tensorrt`, ... It is an error if this machine's ONNX Runtime
    /// lacks it.
    pub provider: Provider,
    /// Threads of ONNX Runtime per frame. More threads speed up one frame, not many frames, because frames run in
    /// parallel. tract always uses one.
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
            normalisation: Normalisation::Custom,
            fit: Fit::Resize,
            size: None,
            short_side: None,
            long_side: None,
            multiple: None,
            resize: Resize::Area,
            round: true,
            input_name: None,
            output_name: None,
            spread_name: None,
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

impl OnnxParams {
    /// Mean and standard deviation of the channels, in the network's channel order.
    pub(crate) fn moments(&self) -> ([f64; 3], [f64; 3]) {
        let ordered = |mut of_rgb: [f64; 3]| {
            if self.channels == Channels::Bgr {
                of_rgb.reverse();
            }
            of_rgb
        };
        match self.normalisation {
            Normalisation::Custom => (self.mean, self.std),
            Normalisation::Imagenet => (ordered([0.485, 0.456, 0.406]), ordered([0.229, 0.224, 0.225])),
            Normalisation::Half => ([0.5; 3], [0.5; 3]),
        }
    }

    /// The side to whose length the image is resized.
    pub(crate) fn side(&self) -> Option<Side> {
        let short = self.short_side.map(|px| Side::Short(px as usize));
        short.or(self.long_side.map(|px| Side::Long(px as usize)))
    }

    /// Parameters that exclude each other.
    pub(crate) fn check(&self) -> Result<(), (&'static str, String)> {
        check_preprocessing(self.std, self.resize, self.round)?;
        if self.spread_name.is_some() && self.output == Some(Output::RelativeInverseDepth) {
            let what =
                "spread_name is set, but `output: relative-inverse-depth` has no depth, so no standard deviation";
            return Err(("spread_name", what.to_owned()));
        }
        let is_custom = self.mean == [0.0; 3] && self.std == [1.0; 3];
        if self.normalisation != Normalisation::Custom && !is_custom {
            let what = "normalisation replaces `mean` and `std`: remove these, or use `normalisation: custom`";
            return Err(("normalisation", what.to_owned()));
        }
        let (name, other) = match (self.short_side, self.long_side) {
            (None, None) => return Ok(()),
            (Some(_), Some(_)) => ("short_side", "`long_side`"),
            (Some(_), None) if self.size.is_some() => ("short_side", "`size`"),
            (None, Some(_)) if self.size.is_some() => ("long_side", "`size`"),
            (Some(_), None) if self.fit == Fit::Pad => ("short_side", "`fit: pad`"),
            (None, Some(_)) if self.fit == Fit::Pad => ("long_side", "`fit: pad`"),
            _ => return Ok(()),
        };
        Err((name, format!("{name} cannot be combined with {other}: remove one of them")))
    }
}
