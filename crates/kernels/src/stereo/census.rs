//! Census costs and semi-global matching on them, as libSGM computes them (github.com/fixstars/libSGM, Apache-2.0;
//! facts read at commit e4c669b, no code taken).
//!
//! A pixel's census feature states which samples around it are darker than others (Zabih and Woodfill, *Non-parametric
//! local transforms for computing visual correspondence*, 1994; centre-symmetric pairs: Spangenberg, Langner and Rojas,
//! *Weighted semi-global matching and center-symmetric census transform for robust driver assistance*, 2013). The cost
//! of a match is the number of bits that differ. Costs are summed along 4 or 8 paths with penalties for changes of
//! disparity (Hirschmueller, *Stereo processing by semiglobal matching and mutual information*, 2008); then come the
//! cheapest candidate, uniqueness, a sub-pixel parabola, 3x3 medians of the left and the right map, and the left-right
//! check.
//!
//! Three things differ from libSGM, which outputs disparities there that no image supports: a pixel whose partner would
//! be outside of the right image is invalid (libSGM keeps it unchecked); the medians replicate the border (libSGM
//! writes zeros there); and a black pixel is a pixel like others (libSGM takes it as masked).
//!
//! ```
//! use depthloom_kernels::census::{Pair, Params, CensusScratch, compute};
//! use depthloom_kernels::tiles::Serial;
//!
//! # fn main() -> Result<(), depthloom_kernels::census::Error> {
//! let (width, height) = (96, 20);
//! let left: Vec<u8> = (0..width * height).map(|i| (i * i % 251) as u8).collect();
//! let pair = Pair { left: &left, right: &left, width, height };
//! let mut disparity = vec![0; width * height];
//! compute(&pair, &Params::default(), &mut CensusScratch::default(), &Serial, &mut disparity)?;
//! assert_eq!(disparity[10 * width + 80], 0);
//! # Ok(())
//! # }
//! ```

mod choice;
mod compute;
mod costs;
mod features;
mod finish;
mod params;
mod paths;

pub use compute::{CensusScratch, Pair, compute, compute_at};
pub use params::{Census, Error, Params};
