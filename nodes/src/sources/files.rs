//! Files of one frame: images, and maps of numbers.

pub(crate) mod float_file;
pub(crate) mod image_file;
