//! Parameters of `onnx`: how values of ports become tensors, and tensors values.

use std::collections::BTreeMap;

use depthloom_graphs::ValueType;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::onnx::{Channels, Fit, PadAt, PadWith, Provider, Resize, TensorLayout};

/// What an input port takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum InputType {
    /// An image, grey or in colour as the network's input has one channel or three.
    Image,
    /// Depth, metres.
    Depth,
    /// Disparity, px.
    Disparity,
    /// A weight in [0, 1].
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

/// What an output port gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum OutputType {
    /// Depth, metres.
    Depth,
    /// Disparity, px.
    Disparity,
    /// A weight in [0, 1]: what lies outside becomes the nearest end.
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

/// In what a depth is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Form {
    /// As it is.
    #[default]
    Plain,
    /// 1 / value.
    Inverse,
}

/// An input port and its tensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct NetworkInput {
    /// What it takes: `image`, `depth`, `disparity`, `weight` or `mask`.
    #[serde(rename = "type")]
    pub value_type: InputType,
    /// The network's name for it; `null`: the port's, or the network's only one.
    #[serde(default)]
    pub name: Option<String>,
    /// Order of the tensor's axes.
    #[serde(default)]
    pub layout: TensorLayout,
    /// Of an image: the order of its channels.
    #[serde(default)]
    pub channels: Channels,
    /// Of an image: what white is before `mean` and `std`.
    #[serde(default = "one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub white: f64,
    /// Of an image: subtracted from each channel, in the network's order.
    #[serde(default)]
    pub mean: [f64; 3],
    /// Of an image: each channel is then divided by this.
    #[serde(default = "ones")]
    pub std: [f64; 3],
    /// Of a map: `plain`, or `inverse`, 1 / value.
    #[serde(default)]
    pub form: Form,
    /// Of a map: it is multiplied by this, ...
    #[serde(default = "one")]
    pub scale: f64,
    /// ... and this is added.
    #[serde(default)]
    pub offset: f64,
    /// Of a map: what the network sees where there is no answer.
    #[serde(default)]
    pub missing: f64,
}

/// An output port and its tensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct NetworkOutput {
    /// What it gives: `depth`, `disparity`, `weight` or `mask`.
    #[serde(rename = "type")]
    pub value_type: OutputType,
    /// The network's name for it; `null`: the port's, or the network's only one.
    #[serde(default)]
    pub name: Option<String>,
    /// Order of the tensor's axes.
    #[serde(default)]
    pub layout: TensorLayout,
    /// Of several maps the one to take: from 0, or -1 for the last.
    #[serde(default)]
    pub head: Option<i64>,
    /// The tensor is multiplied by this, ...
    #[serde(default = "one")]
    pub scale: f64,
    /// ... this is added, ...
    #[serde(default)]
    pub offset: f64,
    /// ... and it is taken as it is (`plain`), or as 1 / value (`inverse`).
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
    /// Input ports; the port `model` comes by itself.
    pub inputs: BTreeMap<String, NetworkInput>,
    /// Output ports.
    pub outputs: BTreeMap<String, NetworkOutput>,
}

/// Parameters of `onnx`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct NetworkParams {
    /// What goes in and out.
    pub ports: NetworkPorts,
    /// How inputs come to the network's size: `pad` (no pixel is changed) or `resize` (disparities are scaled, there
    /// and back).
    pub fit: Fit,
    /// Columns and rows of what the network sees, px; `null`: what it fixes itself, else the inputs', made a
    /// `multiple`.
    #[schemars(inner(range(min = 1, max = 16384)))]
    pub size: Option<[u32; 2]>,
    /// What columns and rows are made a multiple of where nothing fixes them, px: the network's largest stride.
    #[schemars(range(min = 1, max = 1024))]
    pub multiple: u32,
    /// Where rows and columns are added: `bottom-right`, `top-right`, `top-left` or `centre`.
    pub pad_at: PadAt,
    /// What is added: `edge`, the nearest pixel, or `zero`, in the normalised tensor.
    pub pad_with: PadWith,
    /// How images are resized: `area` or `bilinear`; maps always bilinearly.
    pub resize: Resize,
    /// Whether a resized image is rounded to 8 bits; `area` always is.
    pub round: bool,
    /// Largest depth given, metres; `null` leaves depth uncapped.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
    /// On what the network runs: `cpu`, `cuda`, `tensorrt`, ...; an error where the machine's ONNX Runtime has it not.
    pub provider: Provider,
    /// Threads of ONNX Runtime per frame. More are faster for one frame, and no faster for many: frames run side by
    /// side. tract always has one.
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
