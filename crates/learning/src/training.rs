//! Training: steps of Adam over a network's parameters, with checkpoints, for any objective.

mod adam;
mod checkpoint;
mod run;
mod steps;

use depthloom_graphs::Fault;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::compute::Input;
use crate::networks::Architecture;

pub(crate) use run::{advance, check_curve, check_patience, in_pool, learn, on_threads};
pub(crate) use steps::State;

/// How the learning rate changes after its first value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Schedule {
    /// Half a cosine down to zero at the last step.
    #[default]
    Cosine,
    /// Constant.
    Constant,
}

/// The parameters that all trainings have.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Settings {
    /// Steps of the optimiser.
    pub(crate) steps: u64,
    /// The first learning rate of Adam.
    pub(crate) learning_rate: f64,
    pub(crate) schedule: Schedule,
    /// Steps between two points of the learning curve.
    pub(crate) curve_every: u64,
    /// Points of the curve without a new best before training stops.
    pub(crate) patience: Option<u32>,
    /// Steps between two checkpoints.
    pub(crate) checkpoint_every: u64,
}

/// The gradient of a loss by a network's maps, and what the loss measured.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slopes {
    pub(crate) by_map: Vec<f32>,
    /// Sum of the errors that the learning curve shows, and their number.
    pub(crate) measured: (f64, u64),
}

/// What a network is trained for.
pub(crate) trait Objective {
    type Batch;

    fn settings(&self) -> Settings;

    /// The samples of a step and what the network sees of them: a function of the step alone, so that a resumed
    /// training continues with the same.
    fn batch(&self, step: u64) -> (Input, Self::Batch);

    /// The network.
    fn network(&self) -> impl Architecture;

    fn slopes(&self, map: &[f32], batch: &Self::Batch) -> Slopes;

    /// The error on validation samples, if there are any; `maps` computes the network's maps.
    fn validation(&self, maps: &mut dyn FnMut(Input) -> Vec<f32>) -> Option<f64>;
}

/// The remedy of a training that has diverged.
fn diverged() -> Fault {
    Fault::new("training diverged: the loss or the weights are no longer finite numbers")
        .remedy("lower `learning_rate`, or choose another `seed`")
}
