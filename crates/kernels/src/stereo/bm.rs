//! OpenCV's `StereoBM`: block matching by sums of absolute differences, the same result bit for bit.
//!
//! Both images are prefiltered (horizontal Sobel or local contrast), absolute differences are summed over a square
//! block, and the smallest sum wins; texture and uniqueness checks, a parabola of absolute values for the fraction, the
//! left-right check, the speckle filter (Konolige, *Small Vision Systems*, 1997; `modules/stereo/src/stereobm.cpp` of
//! OpenCV 5). Disparities are fixed point, 1/16 px in an `i16`.
//!
//! What OpenCV does and one would not expect is kept, since its results are the reference:
//!
//! - Only pixels whose whole block lies inside the left image, and inside the right one at the largest disparity, are
//!   valid. With a positive smallest disparity OpenCV also searches that many columns beyond the right border and
//!   writes what it finds to the start of the next row; it clears these again, except in the first row below the last
//!   valid one.
//! - An image of odd height loses its last row in the x-Sobel prefilter.
//! - The speckle filter's range is taken in 1/16 px, not in pixels as in `StereoSGBM`.
//!
//! Where OpenCV reads memory that it never wrote, or that is not its own, there is nothing to keep, and what its
//! documentation says is done instead: with `prefilter_cap` above 31 or `block` above 21 it sums in 32 bits but hands
//! these sums to the left-right check as if they had 16 (here the check compares the sums themselves); a window of
//! [`Prefilter::NormalizedResponse`] more than twice as high as the image, or with 51, 53 or 73 to 89 px (here borders
//! repeat and responses are clipped as with any other).
//!
//! ```
//! use depthloom_kernels::bm::{Params, BmScratch, compute};
//! use depthloom_kernels::tiles::Serial;
//!
//! # fn main() -> Result<(), depthloom_kernels::bm::Error> {
//! let (width, height) = (120, 30);
//! let left: Vec<u8> = (0..width * height).map(|i| (i * i % 251) as u8).collect();
//! let right: Vec<u8> = (0..width * height).map(|i| left[(i + 7).min(left.len() - 1)]).collect();
//! let mut disparity = vec![0; width * height];
//! compute(&left, &right, width, height, &Params::default(), &mut BmScratch::default(), &Serial, &mut disparity)?;
//! assert_eq!(disparity[15 * width + 90] >> 4, 7);
//! assert_eq!(disparity[0], Params::default().invalid()); // no block around a corner lies inside the image
//! # Ok(())
//! # }
//! ```

mod check;
mod choice;
mod compute;
mod fast;
mod params;
mod prefilter;
mod search;
mod sums;

pub use compute::{BmScratch, Error, compute};
pub use params::{Params, Prefilter};
