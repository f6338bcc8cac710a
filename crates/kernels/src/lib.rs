//! Pixel kernels: slices in, slices out.
//!
//! Rasters are row-major slices; the caller owns every output. A kernel panics if a slice does not have the size that
//! the other arguments announce. Depth is in metres, `f32`, NaN = invalid.
//!
//! ```
//! use depthloom_kernels::{confidence, depth, edges, fuse, grey, median, scale};
//!
//! let (width, height) = (8, 4);
//! let rgb: Vec<u8> = (0..width * height * 3).map(|i| (i * 37) as u8).collect();
//! let disparity = vec![160_i16; width * height];
//! let mono: Vec<f32> = (0..width * height).map(|i| 5.0 + i as f32).collect();
//!
//! let mut grey = vec![0; width * height];
//! grey::grey_from_rgb(&rgb, width, height, &mut grey);
//! let mut mask = vec![0; width * height];
//! edges::edges(&grey, width, height, 100.0, &mut mask);
//! let mut weight = vec![0.0; width * height];
//! confidence::confidence_from_edges(&mask, width, height, 10.0, &mut weight);
//! let mut stereo = vec![0.0; width * height];
//! let kitti = depth::Geometry { focal_px: 721.5377, baseline_metres: 0.532725, doffs_px: 0.0 };
//! depth::depth_from_disparity(&disparity, kitti, 80.0, &mut stereo);
//! let mut scaled = vec![0.0; width * height];
//! scale::minmax(&mono, &stereo, &mut scaled);
//! let mut merged = vec![0.0; width * height];
//! fuse::fuse(&stereo, &scaled, &weight, fuse::Weighting::Full, &mut merged);
//! let mut fused = vec![0.0; width * height];
//! median::median5(&merged, width, height, &mut fused);
//! ```
//!
//! # Vectors
//! Most loops are plain Rust, compiled once for each instruction set ([`simd`]). Where vectors are named
//! (`simd::Block`, `simd::Lanes`, `Lanes` of `sgbm`, `simd::grey`, `simd::differences`, `simd::differences_avx2`), one
//! convention holds:
//!
//! - A vector is a type that is named only in code compiled for its instruction set, which only a level runs that was
//!   found on the machine. So its arithmetic is safe to call, and each body's `unsafe` says no more than that.
//! - Loading and storing take either an array by reference, as long as the vector, and are safe; or a pointer, and are
//!   `unsafe`: the caller vouches for as many samples, and names the check. Neither needs alignment. Pointers are for
//!   loops whose positions are checked once for all (`convolve`, `sgbm`).
//! - Beside it stands a twin of plain Rust, and tests compare the bits.
//!
//! `unsafe` is in the SIMD modules and where tiles are lent to threads. Under AddressSanitizer:
//! `RUSTFLAGS=-Zsanitizer=address cargo +nightly test --release --target x86_64-unknown-linux-gnu -p
//! depthloom-kernels --lib --test sgbm_paths --test census_paths` (four minutes on two cores).

mod filter;
pub mod float_differences;
mod fusion;
mod image;
pub mod memory;
mod raster;
pub mod simd;
mod stereo;
pub mod tiles;
pub mod velodyne;

pub use filter::{convolve, edges, guided, median};
pub use fusion::{align, confidence, facil, fuse, inverse_variance, learned, median_of, mixture, scale};
pub use image::{grey, resize};
pub use stereo::{bm, census, depth, fill, left_right, params, rectify, sgbm, weighted_least_squares};
