//! The prior: how probable it is, before the monocular depth is compared, that stereo found the right surface.
//!
//! A way to a prior writes one number per pixel of a row, the odds against stereo. Probabilities of independent causes
//! multiply in [`Rules`]; a model that adds logits gives `exp(-logit)`.

use super::{Frame, LANES};

/// A way to the prior.
#[derive(Clone, Debug, PartialEq)]
pub enum Prior {
    /// A product of factors that are parameters.
    Rules(Rules),
}

/// The factors of the prior. Each is in [0, 1], except `near_factor`.
#[derive(Clone, Debug, PartialEq)]
pub struct Rules {
    /// Where the two views differ by at most 1 px, and where there is no right view.
    pub consistent: f32,
    /// Where they differ by more than 1 px and at most 3 px.
    pub close: f32,
    /// Where they differ by more, or where the right view is invalid.
    pub inconsistent: f32,
    /// At every pixel.
    pub keep: f32,
    /// Where the match is not unique.
    pub not_unique: f32,
    /// A monocular depth is near if it is below this many times the depth of the largest disparity.
    pub near_factor: f32,
    /// Where monocular depth is near.
    pub near: f32,
    /// The factor falls linearly from 1 at ambiguity 0 to this at ambiguity 1.
    pub ambiguous: f32,
    /// The factor falls linearly from 1 at confidence 1 to this at confidence 0.
    pub unconfident: f32,
}

/// A disparity map, fixed point, 1/16 px, row-major.
#[derive(Clone, Copy, Debug)]
pub struct Disparities<'a> {
    /// The pixels.
    pub sixteenths: &'a [i16],
    /// The value of invalid pixels.
    pub invalid: i16,
}

/// What is known about stereo beside its disparity. Maps have the frame's size.
#[derive(Clone, Copy, Debug, Default)]
pub struct StereoEvidence<'a> {
    /// Disparity of the right image's pixels, negative, as `left_right::check` takes it.
    pub right: Option<Disparities<'a>>,
    /// A disparity of the left image that is valid only where the match is unique.
    pub unique: Option<Disparities<'a>>,
    /// The lowest cost as a share of the lowest cost of another disparity, in [0, 1].
    pub ambiguity: Option<&'a [f32]>,
    /// Confidence from edges, `W_c`, in [0, 1].
    pub confidence: Option<&'a [f32]>,
}

/// What a prior knows of one row. `disparity` and `mono` may be longer than the image's width.
pub(super) struct Row<'a> {
    pub y: usize,
    pub disparity: &'a [i16],
    pub mono: &'a [f32],
    /// Room for as many samples.
    pub apart: &'a mut [i32],
}

/// Differences that count as consistent and as close, 1/16 px.
const CONSISTENT: i32 = 16;
const CLOSE: i32 = 48;
/// The difference from an invalid pixel.
const FAR: i32 = i32::MAX;

impl Prior {
    /// Writes `(1 - p) / p` of the pixels of a row, of which there are as many as `against` has.
    #[inline(always)]
    pub(super) fn odds_against(&self, frame: &Frame<'_>, row: Row<'_>, against: &mut [f32]) {
        match self {
            Self::Rules(rules) => rules.odds_against(frame, row, against),
        }
    }
}

impl Rules {
    #[inline(always)]
    fn odds_against(&self, frame: &Frame<'_>, row: Row<'_>, against: &mut [f32]) {
        let Row { y, disparity, mono, apart } = row;
        let (width, evidence) = (frame.width, &frame.evidence);
        let at = y * width;
        match evidence.right {
            Some(right) => differences(&disparity[..width], &right.sixteenths[at..][..width], right.invalid, apart),
            None => apart.fill(0),
        }
        let near_depth = self.near_factor * frame.nearest_metres();
        let blocks = against.as_chunks_mut::<LANES>().0.iter_mut();
        let inputs = apart.as_chunks::<LANES>().0.iter().zip(mono.as_chunks::<LANES>().0);
        for (against, (apart, mono)) in blocks.zip(inputs) {
            for i in 0..LANES {
                let far = if apart[i] <= CLOSE { self.close } else { self.inconsistent };
                let agreement = if apart[i] <= CONSISTENT { self.consistent } else { far };
                let near = if mono[i] < near_depth { self.near } else { 1.0 };
                against[i] = self.keep * agreement * near;
            }
        }
        if let Some(unique) = evidence.unique {
            let unique = unique.sixteenths[at..][..width].iter().map(|&d| d == unique.invalid);
            for (prior, doubtful) in against.iter_mut().zip(unique) {
                *prior *= if doubtful { self.not_unique } else { 1.0 };
            }
        }
        if let Some(ambiguity) = evidence.ambiguity {
            for (prior, ambiguity) in against.iter_mut().zip(&ambiguity[at..][..width]) {
                *prior *= 1.0 - (1.0 - self.ambiguous) * ambiguity;
            }
        }
        if let Some(confidence) = evidence.confidence {
            for (prior, confidence) in against.iter_mut().zip(&confidence[at..][..width]) {
                *prior *= self.unconfident + (1.0 - self.unconfident) * confidence;
            }
        }
        for block in against.as_chunks_mut::<LANES>().0 {
            for prior in block {
                *prior = (1.0 - *prior) / *prior;
            }
        }
    }
}

/// How far the right view's disparity at each pixel's partner is from the pixel's own, 1/16 px.
///
/// The partner is the nearest column to `x - d` (halves to even), in the image.
#[inline(always)]
fn differences(left: &[i16], right: &[i16], invalid: i16, apart: &mut [i32]) {
    let last = left.len() as i32 - 1;
    for ((x, &disparity), apart) in (0..).zip(left).zip(apart) {
        let disparity = i32::from(disparity);
        let partner = 16 * x - disparity;
        let half = i32::from(partner & 15 == 8);
        let column = (partner + 8) >> 4;
        let column = (column - (half & column)).clamp(0, last);
        let other = right[column as usize];
        *apart = if other == invalid { FAR } else { (i32::from(other) + disparity).abs() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_partner_is_the_nearest_column_with_halves_to_even() {
        // Columns 3 of disparity 0.5, 1.5, 2.5, 9 px: partners 2 (of 2.5), 2 (of 1.5), 0 (of 0.5), 0 (outside).
        let right = [-1000, -100, -200, -300];
        for (disparity, expected) in [(8, 192), (24, 176), (40, FAR), (144, FAR)] {
            let mut apart = [0; 4];
            differences(&[0, 0, 0, disparity], &right, -1000, &mut apart);
            assert_eq!(apart[3], expected, "{disparity}");
        }
    }
}
