//! Intervals by resampling frames, and tests of paired differences.
//!
//! Uses only plain arithmetic and `libm`, sums in the order of frames, and own random numbers for every resample: the
//! results are bit-identical with any number of threads on any machine. Compared with SciPy
//! (`tests/fixtures/golden/statistics.json`).

mod bootstrap;
mod groups;
mod holm;
mod normal;
mod signed_rank;
mod weighted;

pub(crate) use bootstrap::Statistic;
pub use bootstrap::{Interval, IntervalMethod, Resampling};
pub use groups::Grouping;
pub(crate) use groups::Groups;
pub(crate) use holm::holm;
pub(crate) use signed_rank::SignedRank;
pub(crate) use weighted::Weighted;

#[cfg(test)]
mod tests;
