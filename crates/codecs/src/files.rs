//! Values as files that other programs read: images and maps as PNG, NPY and PFM, point clouds as PLY and PCD. Bytes,
//! no file.
//!
//! | value | [`png`] | [`npy`] | [`pfm`] |
//! |---|---|---|---|
//! | image | its file's own bytes, or 8 bit | `(h, w)` or `(h, w, 3)` of `u1`, red first | |
//! | disparity, true disparity | 16 bit, pixels * 256, 0 = none (KITTI) | `(h, w)` of `<f4`, pixels, NaN = none | the same, infinity = none |
//! | depth | 16 bit, metres * 256, 0 = none (KITTI) | `(h, w)` of `<f4`, metres, NaN = none | the same, infinity = none |
//! | weight | 16 bit, share * 65535, 0 = none | `(h, w)` of `<f4` | the same, infinity = none |
//! | mask | 8 bit, 0 or 255 | `(h, w)` of `\|b1` | |

mod cloud;
mod colours;
mod floats;
mod npy;
mod pfm;
mod png;

pub use cloud::{Cloud, pcd, ply};
pub use colours::{Colours, coloured_png};
pub use npy::npy;
pub use pfm::pfm;
pub use png::{Png, png};
