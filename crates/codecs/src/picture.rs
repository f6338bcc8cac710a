//! Maps as small pictures to look at, which any viewer draws right without a setting.
//!
//! A picture is a PNG of indexed colours, of every second pixel and row; black = invalid. Colours follow ratios, not
//! differences: what is twice as far is as many colours away, near as well as far, and all pictures share the scale, so
//! that a depth and the disparity it was made of look alike.

use std::borrow::Cow;

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Raster};
use depthloom_simd::{Level, Pass, prefetch};
use png::{BitDepth, ColorType, Compression, Encoder, Filter};

use crate::files::Colours;

/// A picture has every `STEP`th column and row.
const STEP: u32 = 2;
/// Colours except black: few enough that neighbours are often equal, and more than an eye can distinguish in a map.
const LEVELS: u8 = 63;
/// What is as near or nearer has the last colour, what is as far or farther the first, metres.
const NEAR_M: f32 = 1.0;
const FAR_M: f32 = 100.0;
/// The same of disparities, pixels: as far as the depths where focal length times baseline is 400 px m, as KITTI's
/// nearly is.
const FAR_PX: f32 = 4.0;
const NEAR_PX: f32 = 400.0;

/// The calibration of the camera that a picture of another's map is of.
#[must_use]
pub fn reduced(calibration: &Calibration) -> Calibration {
    let step = f64::from(STEP);
    Calibration {
        width: calibration.width.div_ceil(STEP),
        height: calibration.height.div_ceil(STEP),
        focal_px: calibration.focal_px / step,
        cx_px: calibration.cx_px / step,
        cy_px: calibration.cy_px / step,
        baseline_m: calibration.baseline_m,
        doffs_px: calibration.doffs_px / step,
    }
}

/// The picture of a map, a PNG's bytes; `None` if the value is not a map, or has no pixels.
#[must_use]
pub fn picture(value: &Value) -> Option<Vec<u8>> {
    let ratio = |from: f32, to: f32| Scale::new(from, to);
    let depth = |metres: &Raster<f32>| {
        let scale = ratio(NEAR_M, FAR_M);
        let level = |metres: f32| if metres.is_nan() { 0 } else { 1 + LEVELS - scale.level(metres) };
        png(metres, Colours::Turbo, level)
    };
    let px = |px: &Raster<f32>| {
        let scale = ratio(FAR_PX, NEAR_PX);
        png(px, Colours::Turbo, |px: f32| if px.is_nan() { 0 } else { scale.level(px) })
    };
    match value {
        Value::Depth(of) => depth(&of.metres),
        Value::RelativeDepth(map) => depth(&map.depth().metres),
        Value::FloatDisparity(map) => px(map.px()),
        Value::Disparity(disparity) => {
            let (scale, invalid) = (ratio(FAR_PX, NEAR_PX), disparity.invalid());
            png(&disparity.sixteenths_px, Colours::Turbo, |fixed: i16| {
                if i32::from(fixed) == invalid { 0 } else { scale.level(f32::from(fixed) / 16.0) }
            })
        }
        Value::TrueDisparity(truth) => px(&truth.px),
        Value::Weight(weight) => png(&weight.share, Colours::Viridis, |share: f32| {
            if share.is_nan() { 0 } else { 1 + rounded(share.clamp(0.0, 1.0) * (LEVELS - 1) as f32) }
        }),
        _ => None,
    }
}

/// Ratios to levels from 1 to [`LEVELS`].
///
/// The bits of a positive float grow with it, and grow alike from each power of two to the next: between these a
/// straight line replaces the logarithm, which is exact on every machine, and at most a twelfth of an octave off.
struct Scale {
    from: i32,
    span: i32,
    /// Levels for each step of the bits.
    per_step: f32,
}

impl Scale {
    const fn new(from: f32, to: f32) -> Self {
        let (from, to) = (from.to_bits() as i32, to.to_bits() as i32);
        Self { from, span: to - from, per_step: (LEVELS - 1) as f32 / (to - from) as f32 }
    }

    /// The level of a number; one that is not positive has the lowest. Plain arithmetic alone, so that a row is done in
    /// vectors.
    #[inline(always)]
    fn level(&self, number: f32) -> u8 {
        // All bits of a negative number, read as a signed one, are below those of a positive.
        let above = (number.to_bits() as i32).max(self.from) - self.from;
        1 + rounded(above.min(self.span) as f32 * self.per_step)
    }
}

/// The nearest whole number of one from 0 to 255. Above 2^23 a float's last bits count ones; a cast, which must ask for
/// NaN and bounds, would leave the vectors.
#[inline(always)]
fn rounded(number: f32) -> u8 {
    (number + 8_388_608.0).to_bits() as u8
}

/// A PNG of every second pixel and row.
fn png<T: Copy>(raster: &Raster<T>, colours: Colours, level: impl Fn(T) -> u8) -> Option<Vec<u8>>
where
    image::Luma<T>: image::Pixel<Subpixel = T>,
{
    let (width, height) = raster.dimensions();
    if width == 0 || height == 0 {
        return None;
    }
    let columns = width.div_ceil(STEP) as usize;
    let mut levels = vec![0; columns * height.div_ceil(STEP) as usize];
    Level::best().run(Levels { raster, level, out: &mut levels });
    let mut out = Vec::with_capacity(levels.len() / 2);
    let mut encoder = Encoder::new(&mut out, width.div_ceil(STEP), height.div_ceil(STEP));
    encoder.set_color(ColorType::Indexed);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_palette(Cow::Owned(palette(colours)));
    encoder.set_compression(Compression::Fastest);
    encoder.set_filter(Filter::Up);
    let written =
        encoder.write_header().and_then(|mut writer| writer.write_image_data(&levels).and_then(|()| writer.finish()));
    written.ok().map(|()| out)
}

/// Makes the levels of every second pixel and row.
struct Levels<'a, T, F>
where
    image::Luma<T>: image::Pixel<Subpixel = T>,
{
    raster: &'a Raster<T>,
    level: F,
    out: &'a mut [u8],
}

impl<T: Copy, F: Fn(T) -> u8> Pass for Levels<'_, T, F>
where
    image::Luma<T>: image::Pixel<Subpixel = T>,
{
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.raster.width() as usize;
        let samples = self.raster.as_raw();
        let rows = samples.chunks_exact(width).enumerate().step_by(STEP as usize);
        for (levels, (y, row)) in self.out.chunks_exact_mut(width.div_ceil(STEP as usize)).zip(rows) {
            prefetch(samples, (y + STEP as usize) * width, width);
            let (pairs, last) = row.as_chunks::<{ STEP as usize }>();
            for (of_pixel, pair) in levels.iter_mut().zip(pairs) {
                *of_pixel = (self.level)(pair[0]);
            }
            if let ([last, ..], Some(of_pixel)) = (last, levels.last_mut()) {
                *of_pixel = (self.level)(*last);
            }
        }
    }
}

fn palette(colours: Colours) -> Vec<u8> {
    let levels = (0..LEVELS).map(|level| f64::from(level) / f64::from(LEVELS - 1));
    [0; 3].into_iter().chain(levels.flat_map(|share| colours.rgb(share))).collect()
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Value;
    use depthloom_graphs::values::{Calibration, Depth, Disparity, Raster, TrueDisparity, Weight};
    use image::RgbImage;

    use super::{picture, reduced};

    fn seen(value: impl Into<Value>) -> RgbImage {
        image::load_from_memory(&picture(&value.into()).unwrap()).unwrap().into_rgb8()
    }

    #[test]
    fn only_invalid_pixels_are_black() {
        let metres = [f32::NAN, 0.0, -1.0, 1e-20, 0.5, 1.0, 10.0, 100.0, 1e9, f32::INFINITY, f32::NEG_INFINITY];
        // Every second pixel and row is in the picture; the others are ignored.
        let map: Vec<f32> = metres.iter().flat_map(|depth| [*depth, 3.0]).chain([5.0; 22]).collect();
        let image = seen(Depth { metres: Raster::from_raw(22, 2, map).unwrap() });
        assert_eq!(image.dimensions(), (11, 1));
        let [near, far] = [[0x7a, 0x04, 0x03], [0x30, 0x12, 0x3b]];
        let pixels: Vec<[u8; 3]> = image.pixels().map(|of| of.0).collect();
        assert_eq!(pixels[0], [0; 3]);
        assert_eq!(pixels[1..6], [near; 5]);
        assert!(pixels[6] != near && pixels[6] != far && pixels[6] != [0; 3]);
        assert_eq!(pixels[7..10], [far; 3]);
        assert_eq!(pixels[10], near, "below zero is nearer than near");
    }

    #[test]
    fn a_disparity_and_its_depth_look_alike() {
        let disparities: Vec<i16> = (-16..16 * 256).step_by(1).map(|fixed| fixed as i16).collect();
        let width = disparities.len() as u32;
        let sixteenths_px = Raster::from_raw(width, 1, disparities.clone()).unwrap();
        let of_disparity = seen(Disparity { sixteenths_px, min_disparity_px: 0 });
        assert_eq!(of_disparity.get_pixel(0, 0).0, [0; 3], "nothing found");
        let depths = disparities.iter().map(|fixed| 400.0 / (f32::from((*fixed).max(1)) / 16.0)).collect();
        let of_depth = seen(Depth { metres: Raster::from_raw(width, 1, depths).unwrap() });
        // Straight lines from one power of two to the next, once upwards and once downwards: a few levels of 63 apart.
        let apart = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max().unwrap();
        let pairs = of_disparity.pixels().zip(of_depth.pixels()).skip(9);
        let worst = pairs.map(|(a, b)| apart(a.0, b.0)).max().unwrap();
        assert!(worst < 80, "{worst}");
        let truth = disparities.iter().map(|fixed| (*fixed).clamp(0, 4095) as u16 * 16).collect();
        let of_truth = seen(TrueDisparity::from_px_256(&Raster::from_raw(width, 1, truth).unwrap()));
        assert_eq!(of_truth.get_pixel(2000, 0), of_disparity.get_pixel(2000, 0));
        assert_eq!(of_truth.get_pixel(8, 0).0, [0; 3], "unknown");
    }

    #[test]
    fn weights_have_a_scale_of_their_own() {
        let share = Raster::from_raw(7, 1, vec![f32::NAN, 9.0, 0.0, 9.0, 1.0, 9.0, 2.0]).unwrap();
        let image = seen(Weight { share });
        let pixels: Vec<[u8; 3]> = image.pixels().map(|of| of.0).collect();
        assert_eq!(pixels, [[0; 3], [0x44, 0x01, 0x54], [0xfd, 0xe7, 0x25], [0xfd, 0xe7, 0x25]]);
    }

    #[test]
    fn the_reduced_calibration_projects_a_point_onto_its_pixel() {
        let calibration = Calibration {
            width: 1243,
            height: 375,
            focal_px: 700.0,
            cx_px: 601.0,
            cy_px: 170.5,
            baseline_m: 0.5,
            doffs_px: 0.0,
        };
        let small = reduced(&calibration);
        assert_eq!((small.width, small.height), (622, 188));
        let column = |of: &Calibration| of.focal_px * 3.0 / 20.0 + of.cx_px;
        assert_eq!(column(&small) * 2.0, column(&calibration));
        assert_eq!(small.cy_px * 2.0, 170.5);
    }

    #[test]
    fn values_that_are_not_maps_or_empty_have_no_picture() {
        assert_eq!(picture(&Depth { metres: Raster::new(0, 3) }.into()), None);
        assert_eq!(picture(&Value::Scores(std::sync::Arc::default())), None);
    }
}
