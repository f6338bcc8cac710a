//! An estimate as it is scored: aligned, and clamped.

use crate::{DepthEstimate, Settings};

/// An estimate that is aligned and clamped, by pixel.
pub(crate) trait Aligned: Copy {
    /// What is read of a pixel; NaN or infinite where the estimate is missing.
    fn before(self, at: usize) -> f64;

    /// What is scored of it, metres; NaN where the estimate is missing. Without branches, for loops in vectors.
    fn scored(self, before: f64) -> f64;

    fn at(self, at: usize) -> f64 {
        self.scored(self.before(at))
    }
}

/// `f64::clamp` without its check of the bounds, which would keep a loop from vectors.
#[inline(always)]
fn clamped(value: f64, min: f64, max: f64) -> f64 {
    let value = if value < min { min } else { value };
    if value > max { max } else { value }
}

/// An estimate that is multiplied.
#[derive(Clone, Copy)]
pub(crate) struct Scaled<'a> {
    metres: &'a [f32],
    factor: f64,
    min_m: f64,
    max_m: f64,
}

impl<'a> Scaled<'a> {
    pub(crate) fn new(estimate: DepthEstimate<'a>, factor: f64, settings: &Settings) -> Self {
        Self { metres: estimate.metres, factor, min_m: settings.min_m, max_m: settings.max_m }
    }
}

impl Aligned for Scaled<'_> {
    #[inline(always)]
    fn before(self, at: usize) -> f64 {
        f64::from(self.metres[at])
    }

    #[inline(always)]
    fn scored(self, before: f64) -> f64 {
        let scored = clamped(before * self.factor, self.min_m, self.max_m);
        if before.is_finite() { scored } else { f64::NAN }
    }
}

/// An estimate of which the inverse is scaled and shifted; what is then at infinity or behind it is farthest.
#[derive(Clone, Copy)]
pub(crate) struct ScaledAndShifted<'a> {
    estimate: DepthEstimate<'a>,
    scale: f64,
    shift: f64,
    min_m: f64,
    max_m: f64,
}

impl<'a> ScaledAndShifted<'a> {
    pub(crate) fn new(estimate: DepthEstimate<'a>, scale: f64, shift: f64, settings: &Settings) -> Self {
        Self { estimate, scale, shift, min_m: settings.min_m, max_m: settings.max_m }
    }
}

impl Aligned for ScaledAndShifted<'_> {
    #[inline(always)]
    fn before(self, at: usize) -> f64 {
        self.estimate.inverse(at, self.min_m)
    }

    #[inline(always)]
    fn scored(self, before: f64) -> f64 {
        let inverse = self.scale * before + self.shift;
        let scored = if inverse > 0.0 { clamped(1.0 / inverse, self.min_m, self.max_m) } else { self.max_m };
        if inverse.is_nan() { f64::NAN } else { scored }
    }
}
