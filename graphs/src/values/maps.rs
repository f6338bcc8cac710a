//! Maps of depth and of disparity, whichever of their types a value is of.

use std::sync::Arc;

use depthloom_scores::DepthEstimate;
use image::ImageBuffer;

use super::{Depth, Disparity, FloatDisparity, Raster, RelativeDepth, Value};

const STEPS: f32 = 16.0;
/// The smallest `min_disparity_px` whose invalid value fits 16 bits.
const LEAST_PX: f32 = -2047.0;

impl Value {
    /// Disparities as a value: in fixed point where that is exact. The smallest disparity searched is the smallest
    /// whole number of pixels, at most 0, that covers all.
    ///
    /// # Panics
    /// Never: there are as many samples as before.
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

    /// The pixels of an estimated disparity, NaN = invalid; `None` for other values.
    ///
    /// # Panics
    /// Never: there are as many samples as before.
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

    /// Depth with the inverse depth it was computed from, 1/m: a plain depth if metres represent all of it.
    ///
    /// # Panics
    /// If the two have different sizes.
    pub fn depth_from_inverse(depth: Depth, inverse: &[f32]) -> Self {
        let (width, height) = depth.metres.dimensions();
        let hidden = depth.metres.iter().zip(inverse).map(|(&metres, &inverse)| {
            let is_held = inverse > 0.0 && metres == 1.0 / inverse;
            if is_held || !inverse.is_finite() { f32::NAN } else { inverse }
        });
        let hidden = ImageBuffer::from_raw(width, height, hidden.collect()).expect("both maps are of one size");
        Self::depth_with_hidden_inverse(depth, hidden)
    }

    /// Depth with the inverse depth that metres cannot represent.
    pub fn depth_with_hidden_inverse(depth: Depth, inverse: Raster<f32>) -> Self {
        if inverse.iter().all(|value| value.is_nan()) {
            return depth.into();
        }
        Self::RelativeDepth(Arc::new(RelativeDepth { depth: Arc::new(depth), inverse }))
    }

    /// A depth map as it is scored; `None` for other values.
    pub fn depth_estimate(&self) -> Option<DepthEstimate<'_>> {
        match self {
            Self::Depth(depth) => Some(depth.metres.as_raw().into()),
            Self::RelativeDepth(map) => {
                let (metres, inverse) = (map.depth.metres.as_raw().as_slice(), Some(map.inverse.as_raw().as_slice()));
                Some(DepthEstimate { inverse, ..metres.into() })
            }
            _ => None,
        }
    }

    /// The metres of a depth map; `None` for other values.
    pub fn metres(&self) -> Option<&Raster<f32>> {
        match self {
            Self::Depth(depth) => Some(&depth.metres),
            Self::RelativeDepth(map) => Some(&map.depth.metres),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Depth, Raster, Value};

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

    #[test]
    fn inverse_depth_is_stored_only_where_metres_lose_it() {
        let map = |values: &[f32]| Raster::from_raw(values.len() as u32, 1, values.to_vec()).unwrap();
        let inverse = [0.5, 0.0, -2.0, 0.001, f32::NAN];
        let depth = Depth { metres: map(&[2.0, 80.0, 80.0, 80.0, f32::NAN]) };
        let Value::RelativeDepth(both) = Value::depth_from_inverse(depth.clone(), &inverse) else { panic!("relative") };
        let stored: Vec<Option<f32>> = both.inverse().iter().map(|value| (!value.is_nan()).then_some(*value)).collect();
        assert_eq!(stored, [None, Some(0.0), Some(-2.0), Some(0.001), None]);
        let whole = Value::depth_from_inverse(Depth { metres: map(&[2.0, f32::NAN]) }, &[0.5, f32::NAN]);
        assert!(matches!(whole, Value::Depth(_)));
    }
}
