//! What is taken of the errors at a true distance.

/// The percentiles taken.
pub const PERCENTILES: [u32; 5] = [5, 25, 50, 75, 95];

/// Absolute errors of an estimator in one metre of true distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceBin {
    /// Index of the estimator.
    pub estimator: usize,
    /// The bin holds true distances from this many metres up to, not including, one metre more.
    pub bin_m: u32,
    /// Over all pixels that the estimator answered.
    pub answered: Spread,
    /// Over those of them that all it is compared with answered too; `None` if there is none.
    pub shared: Option<Spread>,
}

/// How absolute errors spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// How many pixels; at least one.
    pub count: u64,
    /// The [`PERCENTILES`] of the absolute error, metres.
    pub percentiles_m: [f64; 5],
}
