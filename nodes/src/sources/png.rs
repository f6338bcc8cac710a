//! PNG files of a data set, read whole and decoded, with errors that name the file.

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use depthloom_graphs::Fault;
use depthloom_graphs::values::{Encoded, Image, ImageFormat, Pixels, Raster};
use image::{DynamicImage, ImageReader};

/// A file's bytes.
///
/// # Errors
/// Naming the file, if it cannot be read.
pub fn read(path: &Path) -> Result<Arc<[u8]>, Fault> {
    let bytes = std::fs::read(path);
    bytes.map(Into::into).map_err(|error| Fault::new(format!("failed to read {}", path.display())).because(error))
}

/// An 8-bit grey or RGB image that keeps the file's bytes.
///
/// # Errors
/// If the bytes are no whole PNG, or hold other pixels.
pub fn image(path: &Path, bytes: Arc<[u8]>) -> Result<Image, Fault> {
    let pixels = match decode(path, &bytes)? {
        DynamicImage::ImageLuma8(grey) => Pixels::Grey(grey),
        DynamicImage::ImageRgb8(rgb) => Pixels::Rgb(rgb),
        other => {
            return Err(wrong_pixels(path, &other, "camera images are 8-bit grey or RGB").remedy(
                "convert the file to 8 bits without transparency, or take it from the data set's archive again",
            ));
        }
    };
    Ok(Image::with_encoded(pixels, Encoded { format: ImageFormat::Png, bytes }))
}

/// A 16-bit map, one channel: KITTI's disparity and depth files.
///
/// # Errors
/// If the bytes are no whole PNG, or hold other pixels.
pub fn map_u16(path: &Path, bytes: &[u8]) -> Result<Raster<u16>, Fault> {
    match decode(path, bytes)? {
        DynamicImage::ImageLuma16(map) => Ok(map),
        other => Err(wrong_pixels(path, &other, "KITTI's truth has 16 bits, one channel (1/256 px, 0 = unknown)")
            .remedy("take the file from the data set's archive again: an image tool may have saved it with 8 bits")),
    }
}

fn decode(path: &Path, bytes: &[u8]) -> Result<DynamicImage, Fault> {
    let reader = ImageReader::with_format(Cursor::new(bytes), image::ImageFormat::Png);
    reader.decode().map_err(|error| {
        Fault::new(format!("failed to decode {} ({} bytes)", path.display(), bytes.len()))
            // As text: the decoder's error repeats in its own message what is beneath it.
            .because(error.to_string())
            .remedy("the file is no whole PNG: copy or download it again")
    })
}

fn wrong_pixels(path: &Path, found: &DynamicImage, expected: &str) -> Fault {
    let color = found.color();
    let bits = color.bits_per_pixel() / u16::from(color.channel_count());
    Fault::new(format!("{} holds {bits}-bit pixels of {} channels: {expected}", path.display(), color.channel_count()))
}
