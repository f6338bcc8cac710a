//! Image files of a data set, read whole and decoded, with errors that name the file; within limits, for the file may be a
//! stranger's. What a file is, its first bytes say, not its name.

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use depthloom_graphs::values::{Encoded, Image, ImageFormat, Pixels, Raster};
use depthloom_graphs::{Fault, regular_file};
use image::{DynamicImage, GrayImage, ImageDecoder, ImageError, ImageReader, RgbImage};

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

/// An 8-bit grey or RGB image of a PNG, JPEG, WebP, TIFF or PNM file. Of PNG and JPEG files that hold just this the bytes are kept.
///
/// What a camera image is not, is made one as OpenCV's `imread` does: of 16 bits the upper 8 are taken, transparency is dropped.
///
/// # Errors
/// If the bytes are no whole image, or hold other pixels.
pub fn image(path: &Path, bytes: Arc<[u8]>) -> Result<Image, Fault> {
    let format = format_of(path, &bytes)?;
    let upper = |sample: &u16| (sample >> 8) as u8;
    let (pixels, is_as_it_lies) = match decode(path, format, &bytes)? {
        DynamicImage::ImageLuma8(grey) => (Pixels::Grey(grey), true),
        DynamicImage::ImageRgb8(rgb) => (Pixels::Rgb(rgb), true),
        transparent @ DynamicImage::ImageLumaA8(_) => (Pixels::Grey(transparent.into_luma8()), false),
        transparent @ DynamicImage::ImageRgba8(_) => (Pixels::Rgb(transparent.into_rgb8()), false),
        deep @ (DynamicImage::ImageLuma16(_) | DynamicImage::ImageLumaA16(_)) => {
            let deep = deep.into_luma16();
            let (width, height) = deep.dimensions();
            let grey = GrayImage::from_raw(width, height, deep.iter().map(upper).collect());
            (Pixels::Grey(grey.expect("a byte a pixel")), false)
        }
        deep @ (DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_)) => {
            let deep = deep.into_rgb16();
            let (width, height) = deep.dimensions();
            let rgb = RgbImage::from_raw(width, height, deep.iter().map(upper).collect());
            (Pixels::Rgb(rgb.expect("three bytes a pixel")), false)
        }
        other => {
            return Err(wrong_pixels(path, &other, "camera images are grey or RGB, of 8 or 16 bits").remedy(
                "convert the file to 8 bits; of a data set that was downloaded, take it from its archive again",
            ));
        }
    };
    let kept = match format {
        _ if !is_as_it_lies => None,
        image::ImageFormat::Png => Some(ImageFormat::Png),
        image::ImageFormat::Jpeg => Some(ImageFormat::Jpeg),
        _ => None,
    };
    Ok(match kept {
        Some(format) => Image::with_encoded(pixels, Encoded { format, bytes }),
        None => Image::new(pixels),
    })
}

/// A 16-bit map, one channel, PNG or TIFF: files of disparity or depth, of `disparity` (px) or `metres`.
///
/// # Errors
/// If the bytes are no whole image, or hold other pixels.
pub fn map_u16(path: &Path, bytes: &[u8], unit: &str) -> Result<Raster<u16>, Fault> {
    match decode(path, format_of(path, bytes)?, bytes)? {
        DynamicImage::ImageLuma16(map) => Ok(map),
        other => {
            let expected = format!("such a map has 16 bits, one channel ({unit} * 256, 0 = unknown)");
            Err(wrong_pixels(path, &other, &expected).remedy(format!(
                "write {unit} * 256 as 16-bit grey, 0 where it is unknown; of a downloaded data set, take the file from its archive again: an \
                 image tool may have saved it with 8 bits"
            )))
        }
    }
}

/// An 8-bit map, one channel or three equal ones: disparities and masks of older data sets; `what` says it to whoever has another.
///
/// # Errors
/// If the bytes are no whole image, or hold other pixels.
pub fn map_u8(path: &Path, bytes: &[u8], what: &str) -> Result<GrayImage, Fault> {
    let remedy = "of a downloaded data set, take the file from its archive again: an image tool may have changed it";
    match decode(path, format_of(path, bytes)?, bytes)? {
        DynamicImage::ImageLuma8(map) => Ok(map),
        DynamicImage::ImageRgb8(rgb) => {
            let pixels = rgb.as_raw().as_chunks::<3>().0;
            if pixels.iter().any(|[red, green, blue]| red != green || green != blue) {
                return Err(Fault::new(format!("{} is a colour image: {what}", path.display())).remedy(remedy));
            }
            let grey = GrayImage::from_raw(rgb.width(), rgb.height(), pixels.iter().map(|pixel| pixel[0]).collect());
            Ok(grey.expect("a byte a pixel"))
        }
        other => Err(wrong_pixels(path, &other, what).remedy(remedy)),
    }
}

/// A map of numbers as they stand in the file, one channel, and how many bits a number has there: 8 or 16 bits in a PNG, TIFF or PNM file, 32-bit
/// floats in a TIFF file.
///
/// # Errors
/// If the bytes are no whole image, or hold other pixels.
pub fn numbers(path: &Path, bytes: &[u8]) -> Result<(Raster<f32>, u32), Fault> {
    let format = format_of(path, bytes)?;
    if format == image::ImageFormat::Tiff
        && let Some(floats) = float_tiff(path, bytes)?
    {
        return Ok((floats, 32));
    }
    let (size, numbers, bits): (_, Vec<f32>, _) = match decode(path, format, bytes)? {
        DynamicImage::ImageLuma8(map) => (map.dimensions(), map.iter().map(|number| f32::from(*number)).collect(), 8),
        DynamicImage::ImageLuma16(map) => (map.dimensions(), map.iter().map(|number| f32::from(*number)).collect(), 16),
        other => {
            let expected = "a map has one channel, of 8 or 16 bits, or of 32-bit floats (TIFF)";
            let remedy = "write one number a pixel; a coloured picture of a map is none";
            return Err(wrong_pixels(path, &other, expected).remedy(remedy));
        }
    };
    Ok((Raster::from_raw(size.0, size.1, numbers).expect("a number a pixel"), bits))
}

/// A TIFF file of one channel of 32-bit floats, which `image` does not read; `None` if it is of another kind.
fn float_tiff(path: &Path, bytes: &[u8]) -> Result<Option<Raster<f32>>, Fault> {
    let failed = |error: tiff::TiffError| {
        Fault::new(format!("failed to decode {} ({} bytes)", path.display(), bytes.len()))
            .because(error.to_string())
            .remedy("the file is no whole TIFF: copy or download it again")
    };
    let mut limits = tiff::decoder::Limits::default();
    limits.decoding_buffer_size = MOST_BYTES as usize;
    limits.intermediate_buffer_size = MOST_BYTES as usize;
    let mut decoder = tiff::decoder::Decoder::new(Cursor::new(bytes)).map_err(failed)?.with_limits(limits);
    if decoder.colortype().map_err(failed)? != tiff::ColorType::Gray(32) {
        return Ok(None);
    }
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let needed = u64::from(width) * u64::from(height) * 4;
    if needed > MOST_BYTES {
        return Err(too_large(path, (width, height), needed));
    }
    match decoder.read_image().map_err(failed)? {
        tiff::decoder::DecodingResult::F32(numbers) => Ok(Raster::from_raw(width, height, numbers)),
        _ => Err(Fault::new(format!("{} holds whole numbers of 32 bits", path.display()))
            .remedy("write a map of 32-bit floats, or of 8 or 16 bits")),
    }
}

/// The formats that are read, with how their files begin.
const FORMATS: [(&[u8], image::ImageFormat); 10] = [
    (b"\x89PNG\r\n\x1a\n", image::ImageFormat::Png),
    (b"\xff\xd8\xff", image::ImageFormat::Jpeg),
    (b"RIFF", image::ImageFormat::WebP),
    (b"II*\0", image::ImageFormat::Tiff),
    (b"MM\0*", image::ImageFormat::Tiff),
    (b"P5", image::ImageFormat::Pnm),
    (b"P6", image::ImageFormat::Pnm),
    (b"P2", image::ImageFormat::Pnm),
    (b"P3", image::ImageFormat::Pnm),
    (b"P7", image::ImageFormat::Pnm),
];

fn format_of(path: &Path, bytes: &[u8]) -> Result<image::ImageFormat, Fault> {
    // What begins as none of them is told of as what its name says, as far as it says: an empty file, a text in place of an image.
    let by_content = FORMATS.iter().find(|(begin, _)| bytes.starts_with(begin)).map(|(_, format)| *format);
    let by_name =
        || image::ImageFormat::from_path(path).ok().filter(|of| FORMATS.iter().any(|(_, format)| format == of));
    by_content.or_else(by_name).ok_or_else(|| {
        Fault::new(format!("{} ({} bytes) is no image", path.display(), bytes.len()))
            .remedy("images are PNG, JPEG, WebP, TIFF or PNM files")
    })
}

fn decode(path: &Path, format: image::ImageFormat, bytes: &[u8]) -> Result<DynamicImage, Fault> {
    let failed = |error: ImageError| {
        // What the header asks for may be more than the decoder counts up to: a byte a pixel is the least.
        let pixels = |(width, height): (u32, u32)| u64::from(width) * u64::from(height);
        let limit = matches!(error, ImageError::Limits(_));
        let name = name_of(format);
        if let Some(size) = stated_size(bytes).filter(|size| limit && pixels(*size) > MOST_BYTES) {
            return too_large(path, size, pixels(size));
        }
        Fault::new(format!("failed to decode {} ({} bytes)", path.display(), bytes.len()))
            // As text: the decoder's error repeats in its own message what is beneath it.
            .because(error.to_string().trim_end())
            .remedy(if limit {
                "what it holds beside its pixels takes more memory than an image may: is it the file meant?".to_owned()
            } else {
                format!("the file is no whole {name}: copy or download it again")
            })
    };
    let reader = ImageReader::with_format(Cursor::new(bytes), format);
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

const fn name_of(format: image::ImageFormat) -> &'static str {
    match format {
        image::ImageFormat::Jpeg => "JPEG",
        image::ImageFormat::WebP => "WebP",
        image::ImageFormat::Tiff => "TIFF",
        image::ImageFormat::Pnm => "PNM",
        _ => "PNG",
    }
}

/// Columns and rows as a PNG's first chunk states them: behind the signature, its length and its name.
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

    use depthloom_graphs::values::Pixels;
    use image::DynamicImage;

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

    #[test]
    fn what_is_no_camera_image_is_made_one_and_its_bytes_are_not_kept() {
        let written = |image: &DynamicImage, format| {
            let mut bytes = Vec::new();
            image.write_to(&mut std::io::Cursor::new(&mut bytes), format).expect("written");
            super::image(Path::new("left"), bytes.into()).expect("it is an image")
        };
        let deep = image::ImageBuffer::from_raw(2, 1, vec![0x12ff_u16, 0xff00]).expect("two samples");
        let grey = written(&DynamicImage::ImageLuma16(deep), image::ImageFormat::Png);
        assert_eq!((grey.pixels(), grey.encoded().is_some()), (&grey_of(&[0x12, 0xff]), false));
        let clear = image::ImageBuffer::from_raw(1, 1, vec![1_u8, 2, 3, 4]).expect("a pixel");
        let rgb = written(&DynamicImage::ImageRgba8(clear), image::ImageFormat::Png);
        assert_eq!((rgb.pixels(), rgb.encoded().is_some()), (&rgb_of(&[1, 2, 3]), false));
        let plain = DynamicImage::ImageLuma8(image::GrayImage::from_raw(2, 1, vec![7, 9]).expect("two samples"));
        for (format, is_kept) in
            [(image::ImageFormat::Png, true), (image::ImageFormat::Tiff, false), (image::ImageFormat::Pnm, false)]
        {
            let image = written(&plain, format);
            assert_eq!((image.pixels(), image.encoded().is_some()), (&grey_of(&[7, 9]), is_kept), "{format:?}");
        }
        assert!(written(&plain, image::ImageFormat::Jpeg).encoded().is_some());
    }

    fn grey_of(samples: &[u8]) -> Pixels {
        Pixels::Grey(image::GrayImage::from_raw(samples.len() as u32, 1, samples.to_vec()).expect("a row"))
    }

    fn rgb_of(samples: &[u8]) -> Pixels {
        Pixels::Rgb(image::RgbImage::from_raw(samples.len() as u32 / 3, 1, samples.to_vec()).expect("a row"))
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
