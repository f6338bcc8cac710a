//! JPEG files as libjpeg-turbo decodes them with its defaults (integer DCT, smooth upsampling of colour), bit by bit:
//! OpenCV and Pillow use it.
//!
//! The decoder of the crate `image` rounds its DCT, upsampling and colours otherwise: its samples differ by up to 3,
//! and so do disparities of them.

use depthloom_graphs::values::Pixels;
use image::{GrayImage, RgbImage};
use libjpeg_turbo_rs::{DecodeLimits, Decoder, PixelFormat};

/// The most memory that a file is decoded in, bytes: progressive files keep all their coefficients.
const MOST_BYTES: u64 = 3 << 30;

const START_OF_SCAN: [u8; 2] = [0xff, 0xda];
const END_OF_IMAGE: [u8; 2] = [0xff, 0xd9];

/// The pixels of a JPEG file of one or three components; `None` for a file of others (CMYK) or of more than 8 bits.
///
/// # Errors
/// What is wrong with the file, as a lower-case fragment. A truncated file is an error, other than with libjpeg-turbo,
/// which fills it with grey.
pub fn decode(file: &[u8]) -> Result<Option<Pixels>, String> {
    // Within a scan these bytes do not occur: where the last scan has no end, the file is cut off.
    let last = |marker: [u8; 2]| file.windows(2).rposition(|bytes| *bytes == marker);
    if last(END_OF_IMAGE) < last(START_OF_SCAN) {
        return Err("its last scan does not end".to_owned());
    }
    let limits = DecodeLimits { max_memory: Some(MOST_BYTES), ..DecodeLimits::default() };
    let failed = |error: libjpeg_turbo_rs::JpegError| error.to_string();
    let mut decoder = Decoder::new_with_limits(file, limits).map_err(failed)?;
    let frame = decoder.header();
    let format = match (frame.components.len(), frame.precision) {
        (1, 8) => PixelFormat::Grayscale,
        (3, 8) => PixelFormat::Rgb,
        _ => return Ok(None),
    };
    decoder.set_output_format(format);
    decoder.set_stop_on_warning(true);
    let decoded = decoder.decode_image().map_err(failed)?;
    let side = |side: usize| u32::try_from(side).map_err(|error| error.to_string());
    let (width, height) = (side(decoded.width)?, side(decoded.height)?);
    let pixels = match format {
        PixelFormat::Grayscale => GrayImage::from_raw(width, height, decoded.data).map(Pixels::Grey),
        _ => RgbImage::from_raw(width, height, decoded.data).map(Pixels::Rgb),
    };
    pixels.map(Some).ok_or_else(|| format!("its pixels are not those of a {width}x{height} image"))
}
