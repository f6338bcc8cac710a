//! Images and maps as PNG, maps in KITTI's 16-bit convention.

use std::io::Cursor;

use depthloom_graphs::Value;
use depthloom_graphs::values::{ImageFormat, Pixels, Raster};
use image::{ImageBuffer, ImageError};

/// An image file's bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Png {
    /// The file's content.
    pub bytes: Vec<u8>,
    /// What its name ends in: `jpg` where an image came from such a file, whose bytes are kept.
    pub ending: &'static str,
    /// How many valid pixels do not fit 16 bits: too large ones are stored as the largest number, those below zero as
    /// invalid.
    pub clipped: u64,
}

/// An image as it is; a map as 16 bits: 256ths of a pixel or metre, rounded to the nearest, 0 = invalid, as in
/// KITTI's files; a weight as 65535ths.
///
/// As in the KITTI devkit, a valid pixel that rounds to zero is 1, and a disparity below zero is invalid.
pub fn png(value: &Value) -> Result<Png, String> {
    let mut clipped = 0;
    let bytes = match value {
        Value::Image(image) => {
            if let Some(encoded) = image.encoded() {
                let ending = match encoded.format {
                    ImageFormat::Png => "png",
                    ImageFormat::Jpeg => "jpg",
                };
                return Ok(Png { bytes: encoded.bytes.to_vec(), ending, clipped });
            }
            match image.pixels() {
                Pixels::Grey(grey) => encoded(|out| grey.write_to(out, image::ImageFormat::Png)),
                Pixels::Rgb(rgb) => encoded(|out| rgb.write_to(out, image::ImageFormat::Png)),
            }
        }
        Value::Mask(mask) => encoded(|out| mask.set.write_to(out, image::ImageFormat::Png)),
        Value::TrueDisparity(truth) => sixteen_bits(&truth.px, valid, 256.0, &mut clipped),
        Value::FloatDisparity(map) => sixteen_bits(map.px(), valid, 256.0, &mut clipped),
        Value::Disparity(disparity) => {
            let invalid = disparity.invalid();
            let px = |fixed: i16| (i32::from(fixed) != invalid).then(|| f64::from(fixed) / 16.0);
            sixteen_bits(&disparity.sixteenths_px, px, 256.0, &mut clipped)
        }
        Value::Depth(depth) => sixteen_bits(&depth.metres, valid, 256.0, &mut clipped),
        Value::RelativeDepth(map) => sixteen_bits(&map.depth().metres, valid, 256.0, &mut clipped),
        Value::Weight(weight) => sixteen_bits(&weight.share, valid, 65535.0, &mut clipped),
        Value::RelativeInverseDepth(_)
        | Value::Calibration(_)
        | Value::Scores(_)
        | Value::Samples(_)
        | Value::Model(_)
        | Value::Reliability(_)
        | Value::Curve(_)
        | Value::Number(_) => {
            return Err(format!("a value of type {} is not an image", value.value_type()));
        }
    };
    Ok(Png { bytes: bytes?, ending: "png", clipped })
}

fn valid(sample: f32) -> Option<f64> {
    (!sample.is_nan()).then_some(f64::from(sample))
}

/// The PNG of `scale` times the number that `valid` returns, 0 if it returns none; adds to `clipped` the numbers that
/// 16 bits do not hold.
fn sixteen_bits<T: Copy>(
    raster: &Raster<T>,
    valid: impl Fn(T) -> Option<f64>,
    scale: f64,
    clipped: &mut u64,
) -> Result<Vec<u8>, String>
where
    image::Luma<T>: image::Pixel<Subpixel = T>,
{
    let mut sixteen = |sample: &T| {
        let Some(valid) = valid(*sample) else { return 0 };
        let scaled = (valid * scale).round();
        if valid < 0.0 || scaled > f64::from(u16::MAX) {
            *clipped += 1;
        }
        if valid < 0.0 { 0 } else { scaled.clamp(1.0, f64::from(u16::MAX)) as u16 }
    };
    let (width, height) = raster.dimensions();
    let samples = raster.as_raw().iter().map(&mut sixteen).collect();
    let image: Raster<u16> = ImageBuffer::from_raw(width, height, samples).expect("as many samples as before");
    encoded(|out| image.write_to(out, image::ImageFormat::Png))
}

pub(super) fn encoded(write: impl FnOnce(&mut Cursor<Vec<u8>>) -> Result<(), ImageError>) -> Result<Vec<u8>, String> {
    let mut out = Cursor::new(Vec::new());
    write(&mut out).map_err(|error| format!("an image cannot be written as PNG: {error}"))?;
    Ok(out.into_inner())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use depthloom_graphs::Value;
    use depthloom_graphs::values::{
        Depth, Disparity, Encoded, Image, ImageFormat, Pixels, Raster, TrueDisparity, Weight,
    };
    use image::{DynamicImage, GrayImage};

    use super::{Png, png};

    fn sixteen_bits(value: impl Into<Value>) -> (Vec<u16>, u64) {
        let Png { bytes, ending: "png", clipped } = png(&value.into()).unwrap() else { panic!("a PNG") };
        let DynamicImage::ImageLuma16(image) = image::load_from_memory(&bytes).unwrap() else { panic!("16 bits") };
        (image.into_raw(), clipped)
    }

    #[test]
    fn maps_are_256ths_with_zero_for_invalid() {
        let metres = vec![f32::NAN, 0.0, 1.0, 10.001, 255.999, 300.0, f32::INFINITY, -1.0];
        let depth = Depth { metres: Raster::from_raw(4, 2, metres).unwrap() };
        assert_eq!(sixteen_bits(depth), (vec![0, 1, 256, 2560, 65535, 65535, 65535, 0], 4));
        let sixteenths_px = Raster::from_raw(5, 1, vec![-80, -79, 0, 1, 4096]).unwrap();
        let disparity = Disparity { sixteenths_px, min_disparity_px: -4 };
        assert_eq!(sixteen_bits(disparity), (vec![0, 0, 1, 16, 65535], 2));
        let truth = TrueDisparity::from_px_256(&Raster::from_raw(3, 1, vec![0, 1, 65535]).unwrap());
        assert_eq!(sixteen_bits(truth), (vec![0, 1, 65535], 0));
        let px = Raster::from_raw(4, 1, vec![10.001, 300.0, 0.0, f32::NAN]).unwrap();
        assert_eq!(sixteen_bits(TrueDisparity { px }), (vec![2560, 65535, 1, 0], 1));
        let share = Raster::from_raw(3, 1, vec![1.0, 0.5, f32::NAN]).unwrap();
        assert_eq!(sixteen_bits(Weight { share }), (vec![65535, 32768, 0], 0));
    }

    #[test]
    fn an_image_that_came_from_a_file_is_that_file() {
        let bytes: Arc<[u8]> = (*b"whatever stood in it").into();
        let file = Encoded { format: ImageFormat::Jpeg, bytes: bytes.clone() };
        let image = Image::with_encoded(Pixels::Grey(GrayImage::new(2, 1)), file);
        let expected = Png { bytes: bytes.to_vec(), ending: "jpg", clipped: 0 };
        assert_eq!(png(&image.into()), Ok(expected));
        assert!(png(&Value::Scores(Arc::default())).is_err());
    }
}
