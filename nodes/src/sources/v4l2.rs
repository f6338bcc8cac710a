//! `camera/v4l2`: cameras of Linux, with the cargo feature `v4l2`.

#[cfg(feature = "v4l2")]
mod camera;
#[cfg(feature = "v4l2")]
mod device;
mod pairing;
mod pixels;

#[cfg(feature = "v4l2")]
pub(crate) use camera::V4l2;
