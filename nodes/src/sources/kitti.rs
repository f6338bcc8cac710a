//! The benchmarks of KITTI: `kitti/*`.

mod calibration;
mod cameras;
mod depth;
mod drives;
mod odometry;
mod raw;
mod stems;
mod stereo;
mod stereo_2012;
mod stereo_2015;
mod time;

pub(crate) use depth::KittiDepth;
pub(crate) use odometry::KittiOdometry;
pub(crate) use raw::KittiRaw;
pub(crate) use stereo_2012::KittiStereo2012;
pub(crate) use stereo_2015::KittiStereo2015;
