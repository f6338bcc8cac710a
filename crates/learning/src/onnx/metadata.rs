//! What a file says of its network.

/// What a network's output means, named as `mono/onnx` names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Meaning {
    /// Disparity as a share of the image's width.
    DisparityShare,
    /// Depth, metres.
    Depth,
}

impl Meaning {
    /// The name in files and parameters.
    #[must_use]
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::DisparityShare => "disparity-share",
            Self::Depth => "depth",
        }
    }
}

/// What a file says of its network.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Metadata<'a> {
    /// Columns and rows of the image it takes, px.
    pub(crate) size: [usize; 2],
    /// What it gives.
    pub(crate) meaning: Meaning,
    /// The key of the training run that made it.
    pub(crate) training_key: &'a str,
}

/// Names of a file's metadata.
pub(crate) mod names {
    /// Columns and rows of the image, e.g. `320x96`.
    pub(crate) const INPUT_SIZE: &str = "depthloom.input_size";
    /// How the image is brought to the network.
    pub(crate) const NORMALISATION: &str = "depthloom.normalisation";
    /// What the output means, as `mono/onnx` names it.
    pub(crate) const OUTPUT: &str = "depthloom.output";
    /// The key of the training run.
    pub(crate) const TRAINING_KEY: &str = "depthloom.training_key";
}

/// What every network here is given: see `learn/samples`.
pub(super) const NORMALISATION: &str = "RGB in [0,1], area resized";
