//! Parameters of `learn/fusion`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::training::{Schedule, Settings};

/// Parameters of `learn/fusion`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct FusionParams {
    /// Steps of the optimiser.
    #[schemars(range(min = 1))]
    pub(crate) steps: u64,
    /// Windows per step.
    #[schemars(range(min = 1, max = 4096))]
    pub(crate) batch: u32,
    /// Columns and rows of the windows that training sees, px of the samples, multiples of 16; `null` uses whole
    /// samples.
    #[schemars(inner(inner(range(min = 16, max = 4096))))]
    pub(crate) window: Option<[u32; 2]>,
    /// The first learning rate of Adam.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(crate) learning_rate: f64,
    /// How the learning rate changes: `cosine` or `constant`.
    pub(crate) schedule: Schedule,
    /// Largest number of blocks per window in which stereo is hidden, wrong or not confirmed.
    #[schemars(range(min = 1, max = 64))]
    pub(crate) blocks: u32,
    /// Share of the blocks in which stereo is hidden.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) hidden: f64,
    /// Share of the blocks in which stereo is wrong. In the others it is right, but the right view does not confirm
    /// it.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) wrong: f64,
    /// Weight of pixels at which stereo shows the target, relative to the others.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) shown: f64,
    /// The monocular estimate is distorted by up to about this in log depth, smoothly over the window: a network is
    /// better on frames that it was trained on.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) distortion: f64,
    /// Whether half of the windows are mirrored.
    pub(crate) flip: bool,
    /// Brightness varies by up to this share.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) brightness: f64,
    /// The seed of all random numbers.
    pub(crate) seed: u64,
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

impl Default for FusionParams {
    fn default() -> Self {
        Self {
            steps: 1500,
            batch: 8,
            window: Some([320, 96]),
            learning_rate: 2e-3,
            schedule: Schedule::Cosine,
            blocks: 8,
            hidden: 0.5,
            wrong: 0.3,
            shown: 0.2,
            distortion: 0.15,
            flip: true,
            brightness: 0.2,
            seed: 1,
            curve_every: 50,
            patience: None,
            checkpoint_every: 100,
        }
    }
}

impl FusionParams {
    pub(super) const fn settings(&self) -> Settings {
        let Self { steps, learning_rate, schedule, curve_every, patience, checkpoint_every, .. } = *self;
        Settings { steps, learning_rate, schedule, curve_every, patience, checkpoint_every }
    }
}
