//! Rectification of stereo pairs: lens distortion and the rotation between two cameras taken out of their images, as
//! OpenCV does it (`stereoRectify`, `initUndistortRectifyMap`, `fisheye::initUndistortRectifyMap` and `remap` with
//! `INTER_LINEAR`).
//!
//! Pixels have integer coordinates at their centres: (0, 0) is the middle of the first one. A camera looks along z, x
//! is to the right, y down.

mod camera;
mod map;
mod matrix;
mod remap;
mod stereo;

pub use camera::{Camera, Lens};
pub use map::{Interpolation, Map, View};
pub use matrix::Matrix;
pub use remap::remap;
pub use stereo::{Rectified, stereo_rectify};
