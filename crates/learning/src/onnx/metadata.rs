//! Metadata of a network's file.

/// The meaning of a network's output, a map in [0, 1] that is multiplied by a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Meaning {
    /// Multiplied by `scale`: disparity as a share of the image's width.
    DisparityShare { scale: f32 },
    /// Multiplied by `farthest_m`: depth, metres.
    Depth { farthest_m: f32 },
}

impl Meaning {
    /// The name in files and in the parameters of `mono/onnx`.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::DisparityShare { .. } => "disparity-share",
            Self::Depth { .. } => "depth",
        }
    }

    pub(crate) const fn scale(self) -> f32 {
        match self {
            Self::DisparityShare { scale } => scale,
            Self::Depth { farthest_m } => farthest_m,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Metadata<'a> {
    /// Columns and rows of the image it takes, px.
    pub(crate) size: [usize; 2],
    /// How the image is brought to the network.
    pub(crate) normalisation: &'a str,
    /// The key of the training run that made it.
    pub(crate) training_key: &'a str,
}

pub(crate) mod names {
    /// Columns and rows of the image, e.g. `320x96`.
    pub(crate) const INPUT_SIZE: &str = "depthloom.input_size";
    /// How the image is brought to the network.
    pub(crate) const NORMALISATION: &str = "depthloom.normalisation";
    /// What the first output means, as `mono/onnx` names it.
    pub(crate) const OUTPUT: &str = "depthloom.output";
    /// The key of the training run.
    pub(crate) const TRAINING_KEY: &str = "depthloom.training_key";
}
