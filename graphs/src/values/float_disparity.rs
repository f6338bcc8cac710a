//! Disparity maps that are finer than OpenCV's fixed point.

use std::sync::Arc;

use image::ImageBuffer;

use super::{Disparity, Raster, Value};

/// Steps of the fixed point in a pixel.
const STEPS: f32 = 16.0;
/// The smallest `min_disparity_px` whose "nothing found" fits 16 bits.
const LEAST_PX: f32 = -2047.0;

/// A disparity map of the left image in floating point, with the fixed point nearest to it.
///
/// A map of whole sixteenths is a [`Disparity`]; [`Value::disparity_from_px`] chooses.
#[derive(Clone, Debug)]
pub struct FloatDisparity {
    px: Raster<f32>,
    fixed: Arc<Disparity>,
}

impl FloatDisparity {
    /// Pixels, row-major; NaN = nothing found.
    #[must_use]
    pub const fn px(&self) -> &Raster<f32> {
        &self.px
    }

    /// The map rounded to sixteenths of a pixel, for nodes that compute in fixed point; what 16 bits do not hold is invalid there.
    #[must_use]
    pub const fn fixed(&self) -> &Arc<Disparity> {
        &self.fixed
    }
}

impl PartialEq for FloatDisparity {
    /// Bit for bit, so that a map equals itself.
    fn eq(&self, other: &Self) -> bool {
        let bits = |map: &Raster<f32>| map.iter().map(|px| px.to_bits()).collect::<Vec<_>>();
        self.px.dimensions() == other.px.dimensions() && bits(&self.px) == bits(&other.px)
    }
}

impl Value {
    /// The value of disparities in floating point: fixed point where that holds each of them exactly. The smallest disparity searched is the smallest
    /// whole number of pixels, from 0 down, below which there is none.
    ///
    /// # Panics
    /// Never: there are as many samples as before.
    #[must_use]
    pub fn disparity_from_px(mut px: Raster<f32>) -> Self {
        px.iter_mut().filter(|px| !px.is_finite()).for_each(|px| *px = f32::NAN);
        // NaN is never the smaller one.
        let least = px.iter().fold(0.0_f32, |least, px| least.min(px.floor())).max(LEAST_PX);
        let min_disparity_px = least as i32;
        let invalid = ((min_disparity_px - 1) * STEPS as i32) as i16;
        let mut is_exact = true;
        let fixed = px.iter().map(|&px| {
            let steps = (px * STEPS).round_ties_even();
            let fits = steps > f32::from(invalid) && steps <= f32::from(i16::MAX);
            is_exact &= px.is_nan() || fits && steps / STEPS == px;
            if fits { steps as i16 } else { invalid }
        });
        let fixed = fixed.collect();
        let (width, height) = px.dimensions();
        let sixteenths_px = ImageBuffer::from_raw(width, height, fixed).expect("as many samples as before");
        let fixed = Arc::new(Disparity { sixteenths_px, min_disparity_px });
        if is_exact { Self::Disparity(fixed) } else { Self::FloatDisparity(Arc::new(FloatDisparity { px, fixed })) }
    }

    /// The pixels of a disparity map, NaN = nothing found; `None` if it is no estimated disparity.
    ///
    /// # Panics
    /// Never: there are as many samples as before.
    #[must_use]
    pub fn disparity_px(&self) -> Option<Raster<f32>> {
        match self {
            Self::FloatDisparity(map) => Some(map.px.clone()),
            Self::Disparity(map) => {
                let invalid = map.invalid();
                let px = |&fixed: &i16| if i32::from(fixed) == invalid { f32::NAN } else { f32::from(fixed) / STEPS };
                let (width, height) = map.sixteenths_px.dimensions();
                ImageBuffer::from_raw(width, height, map.sixteenths_px.iter().map(px).collect())
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Raster, Value};

    fn value(px: &[f32]) -> Value {
        Value::disparity_from_px(Raster::from_raw(px.len() as u32, 1, px.to_vec()).unwrap())
    }

    #[test]
    fn whole_sixteenths_are_fixed_point() {
        let Value::Disparity(map) = value(&[0.0, 1.0625, f32::NAN, 2047.9375, f32::INFINITY]) else { panic!("fixed") };
        assert_eq!(map.min_disparity_px, 0);
        assert_eq!(map.sixteenths_px.as_raw(), &[0, 17, -16, 32767, -16]);
        let Value::Disparity(map) = value(&[-3.5, f32::NAN]) else { panic!("fixed") };
        assert_eq!((map.min_disparity_px, map.sixteenths_px.as_raw().as_slice()), (-4, [-56, -80].as_slice()));
    }

    #[test]
    fn finer_disparities_keep_their_bits_and_have_the_nearest_sixteenths_beside_them() {
        let px = [10.03, f32::NAN, 5000.25, -0.4];
        let Value::FloatDisparity(map) = value(&px) else { panic!("float") };
        assert_eq!(map.fixed().sixteenths_px.as_raw(), &[160, -32, -32, -6]);
        let bits = |px: &[f32]| px.iter().map(|px| px.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(map.px()), bits(&px));
        let back = Value::FloatDisparity(map).disparity_px().unwrap();
        assert_eq!(bits(&back), bits(&px));
    }
}
