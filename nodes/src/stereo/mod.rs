//! Disparity from a rectified pair: `stereo/*`.

mod census_sgm;
mod sgbm;

pub use census_sgm::{CensusKind, CensusSgm, CensusSgmParams};
pub use sgbm::{Sgbm, SgbmMode, SgbmParams};
