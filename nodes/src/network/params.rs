//! Parameters of `onnx`: how values of ports become tensors, and tensors values.

use std::collections::BTreeMap;

use depthloom_graphs::ValueType;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::onnx::{Channels, Fit, PadAt, PadWith, Provider, Resize, TensorLayout};

/// Type of an input port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum InputType {
    /// An image, grey or colour, depending on whether the network's input has one channel or three.
    Image,
    /// Depth, metres.
    Depth,
    /// Disparity, px.
    Disparity,
    /// A confidence in [0, 1].
    Weight,
    /// A mask: 1 where set, 0 elsewhere.
    Mask,
}

impl InputType {
    pub(super) const fn value_type(self) -> ValueType {
        match self {
            Self::Image => ValueType::Image,
            Self::Depth => ValueType::Depth,
            Self::Disparity => ValueType::Disparity,
            Self::Weight => ValueType::Weight,
            Self::Mask => ValueType::Mask,
        }
    }
}

/// Type of an output port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum OutputType {
    /// Depth, metres.
    Depth,
    /// Disparity, px.
    Disparity,
    /// A confidence in [0, 1]; values outside are clamped.
    Weight,
    /// A mask: set above 0.5.
    Mask,
}

impl OutputType {
    pub(super) const fn value_type(self) -> ValueType {
        match self {
            Self::Depth => ValueType::Depth,
            Self::Disparity => ValueType::Disparity,
            Self::Weight => ValueType::Weight,
            Self::Mask => ValueType::Mask,
        }
    }
}

/// Whether a map is the value or its inverse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Form {
    /// The value itself.
    #[default]
    Plain,
    /// 1 / value.
    Inverse,
}

/// An input port and its tensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct NetworkInput {
    /// Type of the values: `image`, `depth`, `disparity`, `weight` or `mask`.
    #[serde(rename = "type")]
    pub value_type: InputType,
    /// Name of the tensor in the network; `null` uses the name of the port, or the network's only one.
    #[serde(default)]
    pub name: Option<String>,
    /// Order of the tensor's axes.
    #[serde(default)]
    pub layout: TensorLayout,
    /// Images: order of the channels.
    #[serde(default)]
    pub channels: Channels,
    /// Images: value of white before `mean` and `std`; 1 (default) or 255.
    #[serde(default = "one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub white: f64,
    /// Images: subtracted from each channel, in the network's channel order.
    #[serde(default)]
    pub mean: [f64; 3],
    /// Images: divisor of each channel, after `mean`.
    #[serde(default = "ones")]
    pub std: [f64; 3],
    /// Maps: `plain` (default) passes the value, `inverse` passes 1 / value.
    #[serde(default)]
    pub form: Form,
    /// Maps: factor on the value (or its inverse), before `offset`.
    #[serde(default = "one")]
    pub scale: f64,
    /// Maps: added after `scale`.
    #[serde(default)]
    pub offset: f64,
    /// Maps: number that the network sees at invalid pixels.
    #[serde(default)]
    pub missing: f64,
}

/// An output port and its tensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct NetworkOutput {
    /// Type of the values: `depth`, `disparity`, `weight` or `mask`.
    #[serde(rename = "type")]
    pub value_type: OutputType,
    /// Name of the tensor in the network; `null` uses the name of the port, or the network's only one.
    #[serde(default)]
    pub name: Option<String>,
    /// Order of the tensor's axes.
    #[serde(default)]
    pub layout: TensorLayout,
    /// Index of the map to use if the tensor holds several: from 0, or -1 for the last.
    #[serde(default)]
    pub head: Option<i64>,
    /// Factor on the tensor, before `offset`.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added after `scale`.
    #[serde(default)]
    pub offset: f64,
    /// Applied last: `plain` (default) keeps the number, `inverse` uses 1 / number.
    #[serde(default)]
    pub form: Form,
}

const fn one() -> f64 {
    1.0
}

const fn ones() -> [f64; 3] {
    [1.0; 3]
}

/// The ports of a network, by name.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct NetworkPorts {
    /// Input ports. The port `model` is added automatically.
    #[schemars(extend("mandatory" = true))]
    pub inputs: BTreeMap<String, NetworkInput>,
    /// Output ports.
    #[schemars(extend("mandatory" = true))]
    pub outputs: BTreeMap<String, NetworkOutput>,
}

/// Parameters of `onnx`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct NetworkParams {
    /// Input and output ports.
    pub ports: NetworkPorts,
    /// How inputs are brought to the network's size: `pad` (no pixel is changed) or `resize` (disparities are scaled
    /// with the width, in both directions).
    pub fit: Fit,
    /// Columns and rows of the network's inputs, px; `null` uses what the model fixes, else the size of the inputs,
    /// rounded up to `multiple`.
    #[schemars(inner(range(min = 1, max = 16384)))]
    pub size: Option<[u32; 2]>,
    /// Columns and rows are rounded up to a multiple of this where nothing fixes them, px. Use the largest stride of
    /// the network.
    #[schemars(range(min = 1, max = 1024))]
    pub multiple: u32,
    /// Where rows and columns are added: `bottom-right`, `top-right`, `top-left` or `centre`.
    pub pad_at: PadAt,
    /// Value of added pixels: `edge` (the nearest pixel), or `zero` in the normalised tensor.
    pub pad_with: PadWith,
    /// Interpolation of resized images: `area` or `bilinear` (default). Maps are always resized bilinearly.
    pub resize: Resize,
    /// Whether a resized image is rounded to 8 bits. `area` always rounds.
    pub round: bool,
    /// Largest depth in the output, metres; `null` does not limit depth.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
    /// Hardware that runs the network: `cpu`, `cuda`, `tensorrt`, ... It is an error if this machine's ONNX Runtime
    /// lacks it.
    pub provider: Provider,
    /// Threads of ONNX Runtime per frame. More threads speed up one frame, not many frames, because frames run in
    /// parallel. tract always uses one.
    #[schemars(range(min = 1, max = 256), extend("operational" = true))]
    pub threads: u32,
}

impl Default for NetworkParams {
    fn default() -> Self {
        Self {
            ports: NetworkPorts::default(),
            fit: Fit::Pad,
            size: None,
            multiple: 32,
            pad_at: PadAt::BottomRight,
            pad_with: PadWith::Edge,
            resize: Resize::Bilinear,
            round: false,
            cap: Some(80.0),
            provider: Provider::Cpu,
            threads: 1,
        }
    }
}
