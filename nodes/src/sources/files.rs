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

/// The map to read of a file with several.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MapChoice<'a> {
    /// Of an NPZ file the name of the array, of an EXR file that of the channel.
    pub name: Option<&'a str>,
    /// Of an array of three dimensions, the number of the map.
    pub slice: Option<u64>,
}

/// A map of numbers, and the bits per number in its file.
///
/// Formats: PNG, TIFF and PNM with one channel of 8 or 16 bits, TIFF of 32-bit floats, PFM, NPY, NPZ and EXR. Row 0 is
/// the top row.
pub(crate) fn numbers(path: &Path, bytes: &[u8], choice: MapChoice<'_>) -> Result<(Raster<f32>, u32), Fault> {
    if is_archive(bytes) {
        let array = member(path, bytes, choice.name)?;
        return float_file::slice_f32(path, &array, choice.slice).map(|map| (map, 32));
    }
    if bytes.starts_with(exr_file::MAGIC) {
        return exr_file::channel(path, bytes, choice.name).map(|map| (map, 32));
    }
    if bytes.starts_with(b"Pf") || bytes.starts_with(b"PF") || bytes.starts_with(b"\x93NUMPY") {
        return float_file::slice_f32(path, bytes, choice.slice).map(|map| (map, 32));
    }
    image_file::numbers(path, bytes)
}

/// At most 40 characters of a text, for a message.
pub(crate) fn shortened(text: &str) -> String {
    if text.chars().count() <= 40 { text.to_owned() } else { text.chars().take(40).chain("...".chars()).collect() }
}
