//! Depth of networks that give inverse depth up to scale and shift.

use std::sync::Arc;

use depthloom_scores::DepthEstimate;
use image::ImageBuffer;

use super::{Depth, Raster, Value};

/// A depth map made of inverse depth, some of which it does not hold: zero and below is nowhere in metres, and a cap hides what is beyond it.
///
/// An alignment with scale and shift takes inverse depth as it was; whatever else reads the map takes metres. [`Value::depth_from_inverse`] makes it.
#[derive(Clone, Debug)]
pub struct RelativeDepth {
    depth: Arc<Depth>,
    inverse: Raster<f32>,
}

impl RelativeDepth {
    /// Metres.
    #[must_use]
    pub const fn depth(&self) -> &Arc<Depth> {
        &self.depth
    }

    /// Inverse depth, 1/m, where it is not the inverse of the metres; NaN elsewhere.
    #[must_use]
    pub const fn inverse(&self) -> &Raster<f32> {
        &self.inverse
    }
}

impl PartialEq for RelativeDepth {
    /// Bit for bit, so that a map equals itself.
    fn eq(&self, other: &Self) -> bool {
        let bits = |map: &Raster<f32>| map.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        bits(&self.depth.metres) == bits(&other.depth.metres) && bits(&self.inverse) == bits(&other.inverse)
    }
}

impl Value {
    /// The value of a depth map with the inverse depth that it was made of, 1/m: a plain depth where the metres hold all of it.
    ///
    /// # Panics
    /// If the two are of different sizes.
    #[must_use]
    pub fn depth_from_inverse(depth: Depth, inverse: &[f32]) -> Self {
        let (width, height) = depth.metres.dimensions();
        let hidden = depth.metres.iter().zip(inverse).map(|(&metres, &inverse)| {
            let is_held = inverse > 0.0 && metres == 1.0 / inverse;
            if is_held || !inverse.is_finite() { f32::NAN } else { inverse }
        });
        let hidden = ImageBuffer::from_raw(width, height, hidden.collect()).expect("both maps are of one size");
        Self::depth_with_hidden_inverse(depth, hidden)
    }

    /// The value of a depth map and its inverse depth where the metres do not hold it.
    #[must_use]
    pub fn depth_with_hidden_inverse(depth: Depth, inverse: Raster<f32>) -> Self {
        if inverse.iter().all(|value| value.is_nan()) {
            return depth.into();
        }
        Self::RelativeDepth(Arc::new(RelativeDepth { depth: Arc::new(depth), inverse }))
    }

    /// A depth map as it is scored; `None` if it is no depth.
    #[must_use]
    pub fn depth_estimate(&self) -> Option<DepthEstimate<'_>> {
        match self {
            Self::Depth(depth) => Some(depth.metres.as_raw().into()),
            Self::RelativeDepth(map) => {
                Some(DepthEstimate { metres: map.depth.metres.as_raw(), inverse: Some(map.inverse.as_raw()) })
            }
            _ => None,
        }
    }

    /// The metres of a depth map; `None` if it is no depth.
    #[must_use]
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

    #[test]
    fn only_what_metres_do_not_hold_is_kept_beside_them() {
        let map = |values: &[f32]| Raster::from_raw(values.len() as u32, 1, values.to_vec()).unwrap();
        let inverse = [0.5, 0.0, -2.0, 0.001, f32::NAN];
        let depth = Depth { metres: map(&[2.0, 80.0, 80.0, 80.0, f32::NAN]) };
        let Value::RelativeDepth(both) = Value::depth_from_inverse(depth.clone(), &inverse) else { panic!("relative") };
        let kept: Vec<Option<f32>> = both.inverse().iter().map(|value| (!value.is_nan()).then_some(*value)).collect();
        assert_eq!(kept, [None, Some(0.0), Some(-2.0), Some(0.001), None]);
        let whole = Value::depth_from_inverse(Depth { metres: map(&[2.0, f32::NAN]) }, &[0.5, f32::NAN]);
        assert!(matches!(whole, Value::Depth(_)));
    }
}
