//! The median of two or three depths, pixel by pixel.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::raster::check_same;

/// The median of two depths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum OfTwo {
    /// Their geometric mean, the mean of their logarithms: the error of depth grows with depth.
    #[default]
    Geometric,
    /// Their arithmetic mean, the median of NumPy.
    Arithmetic,
}

/// The median of the valid (finite) depths of each pixel, metres; NaN where none is valid.
pub fn fuse(first: &[f32], second: &[f32], third: Option<&[f32]>, of_two: OfTwo, out: &mut [f32]) {
    check_same("second depth", second.len(), first.len());
    check_same("fused depth", out.len(), first.len());
    if let Some(third) = third {
        check_same("third depth", third.len(), first.len());
    }
    for (at, out) in out.iter_mut().enumerate() {
        *out = median(first[at], second[at], third.map_or(f32::NAN, |third| third[at]), of_two);
    }
}

fn median(a: f32, b: f32, c: f32, of_two: OfTwo) -> f32 {
    match (a.is_finite(), b.is_finite(), c.is_finite()) {
        (true, true, true) => a.max(b).min(a.min(b).max(c)),
        (true, true, false) => between(a, b, of_two),
        (true, false, true) => between(a, c, of_two),
        (false, true, true) => between(b, c, of_two),
        (true, false, false) => a,
        (false, true, false) => b,
        (false, false, true) => c,
        (false, false, false) => f32::NAN,
    }
}

fn between(a: f32, b: f32, of_two: OfTwo) -> f32 {
    let (a, b) = (f64::from(a), f64::from(b));
    match of_two {
        OfTwo::Geometric => (a * b).sqrt() as f32,
        OfTwo::Arithmetic => f64::midpoint(a, b) as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_the_mean_and_of_three_the_middle() {
        const NAN: f32 = f32::NAN;
        let mut out = [0.0; 4];
        fuse(&[4.0, NAN, 4.0, NAN], &[9.0, 9.0, f32::INFINITY, NAN], None, OfTwo::Geometric, &mut out);
        assert_eq!(out[..3], [6.0, 9.0, 4.0]);
        assert!(out[3].is_nan());
        fuse(&[4.0], &[9.0], None, OfTwo::Arithmetic, &mut out[..1]);
        assert_eq!(out[0], 6.5);
        let geometric = |a, b, c| median(a, b, c, OfTwo::Geometric);
        for [a, b, c] in
            [[1.0, 2.0, 5.0], [1.0, 5.0, 2.0], [2.0, 1.0, 5.0], [2.0, 5.0, 1.0], [5.0, 1.0, 2.0], [5.0, 2.0, 1.0]]
        {
            assert_eq!(geometric(a, b, c), 2.0);
        }
        assert_eq!((geometric(NAN, 4.0, 9.0), geometric(4.0, NAN, 9.0), geometric(NAN, NAN, 3.0)), (6.0, 6.0, 3.0));
    }
}
