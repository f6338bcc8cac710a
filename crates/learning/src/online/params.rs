//! Parameters of `learn/online`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::networks::Network;
use crate::samples::Sampling;
use crate::ssl::{Loss, Penalty, SslParams};
use crate::training::Schedule;

/// Parameters of `learn/online`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct OnlineParams {
    /// Columns and rows of the network's image, px.
    #[schemars(inner(range(min = 1, max = 4096)))]
    pub(crate) size: [u32; 2],
    /// Only disparities above this become targets, px.
    #[schemars(range(min = 0, max = 2048))]
    pub(crate) least_disparity: f64,
    /// A cell of the small image has a target only if at least this share of it is covered.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) coverage: f64,
    /// The network: `unet-lite`, `unet-tiny`, `fcn-lite`, `fcn-vgg16` or `eigen-coarse`.
    pub(crate) network: Network,
    /// The measure of the absolute error: `inverse-depth`, `depth` (the paper's) or `log-depth`.
    pub(crate) loss: Loss,
    /// How errors count: `absolute` (the paper's) or `berhu`.
    pub(crate) penalty: Penalty,
    /// Larger depths are set to this, metres: those of `depth`, and with the loss `depth` those of the training.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(crate) cap: f64,
    /// The most recent samples that a round trains on; a frame without target gives no sample.
    #[schemars(range(min = 1, max = 65536))]
    pub(crate) memory: u32,
    /// The first round starts with this sample.
    #[schemars(range(min = 1))]
    pub(crate) first: u32,
    /// Frames from the start of a round until its network replaces the current one.
    #[schemars(range(min = 1))]
    pub(crate) period: u32,
    /// Steps of the optimiser per round.
    #[schemars(range(min = 1))]
    pub(crate) steps: u32,
    /// Samples per step.
    #[schemars(range(min = 1, max = 4096))]
    pub(crate) batch: u32,
    /// The learning rate of Adam.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(crate) learning_rate: f64,
    /// Whether half of the samples are mirrored.
    pub(crate) flip: bool,
    /// Brightness varies by up to this share.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) brightness: f64,
    /// Each colour varies by up to this share.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) colour: f64,
    /// Up to this share of the image's sides is cut off, and the rest is enlarged.
    #[schemars(range(min = 0, max = 0.9))]
    pub(crate) crop: f64,
    /// The seed of all random numbers.
    pub(crate) seed: u64,
    /// Threads of a round in a live run. Other runs wait for rounds, and use as many threads as the run has workers.
    #[schemars(range(min = 1, max = 1024), extend("operational" = true))]
    pub(crate) threads: u32,
}

impl Default for OnlineParams {
    fn default() -> Self {
        Self {
            size: [320, 96],
            least_disparity: 0.5,
            coverage: 0.2,
            network: Network::UnetLite,
            loss: Loss::InverseDepth,
            penalty: Penalty::Absolute,
            cap: 80.0,
            memory: 64,
            first: 8,
            period: 10,
            steps: 20,
            batch: 4,
            learning_rate: 1e-3,
            flip: true,
            brightness: 0.2,
            colour: 0.05,
            crop: 0.0,
            seed: 1,
            threads: 1,
        }
    }
}

impl OnlineParams {
    pub(super) const fn sampling(&self) -> Sampling {
        let Self { size, least_disparity, coverage, .. } = *self;
        Sampling { size, least_disparity, coverage }
    }

    /// The parameters of a training of `learn/ssl` that ends at `last_step`.
    pub(super) fn training(&self, last_step: u64) -> SslParams {
        SslParams {
            network: self.network,
            loss: self.loss,
            penalty: self.penalty,
            cap: self.cap,
            steps: last_step,
            batch: self.batch,
            learning_rate: self.learning_rate,
            schedule: Schedule::Constant,
            flip: self.flip,
            brightness: self.brightness,
            colour: self.colour,
            crop: self.crop,
            seed: self.seed,
            curve_every: u64::from(self.steps),
            ..SslParams::default()
        }
    }

    pub(super) fn check_size(&self) -> Result<(), (&'static str, String)> {
        let (name, multiple, [width, height]) = (self.network.name(), self.network.multiple() as u32, self.size);
        if width.is_multiple_of(multiple) && height.is_multiple_of(multiple) {
            return Ok(());
        }
        let up = |side: u32| side.next_multiple_of(multiple);
        Err((
            "size",
            format!(
                "size is {width}x{height}, but {name} requires sides that are multiples of {multiple}: \
                 set `size: [{}, {}]`",
                up(width),
                up(height)
            ),
        ))
    }
}
