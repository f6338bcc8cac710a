//! Disparity from a rectified pair: `stereo/*`.

mod bm;
mod census_sgm;
mod sgbm;

pub use bm::{Bm, BmParams, BmPrefilter};
pub use census_sgm::{CensusKind, CensusSgm, CensusSgmParams};
pub use sgbm::{Sgbm, SgbmMode, SgbmParams};
