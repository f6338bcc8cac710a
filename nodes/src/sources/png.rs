//! PNG files of a data set, read whole and decoded, with errors that name the file; within limits, for the file may be a
//! stranger's.

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use depthloom_graphs::values::{Encoded, Image, ImageFormat, Pixels, Raster};
use depthloom_graphs::{Fault, regular_file};
use image::{DynamicImage, ImageDecoder, ImageError, ImageReader};

/// The most bytes of a file, and of the pixels that come of it: 8192 x 8192 of 16-bit RGB are 384 MiB.
const MOST_BYTES: u64 = 512 << 20;

/// A file's bytes.
///
/// # Errors
/// Naming the file, if it cannot be read or is larger than 512 MiB.
pub fn read(path: &Path) -> Result<Arc<[u8]>, Fault> {
    let bytes = regular_file::read(path, MOST_BYTES);
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
                "convert the file to 8 bits without transparency; of a data set that was downloaded, take it from its archive again",
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
            .remedy("write disparity * 256 as 16-bit grey, 0 where it is unknown; of a downloaded data set, take the file from its archive again: an image tool may have saved it with 8 bits")),
    }
}

fn decode(path: &Path, bytes: &[u8]) -> Result<DynamicImage, Fault> {
    let failed = |error: ImageError| {
        // What the header asks for may be more than the decoder counts up to: a byte a pixel is the least.
        let pixels = |(width, height): (u32, u32)| u64::from(width) * u64::from(height);
        let limit = matches!(error, ImageError::Limits(_));
        if let Some(size) = stated_size(bytes).filter(|size| limit && pixels(*size) > MOST_BYTES) {
            return too_large(path, size, pixels(size));
        }
        Fault::new(format!("failed to decode {} ({} bytes)", path.display(), bytes.len()))
            // As text: the decoder's error repeats in its own message what is beneath it.
            .because(error.to_string())
            .remedy(if limit {
                "what it holds beside its pixels takes more memory than an image may: is it the file meant?"
            } else {
                "the file is no whole PNG: copy or download it again"
            })
    };
    let reader = ImageReader::with_format(Cursor::new(bytes), image::ImageFormat::Png);
    let mut decoder = reader.into_decoder().map_err(failed)?;
    let needed = decoder.total_bytes();
    if needed > MOST_BYTES {
        return Err(too_large(path, decoder.dimensions(), needed));
    }
    let mut limits = image::Limits::no_limits();
    // Beside the pixels, what the file holds of profiles and texts.
    limits.max_alloc = Some(needed + (64 << 20));
    decoder.set_limits(limits).map_err(failed)?;
    DynamicImage::from_decoder(decoder).map_err(failed)
}

/// Columns and rows as the first chunk states them: behind the signature, its length and its name.
fn stated_size(bytes: &[u8]) -> Option<(u32, u32)> {
    let word = |at: usize| Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    if bytes.get(12..16)? == b"IHDR" { Some((word(16)?, word(20)?)) } else { None }
}

fn too_large(path: &Path, (width, height): (u32, u32), needed: u64) -> Fault {
    let (path, needed, most) = (path.display(), needed.div_ceil(1 << 20), MOST_BYTES >> 20);
    let what = format!("{path} is {width}x{height}, which takes at least {needed} MiB decoded");
    Fault::new(format!("{what}: more than the {most} MiB an image may take"))
        .remedy("no camera gives such an image: is it the file meant?")
}

fn wrong_pixels(path: &Path, found: &DynamicImage, expected: &str) -> Fault {
    let color = found.color();
    let bits = color.bits_per_pixel() / u16::from(color.channel_count());
    Fault::new(format!("{} holds {bits}-bit pixels of {} channels: {expected}", path.display(), color.channel_count()))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    /// A PNG that says it is of that size, 8-bit grey, with the data of a few rows.
    fn claims(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        let pixel = image::GrayImage::new(1, 1);
        pixel.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).expect("written");
        // Signature, length and name of the first chunk; then width and height, and behind its 13 bytes the checksum.
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let checksum = crc(&bytes[12..29]).to_be_bytes();
        bytes[29..33].copy_from_slice(&checksum);
        bytes
    }

    fn crc(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 })
        })
    }

    fn said(bytes: Vec<u8>) -> String {
        let fault = super::image(Path::new("left.png"), bytes.into()).expect_err("it is refused");
        format!("{fault}: {}", fault.remedy_text().unwrap_or_default())
    }

    #[test]
    fn fault_12_and_52_an_image_that_asks_for_too_much_is_refused_with_its_size() {
        let bomb = said(claims(60_000, 60_000));
        assert!(
            bomb.contains("left.png is 60000x60000, which takes at least 3434 MiB decoded: more than the 512 MiB"),
            "{bomb}"
        );
        assert!(!bomb.contains("download"), "{bomb}");
        assert!(said(claims(u32::MAX >> 1, u32::MAX >> 1)).contains("more than the 512 MiB"));
        assert!(said(claims(30, 30)).ends_with("the file is no whole PNG: copy or download it again"));
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_no_image_and_nobody_waits_for_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("000000_10.png");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().expect("mkfifo is there").success());
        let fault = super::read(&path).expect_err("it is refused");
        assert!(fault.to_string().contains("failed to read"), "{fault}");
    }
}
