//! How sure a number is: intervals by resampling frames, tests of paired differences.
//!
//! Plain arithmetic and `libm` alone, sums in the order of frames, every resample with random numbers of its own: the
//! same bits with any number of threads on any machine. Held to SciPy (`tests/fixtures/golden/statistics.json`).

mod bootstrap;
mod holm;
mod normal;
mod signed_rank;
mod weighted;

pub(crate) use bootstrap::Statistic;
pub use bootstrap::{Interval, IntervalMethod, Resampling};
pub(crate) use holm::holm;
pub(crate) use signed_rank::SignedRank;
pub(crate) use weighted::Weighted;

#[cfg(test)]
mod tests;
