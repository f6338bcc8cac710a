//! Networks, one file each, described once for training, for counting parameters and for ONNX.
//!
//! A network is a function from a [`Builder`]'s image to its map. What a builder makes of a layer differs: [`layout`]
//! lists parameters, [`compute`](crate::compute) computes, [`export`](export()) writes ONNX.

mod eigen_coarse;
mod export;
mod fcn_lite;
mod fcn_vgg16;
mod fusion_unet;
mod layout;
mod unet_lite;
mod unet_tiny;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(crate) use export::export;
pub(crate) use fusion_unet::FusionUnet;
pub(crate) use layout::{Parameter, ParameterLayout, layout};

pub(crate) use crate::onnx::Meaning;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size {
    pub(crate) width: usize,
    pub(crate) height: usize,
}

/// The networks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Network {
    /// Small U-Net with skips: 1.07 M parameters.
    #[default]
    UnetLite,
    /// `unet-lite` with fewer channels: 70 k parameters, a file of less than 300 kB.
    UnetTiny,
    /// `unet-lite` without skips.
    FcnLite,
    /// The paper's: the convolutions of VGG-16, the first 8 frozen, and two deconvolutions.
    FcnVgg16,
    /// The on-board one: the coarse scale of Eigen et al. 2014, depth up to 10 m.
    EigenCoarse,
}

impl Network {
    #[cfg(test)]
    pub(crate) const fn without_spread(self) -> Monocular {
        Monocular { network: self, spread: false }
    }

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::UnetLite => "unet-lite",
            Self::UnetTiny => "unet-tiny",
            Self::FcnLite => "fcn-lite",
            Self::FcnVgg16 => "fcn-vgg16",
            Self::EigenCoarse => "eigen-coarse",
        }
    }

    pub(crate) const fn meaning(self) -> Meaning {
        match self {
            Self::UnetLite | Self::UnetTiny | Self::FcnLite | Self::FcnVgg16 => Meaning::DisparityShare { scale: 0.1 },
            Self::EigenCoarse => Meaning::Depth { farthest_m: 10.0 },
        }
    }

    /// Rows and columns of the image must be multiples of this.
    pub(crate) const fn multiple(self) -> usize {
        match self {
            Self::UnetLite | Self::UnetTiny | Self::FcnLite => 32,
            Self::FcnVgg16 => 16,
            Self::EigenCoarse => 32,
        }
    }

    /// A size of images that shows its parameters, where they are the same for every size; `None` of a network with
    /// dense layers.
    pub(crate) const fn any_size(self) -> Option<Size> {
        match self {
            Self::UnetLite | Self::UnetTiny | Self::FcnLite | Self::FcnVgg16 => Some(Size { width: 32, height: 32 }),
            Self::EigenCoarse => None,
        }
    }
}

/// What a network's file states about its input and outputs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Interface {
    /// Name of the input.
    pub(crate) input: &'static str,
    /// Planes of the input.
    pub(crate) planes: usize,
    /// How the input is made.
    pub(crate) normalisation: &'static str,
    /// One for each of the network's maps.
    pub(crate) outputs: Vec<NetworkOutput>,
}

/// An output of a network's file: a map in [0, 1] times a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NetworkOutput {
    /// What it means.
    pub(crate) name: &'static str,
    pub(crate) scale: f32,
}

/// A network as layers.
pub(crate) trait Architecture: Copy {
    fn name(self) -> &'static str;

    fn interface(self) -> Interface;

    /// Lays the network out with `builder`, from its planes to maps in [0, 1], one for each output.
    fn build<B: Builder>(self, builder: &mut B, planes: &B::Map) -> Vec<B::Map>;
}

/// A monocular network, with or without a map of its own uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Monocular {
    pub(crate) network: Network,
    /// Whether a second map predicts the error: the scale of a Laplace distribution of the log of the disparity share.
    pub(crate) spread: bool,
}

impl Architecture for Monocular {
    fn name(self) -> &'static str {
        self.network.name()
    }

    fn interface(self) -> Interface {
        let (input, normalisation, meaning) = ("image", "RGB in [0,1], area resized", self.network.meaning());
        let mut outputs = vec![NetworkOutput { name: meaning.name(), scale: meaning.scale() }];
        if self.spread {
            // The standard deviation of a Laplace distribution is sqrt(2) times its scale.
            outputs.push(NetworkOutput { name: "spread", scale: std::f32::consts::SQRT_2 });
        }
        Interface { input, planes: 3, normalisation, outputs }
    }

    fn build<B: Builder>(self, builder: &mut B, image: &B::Map) -> Vec<B::Map> {
        let features = match self.network {
            Network::UnetLite => unet_lite::unet_lite(builder, image),
            Network::UnetTiny => unet_tiny::unet_tiny(builder, image),
            Network::FcnLite => fcn_lite::fcn_lite(builder, image),
            Network::FcnVgg16 => fcn_vgg16::fcn_vgg16(builder, image),
            Network::EigenCoarse => {
                assert!(!self.spread, "eigen-coarse predicts no spread");
                return vec![eigen_coarse::eigen_coarse(builder, image)];
            }
        };
        let mut maps = vec![unet_lite::last(builder, "last", &features, unet_lite::FIRST_BIAS)];
        if self.spread {
            // From a spread of 1/2, about the error at the start.
            maps.push(unet_lite::last(builder, "last_spread", &features, 0.0));
        }
        maps
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Act {
    None,
    Relu,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Conv {
    pub(crate) outputs: usize,
    pub(crate) kernel: usize,
    /// Step, px.
    pub(crate) stride: usize,
    /// Zeros around the image, px.
    pub(crate) pad: usize,
    pub(crate) act: Act,
    pub(crate) frozen: bool,
    pub(crate) bias: f32,
}

impl Conv {
    /// 3x3 and ReLU, the size kept.
    const fn three(outputs: usize) -> Self {
        Self { outputs, kernel: 3, stride: 1, pad: 1, act: Act::Relu, frozen: false, bias: 0.0 }
    }

    /// Whether it is of stride 1 and keeps the size.
    pub(crate) const fn keeps_size(&self) -> bool {
        self.stride == 1 && self.kernel == 2 * self.pad + 1
    }
}

pub(crate) trait Builder {
    type Map: Clone;

    fn conv(&mut self, name: &str, x: &Self::Map, conv: Conv) -> Self::Map;
    /// A 4x4 transposed convolution of stride 2 and ReLU: twice the rows and columns.
    fn double(&mut self, name: &str, x: &Self::Map, outputs: usize) -> Self::Map;
    /// The largest of every 2x2 samples: half the rows and columns.
    fn halve(&mut self, x: &Self::Map) -> Self::Map;
    /// The channels of both, the first's first.
    fn join(&mut self, a: &Self::Map, b: &Self::Map) -> Self::Map;
    /// Every output from every sample of the map: a map of `outputs` channels of one sample.
    fn dense(&mut self, name: &str, x: &Self::Map, outputs: usize, act: Act, bias: f32) -> Self::Map;
    /// The same samples as one channel of `size`.
    fn as_map(&mut self, x: &Self::Map, size: Size) -> Self::Map;
    /// `1 / (1 + exp(-x))`.
    fn sigmoid(&mut self, x: &Self::Map) -> Self::Map;
    fn size(&self) -> Size;
}
