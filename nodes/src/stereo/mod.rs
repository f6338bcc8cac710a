//! Disparity from a rectified pair: `stereo/*`.

mod sgbm;

pub use sgbm::{Sgbm, SgbmMode, SgbmParams};
