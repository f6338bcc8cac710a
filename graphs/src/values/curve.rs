//! How a training went: the learning curve of a network.

/// The learning curve of a training, its points in the order of their steps.
///
/// Losses are in the unit of the loss that was trained with, whatever that is; curves of different losses do not compare.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// The points, by ascending step.
    pub points: Vec<CurvePoint>,
}

/// A point of a learning curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// How many steps of the optimiser had been done.
    pub step: u64,
    /// The mean training loss over the steps since the point before, in the loss's own unit; NaN if no sample of theirs had a target.
    pub loss: f64,
    /// The loss on samples that are not trained on, in the same unit; `None` where it was not measured.
    pub validation: Option<f64>,
    /// The learning rate of the last of these steps.
    pub learning_rate: f64,
}
