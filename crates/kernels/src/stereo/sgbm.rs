//! OpenCV's `StereoSGBM`: semi-global block matching, the same result bit for bit in all four modes.
//!
//! Birchfield-Tomasi pixel costs on x-Sobel and grey values, summed over a block, then summed along 3 to 8 directions
//! with penalties for changes of disparity (Hirschmueller 2005); best candidate, uniqueness, sub-pixel parabola,
//! left-right check, 3x3 median, speckle filter. Disparities are fixed point, 1/16 px in an `i16`.
//!
//! ```
//! use depthloom_kernels::sgbm::{Params, SgbmScratch, View, compute};
//! use depthloom_kernels::tiles::Serial;
//!
//! # fn main() -> Result<(), depthloom_kernels::sgbm::Error> {
//! let (width, height) = (96, 20);
//! let left: Vec<u8> = (0..width * height).map(|i| (i * i % 251) as u8).collect();
//! let view = View { data: &left, width, height, channels: 1 };
//! let mut disparity = vec![0; width * height];
//! compute(&view, &view, &Params::default(), &mut SgbmScratch::default(), &Serial, &mut disparity)?;
//! assert_eq!(disparity[10 * width + 80], 0);
//! assert_eq!(disparity[0], Params::default().invalid()); // the first 64 columns have no partner
//! # Ok(())
//! # }
//! ```

mod choice;
mod compute;
mod extend;
mod fast;
mod maps;
mod params;
mod plain;
mod plain_cost;
mod prefilter;
mod search;
mod speckle;
mod view;

pub use crate::simd::Path;
pub use compute::{SgbmScratch, compute, compute_maps, compute_on};
pub use maps::Maps;
pub use params::{Mode, Params};
pub use speckle::{SpeckleScratch, filter as filter_speckles};
pub use view::{Error, View};
