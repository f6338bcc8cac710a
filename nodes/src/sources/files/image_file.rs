//! Image files, recognised by their first bytes, within limits, because they may come from a stranger.

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use depthloom_bags::images::{Brightest, eight_bits};
use depthloom_codecs::jpeg;
use depthloom_graphs::values::{Encoded, Image, ImageFormat, Pixels, Raster};
use depthloom_graphs::{Fault, regular_file};
use image::metadata::Orientation;
use image::{DynamicImage, GrayImage, ImageDecoder, ImageError, ImageReader, RgbImage};

/// Bytes of a file, and of its pixels: 8192 x 8192 of 16-bit RGB are 384 MiB.
const MOST_BYTES: u64 = 512 << 20;

pub(crate) fn read(path: &Path) -> Result<Arc<[u8]>, Fault> {
    let bytes = regular_file::read(path, MOST_BYTES);
    bytes.map(Into::into).map_err(|error| Fault::new(format!("failed to read {}", path.display())).because(error))
}

/// Reads PNG, JPEG, WebP, TIFF and PNM as OpenCV's `imread`: the upper 8 of 16 bits, no transparency, EXIF orientation
/// applied. Unchanged 8-bit PNG and JPEG files keep their bytes.
pub(crate) fn image(path: &Path, bytes: Arc<[u8]>) -> Result<Image, Fault> {
    image_of_bits(path, bytes, None).map(|(image, _)| image)
}

/// 16-bit samples use the lowest `bits`. Also returns how bright a 16-bit image is.
pub(crate) fn image_of_bits(
    path: &Path,
    bytes: Arc<[u8]>,
    bits: Option<u32>,
) -> Result<(Image, Option<Brightest>), Fault> {
    let format = format_of(path, &bytes)?;
    let (mut decoded, orientation) = decode(path, format, &bytes)?;
    decoded.apply_orientation(orientation);
    let is_turned = orientation != Orientation::NoTransforms;
    let mut brightest = None;
    let mut narrowed = |samples: &[u16]| {
        brightest = Brightest::from_samples(samples);
        eight_bits(samples, bits)
    };
    let (pixels, is_unchanged) = match decoded {
        DynamicImage::ImageLuma8(grey) => (Pixels::Grey(grey), !is_turned),
        DynamicImage::ImageRgb8(rgb) => (Pixels::Rgb(rgb), !is_turned),
        transparent @ DynamicImage::ImageLumaA8(_) => (Pixels::Grey(transparent.into_luma8()), false),
        transparent @ DynamicImage::ImageRgba8(_) => (Pixels::Rgb(transparent.into_rgb8()), false),
        deep @ (DynamicImage::ImageLuma16(_) | DynamicImage::ImageLumaA16(_)) => {
            let deep = deep.into_luma16();
            let (width, height) = deep.dimensions();
            let grey = GrayImage::from_raw(width, height, narrowed(&deep));
            (Pixels::Grey(grey.expect("one byte per pixel")), false)
        }
        deep @ (DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_)) => {
            let deep = deep.into_rgb16();
            let (width, height) = deep.dimensions();
            let rgb = RgbImage::from_raw(width, height, narrowed(&deep));
            (Pixels::Rgb(rgb.expect("three bytes per pixel")), false)
        }
        other => {
            return Err(wrong_pixels(path, &other, "camera images must be grey or RGB with 8 or 16 bits").remedy(
                "convert the file to 8 bits; of a data set that was downloaded, take it from its archive again",
            ));
        }
    };
    let image = match format {
        image::ImageFormat::Png if is_unchanged => {
            Image::with_encoded(pixels, Encoded { format: ImageFormat::Png, bytes })
        }
        image::ImageFormat::Jpeg if is_unchanged => {
            Image::with_encoded(pixels, Encoded { format: ImageFormat::Jpeg, bytes })
        }
        _ => Image::new(pixels),
    };
    Ok((image, brightest))
}

/// PNG or TIFF with one 16-bit channel of `unit` times 256: `disparity` (px) or `metres`.
pub(crate) fn map_u16(path: &Path, bytes: &[u8], unit: &str) -> Result<Raster<u16>, Fault> {
    match decode(path, format_of(path, bytes)?, bytes)?.0 {
        DynamicImage::ImageLuma16(map) => Ok(map),
        other => {
            let expected = format!("the map must have 16 bits and one channel ({unit} * 256, 0 = unknown)");
            Err(wrong_pixels(path, &other, &expected).remedy(format!(
                "write {unit} * 256 as 16-bit grey, 0 where it is unknown; of a downloaded data set, take the file from its archive again: an \
                 image tool may have saved it with 8 bits"
            )))
        }
    }
}

/// One 8-bit channel, or three equal ones. `what` describes the expected map in messages.
pub(crate) fn map_u8(path: &Path, bytes: &[u8], what: &str) -> Result<GrayImage, Fault> {
    let remedy = "of a downloaded data set, take the file from its archive again: an image tool may have changed it";
    match decode(path, format_of(path, bytes)?, bytes)?.0 {
        DynamicImage::ImageLuma8(map) => Ok(map),
        DynamicImage::ImageRgb8(rgb) => {
            let pixels = rgb.as_raw().as_chunks::<3>().0;
            if pixels.iter().any(|[red, green, blue]| red != green || green != blue) {
                return Err(Fault::new(format!("{} is a colour image: {what}", path.display())).remedy(remedy));
            }
            let grey = GrayImage::from_raw(rgb.width(), rgb.height(), pixels.iter().map(|pixel| pixel[0]).collect());
            Ok(grey.expect("one byte per pixel"))
        }
        other => Err(wrong_pixels(path, &other, what).remedy(remedy)),
    }
}

const ONE_CHANNEL: &str = "a map must have one channel of 8 or 16 bits, or of 32-bit floats (TIFF)";

/// Returns the map and the bits per number: 8 or 16 (PNG, TIFF, PNM), or 32-bit floats (TIFF).
pub(crate) fn numbers(path: &Path, bytes: &[u8]) -> Result<(Raster<f32>, u32), Fault> {
    let format = format_of(path, bytes)?;
    if format == image::ImageFormat::Tiff
        && let Some(floats) = float_tiff(path, bytes)?
    {
        return Ok((floats, 32));
    }
    let (size, numbers, bits): (_, Vec<f32>, _) = match decode(path, format, bytes)?.0 {
        DynamicImage::ImageLuma8(map) => (map.dimensions(), map.iter().map(|number| f32::from(*number)).collect(), 8),
        DynamicImage::ImageLuma16(map) => (map.dimensions(), map.iter().map(|number| f32::from(*number)).collect(), 16),
        other => {
            let remedy = "write one number per pixel; a colour-coded picture is not a map";
            return Err(wrong_pixels(path, &other, ONE_CHANNEL).remedy(remedy));
        }
    };
    Ok((Raster::from_raw(size.0, size.1, numbers).expect("one number per pixel"), bits))
}

/// `image` does not read these. `None` for other TIFF files.
fn float_tiff(path: &Path, bytes: &[u8]) -> Result<Option<Raster<f32>>, Fault> {
    let failed = |error: tiff::TiffError| {
        Fault::new(format!("failed to decode {} ({} bytes)", path.display(), bytes.len()))
            .because(error.to_string())
            .remedy("the file is not a complete TIFF: copy or download it again")
    };
    let mut limits = tiff::decoder::Limits::default();
    limits.decoding_buffer_size = MOST_BYTES as usize;
    limits.intermediate_buffer_size = MOST_BYTES as usize;
    let mut decoder = tiff::decoder::Decoder::new(Cursor::new(bytes)).map_err(failed)?.with_limits(limits);
    match decoder.colortype().map_err(failed)? {
        tiff::ColorType::Gray(32) => {}
        tiff::ColorType::RGB(bits @ (32 | 64)) => {
            let what = format!("{} holds {bits}-bit numbers in 3 channels: {ONE_CHANNEL}", path.display());
            return Err(Fault::new(what).remedy("write one channel of 32-bit floats"));
        }
        _ => return Ok(None),
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

/// With the first bytes of their files.
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
    // Unknown bytes are reported by the extension of the name, if there is one: an empty file, a text instead of an
    // image.
    let by_content = FORMATS.iter().find(|(begin, _)| bytes.starts_with(begin)).map(|(_, format)| *format);
    let by_name =
        || image::ImageFormat::from_path(path).ok().filter(|found| FORMATS.iter().any(|(_, format)| format == found));
    if regular_file::is_lfs_pointer(bytes) {
        return Err(Fault::new(format!("{} is a pointer of Git LFS, not the file itself", path.display()))
            .remedy(regular_file::LFS_REMEDY));
    }
    by_content.or_else(by_name).ok_or_else(|| {
        Fault::new(format!("{} ({} bytes) is not an image", path.display(), bytes.len()))
            .remedy("images are PNG, JPEG, WebP, TIFF or PNM files")
    })
}

/// The pixels as they are stored, and their orientation. Maps have no orientation.
fn decode(path: &Path, format: image::ImageFormat, bytes: &[u8]) -> Result<(DynamicImage, Orientation), Fault> {
    let failed = |error: ImageError| {
        // The header may request more than the decoder counts; one byte per pixel is the least.
        let pixels = |(width, height): (u32, u32)| u64::from(width) * u64::from(height);
        let limit = matches!(error, ImageError::Limits(_));
        if let Some(size) = stated_size(bytes).filter(|size| limit && pixels(*size) > MOST_BYTES) {
            return too_large(path, size, pixels(size));
        }
        // As text: the decoder's error already contains the message of its cause.
        let fault = undecodable(path, format, bytes).because(error.to_string().trim_end());
        match limit {
            true => fault.remedy(
                "its metadata need more memory than an image may use; check that the path names the right file",
            ),
            false => fault,
        }
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
    let orientation = decoder.orientation().map_err(failed)?;
    if format == image::ImageFormat::Jpeg {
        let pixels = jpeg::decode(bytes).map_err(|what| undecodable(path, format, bytes).because(what))?;
        if let Some(pixels) = pixels {
            let image = match pixels {
                Pixels::Grey(grey) => DynamicImage::ImageLuma8(grey),
                Pixels::Rgb(rgb) => DynamicImage::ImageRgb8(rgb),
            };
            return Ok((image, orientation));
        }
    }
    DynamicImage::from_decoder(decoder).map_err(failed).map(|image| (image, orientation))
}

fn undecodable(path: &Path, format: image::ImageFormat, bytes: &[u8]) -> Fault {
    Fault::new(format!("failed to decode {} ({} bytes)", path.display(), bytes.len()))
        .remedy(format!("the file is not a complete {}: copy or download it again", name_of(format)))
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

/// Columns and rows from a PNG's first chunk.
fn stated_size(bytes: &[u8]) -> Option<(u32, u32)> {
    let word = |at: usize| Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    if bytes.get(12..16)? == b"IHDR" { Some((word(16)?, word(20)?)) } else { None }
}

fn too_large(path: &Path, (width, height): (u32, u32), needed: u64) -> Fault {
    let (path, needed, most) = (path.display(), needed.div_ceil(1 << 20), MOST_BYTES >> 20);
    let what = format!("{path} is {width}x{height}, which takes at least {needed} MiB decoded");
    Fault::new(format!("{what}: more than the {most} MiB an image may take"))
        .remedy("check that the path names the right file")
}

fn wrong_pixels(path: &Path, found: &DynamicImage, expected: &str) -> Fault {
    let color = found.color();
    let channels = color.channel_count();
    let (bits, plural) = (color.bits_per_pixel() / u16::from(channels), if channels == 1 { "" } else { "s" });
    Fault::new(format!("{} has {bits}-bit pixels with {channels} channel{plural}: {expected}", path.display()))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use depthloom_graphs::values::Pixels;
    use depthloom_test_needs::workspace;
    use image::DynamicImage;

    /// A PNG header of that size, 8-bit grey, with few rows of data.
    fn claims(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        let pixel = image::GrayImage::new(1, 1);
        pixel.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).expect("written");
        // Signature, length and name of the first chunk; then width and height, and after its 13 bytes the checksum.
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

    fn error(bytes: Vec<u8>) -> String {
        let fault = super::image(Path::new("left.png"), bytes.into()).expect_err("it is refused");
        format!("{fault}: {}", fault.remedy_text().unwrap_or_default())
    }

    #[test]
    fn fault_12_and_52_an_image_that_asks_for_too_much_is_refused_with_its_size() {
        let bomb = error(claims(60_000, 60_000));
        assert!(
            bomb.contains("left.png is 60000x60000, which takes at least 3434 MiB decoded: more than the 512 MiB"),
            "{bomb}"
        );
        assert!(!bomb.contains("download"), "{bomb}");
        assert!(error(claims(u32::MAX >> 1, u32::MAX >> 1)).contains("more than the 512 MiB"));
        assert!(error(claims(30, 30)).ends_with("the file is not a complete PNG: copy or download it again"));
    }

    #[test]
    fn other_images_are_converted_and_their_bytes_are_dropped() {
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

    #[test]
    fn faults_10_and_53_pixels_are_those_of_opencvs_imread() {
        let folder = workspace().join("tests/fixtures/golden/decoding");
        let files = std::fs::read_dir(&folder).expect("the fixtures").map(|entry| entry.expect("a file").file_name());
        let names: Vec<String> = files.map(|name| name.to_string_lossy().into_owned()).collect();
        let mut count = 0;
        for name in names.iter().filter(|name| name.split('.').count() == 2) {
            let expected = image::open(folder.join(format!("{name}.png"))).expect("a PNG").into_rgb8();
            let path = folder.join(name);
            let found = super::image(&path, super::read(&path).expect("readable")).expect("decodable");
            let rgb = match found.pixels() {
                Pixels::Rgb(rgb) => rgb.clone(),
                Pixels::Grey(grey) => DynamicImage::ImageLuma8(grey.clone()).into_rgb8(),
            };
            assert_eq!(rgb.dimensions(), expected.dimensions(), "{name}");
            let differ = rgb.iter().zip(expected.iter()).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "{name}: samples that are not OpenCV's");
            // The bytes of a turned image show another image to readers that ignore the orientation.
            let is_turned = name.starts_with("orientation_") && !name.starts_with("orientation_1");
            let is_kept = !is_turned && (name.ends_with("jpg") || name.ends_with("png"));
            assert_eq!(found.encoded().is_some(), is_kept, "{name}");
            count += 1;
        }
        assert_eq!(count, 41);
    }

    #[test]
    fn a_jpeg_file_that_was_cut_off_is_refused() {
        let folder = workspace().join("tests/fixtures/golden/decoding");
        for name in ["420_60.jpg", "444_95.jpg", "420_progressive.jpg", "grey.jpg", "restart.jpg"] {
            let whole = std::fs::read(folder.join(name)).expect("the fixture");
            for missing in [2, 20, whole.len() / 2] {
                let what = error(whole[..whole.len() - missing].to_vec());
                assert!(what.ends_with("the file is not a complete JPEG: copy or download it again"), "{name}: {what}");
            }
        }
    }

    #[test]
    fn fault_52_of_16_bits_those_are_used_that_the_camera_has() {
        let png = |samples: Vec<u16>| {
            let mut bytes = Vec::new();
            let image = image::ImageBuffer::from_raw(samples.len() as u32, 1, samples).expect("a row");
            DynamicImage::ImageLuma16(image)
                .write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png)
                .expect("written");
            bytes
        };
        let found = |samples: &[u16], bits| {
            let (image, brightest) =
                super::image_of_bits(Path::new("left.png"), png(samples.to_vec()).into(), bits).expect("an image");
            let Pixels::Grey(grey) = image.pixels() else { panic!("it is grey") };
            (grey.to_vec(), brightest.and_then(|brightest| brightest.warning(bits)).is_some())
        };
        let of_12 = [0, 15, 16, 2048, 4095];
        assert_eq!(found(&of_12, None), (vec![0, 0, 0, 8, 15], true), "collapsed, and reported");
        assert_eq!(found(&of_12, Some(12)), (vec![0, 0, 1, 128, 255], false));
        assert_eq!(found(&[4096, 65535], Some(12)), (vec![255, 255], false), "beyond white");
        assert_eq!(found(&[4096, 65535], None), (vec![16, 255], false));
        assert_eq!(found(&[4095], Some(16)), (vec![15], false), "an explicit 16 is used");
        assert_eq!(found(&[0, 0], None), (vec![0, 0], false), "black is black");
    }

    #[test]
    fn fault_61_a_coloured_tiff_of_floats_is_named_as_that() {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).expect("an encoder");
        encoder.write_image::<tiff::encoder::colortype::RGB32Float>(2, 1, &[0.5_f32; 6]).expect("written");
        let fault = super::numbers(Path::new("map.tif"), &bytes.into_inner()).expect_err("it is refused");
        let what = fault.chain();
        assert!(what.contains("map.tif holds 32-bit numbers in 3 channels: a map must have one channel"), "{what}");
    }

    fn grey_of(samples: &[u8]) -> Pixels {
        Pixels::Grey(image::GrayImage::from_raw(samples.len() as u32, 1, samples.to_vec()).expect("a row"))
    }

    fn rgb_of(samples: &[u8]) -> Pixels {
        Pixels::Rgb(image::RgbImage::from_raw(samples.len() as u32 / 3, 1, samples.to_vec()).expect("a row"))
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_not_an_image_and_does_not_block() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("000000_10.png");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().expect("mkfifo is there").success());
        let fault = super::read(&path).expect_err("it is refused");
        assert!(fault.to_string().contains("failed to read"), "{fault}");
    }
}
