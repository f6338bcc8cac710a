//! What a file says of its network.

/// What a network's output means, named as `mono/onnx` names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Disparity as a share of the image's width.
    DisparityShare,
    /// 1 / depth, 1/m.
    InverseDepth,
    /// Depth, metres.
    Depth,
}

impl Meaning {
    /// The name in files and parameters.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::DisparityShare => "disparity-share",
            Self::InverseDepth => "inverse-depth",
            Self::Depth => "depth",
        }
    }
}

/// What a file says of its network.
#[derive(Clone, Copy, Debug)]
pub struct Metadata<'a> {
    /// Columns and rows of the image it takes, px.
    pub size: [usize; 2],
    /// What it gives.
    pub meaning: Meaning,
    /// The key of the training run that made it.
    pub training_key: &'a str,
}

/// Names of a file's metadata.
pub mod names {
    /// Columns and rows of the image, e.g. `320x96`.
    pub const INPUT_SIZE: &str = "depthloom.input_size";
    /// How the image is brought to the network.
    pub const NORMALISATION: &str = "depthloom.normalisation";
    /// What the output means, as `mono/onnx` names it.
    pub const OUTPUT: &str = "depthloom.output";
    /// The key of the training run.
    pub const TRAINING_KEY: &str = "depthloom.training_key";
}

/// What every network here is given: see `learn/samples`.
pub(super) const NORMALISATION: &str = "RGB in [0,1], area resized";
