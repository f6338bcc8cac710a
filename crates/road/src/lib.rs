//! A deterministic street, ray-cast for stereo experiments: the renderer behind the source `synthetic/road`.
//!
//! A [`Street`] is a function of a seed; frame `k` is what a rectified pair of cameras on a car sees after `k` steps
//! along it. A frame is a pure function of (seed, size, index): any frame can be rendered directly, and its bits
//! depend neither on how many threads shared the work nor on the machine (only `+ - * /`, `sqrt` and integer hashes
//! touch a pixel; no libm).
//!
//! The street is hard for stereo in the ways real ones are: façades whose windows repeat strictly, railings, plain
//! plaster, low-contrast asphalt, car bodies of one colour, panes that mirror what is far away, thin poles,
//! foliage with holes, shadows, saturated sky, sensor noise and two cameras whose exposures differ a little.
//!
//! Axes of the world: x to the right, y up, z along the street, metres; x = 0 is the middle of the carriageway, y = 0
//! its surface.
//!
//! ```
//! use depthloom_road::{Size, Street};
//!
//! let street = Street::new(1, Size { width: 64, height: 24 });
//! let frame = street.frame(0, &|tiles, render| (0..tiles).for_each(render));
//! assert_eq!(frame.left.len(), 64 * 24 * 3);
//! ```

mod camera;
mod frame;
mod furniture;
mod hash;
mod layout;
mod lidar;
mod light;
mod object;
mod parking;
mod render;
mod scene;
mod screen;
mod sensor;
mod shape;
mod street;
mod surfaces;
mod vector;

#[cfg(test)]
mod tests;

pub use frame::{Calibration, Frame, Run, Size};
pub use street::Street;
