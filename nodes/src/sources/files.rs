//! Files of one frame: images, maps of numbers, calibration texts.

mod archive;
mod exr_file;
pub(crate) mod float_file;
pub(crate) mod image_file;
pub(crate) mod named_lines;

use std::path::Path;

use depthloom_graphs::Fault;
use depthloom_graphs::values::Raster;

pub(crate) use archive::{is_archive, member};

/// A map of numbers, and the bits per number in its file.
///
/// Formats: PNG, TIFF and PNM with one channel of 8 or 16 bits, TIFF of 32-bit floats, PFM, NPY, NPZ and EXR. Row 0 is
/// the top row. `name` is that of an NPZ file's array, or of an EXR file's channel.
pub(crate) fn numbers(path: &Path, bytes: &[u8], name: Option<&str>) -> Result<(Raster<f32>, u32), Fault> {
    if is_archive(bytes) {
        let array = member(path, bytes, name)?;
        return float_file::map_f32(path, &array).map(|map| (map, 32));
    }
    if bytes.starts_with(exr_file::MAGIC) {
        return exr_file::channel(path, bytes, name).map(|map| (map, 32));
    }
    if bytes.starts_with(b"Pf") || bytes.starts_with(b"PF") || bytes.starts_with(b"\x93NUMPY") {
        return float_file::map_f32(path, bytes).map(|map| (map, 32));
    }
    image_file::numbers(path, bytes)
}

/// At most 40 characters of a text, for a message.
pub(crate) fn shortened(text: &str) -> String {
    if text.chars().count() <= 40 { text.to_owned() } else { text.chars().take(40).chain("...".chars()).collect() }
}
