//! Parameters of `learn/ssl`.

use depthloom_graphs::contracts::DataPath;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::loss::{Loss, Penalty};
use crate::networks::{Meaning, Monocular, Network};
use crate::training::{Schedule, Settings};

/// Parameters of `learn/ssl`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SslParams {
    /// The network: `unet-lite`, `unet-tiny`, `fcn-lite`, `fcn-vgg16` or `eigen-coarse`.
    pub(crate) network: Network,
    /// The measure of the absolute error: `inverse-depth`, `depth` (the paper's) or `log-depth`.
    pub(crate) loss: Loss,
    /// How errors count: `absolute` (the paper's) or `berhu`.
    pub(crate) penalty: Penalty,
    /// Whether the network also learns the standard deviation of its log depth: a second output, `spread`, that
    /// `mono/onnx` reads with `spread_name: spread`. Requires the loss `log-depth` and the penalty `absolute`.
    pub(crate) spread: bool,
    /// Larger depths are clamped to this, metres; only for the loss `depth`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(crate) cap: f64,
    /// Factor of the photometric loss (Godard, Mac Aodha, Brostow 2017), which is added to the error; requires the
    /// right view at `learn/samples`.
    #[schemars(range(min = 0))]
    pub(crate) photometric: f64,
    /// Steps of the optimiser.
    #[schemars(range(min = 1))]
    pub(crate) steps: u64,
    /// Samples per step.
    #[schemars(range(min = 1, max = 4096))]
    pub(crate) batch: u32,
    /// Samples loaded at a time, from which `draws` batches are drawn (the paper: 32 and 100); `null` draws every batch
    /// from all samples.
    #[schemars(inner(range(min = 1)))]
    pub(crate) loaded: Option<u32>,
    /// Batches drawn from the loaded samples.
    #[schemars(range(min = 1))]
    pub(crate) draws: u32,
    /// The first learning rate of Adam.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(crate) learning_rate: f64,
    /// How the learning rate changes: `cosine` or `constant`.
    pub(crate) schedule: Schedule,
    /// Whether half of the samples are mirrored.
    pub(crate) flip: bool,
    /// Brightness varies by up to this share.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) brightness: f64,
    /// Each colour varies by up to this share.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) colour: f64,
    /// Up to this share of the image's sides is cut off, and the rest is enlarged; its disparities then are larger
    /// shares of the width.
    #[schemars(range(min = 0, max = 0.9))]
    pub(crate) crop: f64,
    /// The seed of all random numbers.
    pub(crate) seed: u64,
    /// Initial weights, with the names of the network's parameters: a `.safetensors` or ONNX file. Other parameters
    /// start with random values.
    pub(crate) weights: Option<DataPath>,
    /// Steps between two points of the learning curve.
    #[schemars(range(min = 1))]
    pub(crate) curve_every: u64,
    /// With validation samples: points of the curve without a new best before training stops; `null` never stops. The
    /// output is the best network.
    #[schemars(inner(range(min = 1)))]
    pub(crate) patience: Option<u32>,
    /// Steps between two checkpoints.
    #[schemars(range(min = 1), extend("operational" = true))]
    pub(crate) checkpoint_every: u64,
}

impl Default for SslParams {
    fn default() -> Self {
        Self {
            network: Network::UnetLite,
            loss: Loss::InverseDepth,
            penalty: Penalty::Absolute,
            spread: false,
            cap: 80.0,
            photometric: 0.0,
            steps: 2000,
            batch: 8,
            loaded: None,
            draws: 100,
            learning_rate: 1e-3,
            schedule: Schedule::Cosine,
            flip: true,
            brightness: 0.2,
            colour: 0.05,
            crop: 0.0,
            seed: 1,
            weights: None,
            curve_every: 50,
            patience: None,
            checkpoint_every: 100,
        }
    }
}

impl SslParams {
    pub(super) const fn settings(&self) -> Settings {
        let Self { steps, learning_rate, schedule, curve_every, patience, checkpoint_every, .. } = *self;
        Settings { steps, learning_rate, schedule, curve_every, patience, checkpoint_every }
    }

    /// Checks that the network and the loss can learn a spread.
    pub(super) fn check_spread(&self) -> Result<(), (&'static str, String)> {
        let refused = |why: &str| Err(("spread", format!("spread is true, but {why}")));
        match (self.spread, self.network, self.loss, self.penalty) {
            (false, ..) => Ok(()),
            (_, Network::EigenCoarse, ..) => refused("eigen-coarse predicts no spread: choose another `network`"),
            (_, _, Loss::InverseDepth | Loss::Depth, _) => refused("it is that of log depth: set `loss: log-depth`"),
            (.., Penalty::Berhu) => refused("its loss has its own penalty: set `penalty: absolute`"),
            _ => Ok(()),
        }
    }

    pub(crate) const fn architecture(&self) -> Monocular {
        Monocular { network: self.network, spread: self.spread }
    }

    /// Whether network or loss use depth in metres.
    pub(crate) fn needs_depth(&self) -> bool {
        self.loss == Loss::Depth || matches!(self.network.meaning(), Meaning::Depth { .. })
    }
}
