//! How a training went: the learning curve of a network.

/// The learning curve of a training. Losses of different loss functions cannot be compared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// The points, by ascending step.
    pub points: Vec<CurvePoint>,
}

/// A point of a learning curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// Steps of the optimiser so far.
    pub step: u64,
    /// The mean training loss since the previous point; NaN if no sample had a target.
    pub loss: f64,
    /// The validation loss; `None` where it was not measured.
    pub validation: Option<f64>,
    /// The learning rate of the last of these steps.
    pub learning_rate: f64,
}
