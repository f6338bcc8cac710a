//! The prior: how probable it is, before the monocular depth is compared, that stereo found the right surface.
//!
//! A way to a prior writes one number per pixel of a row, the odds against stereo. Probabilities of independent causes
//! multiply in [`Rules`]; a model that adds logits gives `exp(-logit)`.

use super::reliability::{KNOTS, Reliability, classes};
use super::{Frame, LANES};
use crate::simd::{Level, Pass};

/// A way to the prior.
#[derive(Clone, Debug, PartialEq)]
pub enum Prior {
    /// A product of factors that are parameters.
    Rules(Rules),
    /// What was learned of each class of evidence.
    Learned(Box<Reliability>),
}

/// How the evidence of stereo's matches is read.
#[derive(Clone, Debug)]
pub(super) struct Evidence {
    /// A match counts as unique if its ambiguity is at most this.
    pub unique_most: f32,
    pub support: Option<Support>,
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
    /// How trusted pixels in the neighbourhood change the prior; `None` ignores them.
    pub support: Option<Support>,
    /// A monocular depth is near if it is below this many times the depth of the largest disparity.
    pub near_factor: f32,
    /// Where monocular depth is near.
    pub near: f32,
    /// A match counts as unique if its ambiguity is at most this.
    pub unique_most: f32,
    /// The factor falls linearly from 1 at confidence 1 to this at confidence 0.
    pub unconfident: f32,
}

/// The share of trusted pixels in a square window: valid, consistent and unique. Where it is low, stereo guesses, and
/// some of its guesses agree by chance.
///
/// The factor of the prior rises linearly from `floor` to 1 while the share rises from `low` to `high`.
#[derive(Clone, Debug, PartialEq)]
pub struct Support {
    /// The window has `2 radius + 1` pixels on a side, fewer at the image's border.
    pub radius: usize,
    /// Share up to which the factor is `floor`.
    pub low: f32,
    /// Share from which the factor is 1; above `low`.
    pub high: f32,
    /// The smallest factor.
    pub floor: f32,
}

/// A disparity map, fixed point, 1/16 px, row-major.
#[derive(Clone, Copy, Debug)]
pub struct Disparities<'a> {
    /// The pixels.
    pub sixteenths: &'a [i16],
    /// The value of invalid pixels.
    pub invalid: i16,
}

impl Disparities<'_> {
    /// Whether the disparity of a pixel of the left image gives a depth. Those up to `least` do not.
    #[inline(always)]
    pub(super) fn is_valid(&self, disparity: i16, least: i16) -> bool {
        (disparity > least) & (disparity != self.invalid)
    }
}

/// What is known about stereo beside its disparity. Maps have the frame's size.
#[derive(Clone, Copy, Debug, Default)]
pub struct StereoEvidence<'a> {
    /// Disparity of the right image's pixels, negative, as `left_right::check` takes it.
    pub right: Option<Disparities<'a>>,
    /// A disparity of the left image that is valid only where the match is unique; one without a depth is not.
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
    /// The row of [`SupportFactors`]; empty without.
    pub support: &'a [f32],
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
        let Row { y, disparity, apart, .. } = row;
        Differences::write(frame, y, &disparity[..frame.width], apart);
        match self {
            Self::Rules(rules) => rules.odds_against(frame, y, row.mono, apart, row.support, against),
            Self::Learned(learned) => {
                let odds = learned.odds();
                classes(frame, y, row.mono, apart, row.support, &mut |x, class| against[x] = odds[class]);
            }
        }
    }

    pub(super) fn evidence(&self) -> Evidence {
        match self {
            Self::Rules(rules) => Evidence { unique_most: rules.unique_most, support: rules.support.clone() },
            Self::Learned(_) => Reliability::evidence(),
        }
    }

    /// The spread of monocular log depth at the knots of depth, if it was learned.
    pub(super) fn spread(&self) -> Option<&[f32; KNOTS]> {
        match self {
            Self::Rules(_) => None,
            Self::Learned(learned) => Some(&learned.spread),
        }
    }
}

impl Rules {
    #[inline(always)]
    fn odds_against(
        &self,
        frame: &Frame<'_>,
        y: usize,
        mono: &[f32],
        apart: &[i32],
        support: &[f32],
        against: &mut [f32],
    ) {
        let (width, evidence) = (frame.width, &frame.evidence);
        let at = y * width;
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
            let least = frame.geometry.least_sixteenths();
            for (prior, &other) in against.iter_mut().zip(&unique.sixteenths[at..][..width]) {
                *prior *= if unique.is_valid(other, least) { 1.0 } else { self.not_unique };
            }
        }
        if let Some(ambiguity) = evidence.ambiguity {
            for (prior, &ambiguity) in against.iter_mut().zip(&ambiguity[at..][..width]) {
                *prior *= if ambiguity > self.unique_most { self.not_unique } else { 1.0 };
            }
        }
        for (prior, factor) in against.iter_mut().zip(support) {
            *prior *= factor;
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

/// The factor of the prior that follows from the neighbourhood of each pixel, and the memory to compute it.
#[derive(Debug, Default)]
pub(super) struct SupportFactors {
    /// Row-major; empty without [`Support`].
    factors: Vec<f32>,
    /// 1 where stereo is trusted.
    trusted: Vec<u8>,
    /// Of each column, the number of trusted pixels in the rows of the window.
    columns: Vec<u16>,
    /// The number in the columns before one, from `radius` columns left of the image to as many right of it.
    before: Vec<u32>,
    apart: Vec<i32>,
}

impl SupportFactors {
    /// Computes the factors of a frame.
    pub(super) fn prepare(&mut self, level: Level, evidence: &Evidence, frame: &Frame<'_>) {
        self.factors.clear();
        if let Some(support) = &evidence.support {
            level.run(Factors { evidence, support, frame, into: self });
        }
    }

    /// The factors of row `y` of a frame that is `width` wide; empty without [`Support`].
    pub(super) fn row(&self, y: usize, width: usize) -> &[f32] {
        self.factors.get(y * width..(y + 1) * width).unwrap_or_default()
    }
}

struct Factors<'a> {
    evidence: &'a Evidence,
    support: &'a Support,
    frame: &'a Frame<'a>,
    into: &'a mut SupportFactors,
}

impl Pass for Factors<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { evidence, support, frame, into } = self;
        let SupportFactors { factors, trusted, columns, before, apart } = into;
        let (width, height) = (frame.width, frame.height);
        trusted.resize(width * height, 0);
        apart.resize(width, 0);
        for y in 0..height {
            evidence.trusted(frame, y, apart, &mut trusted[y * width..][..width]);
        }
        columns.clear();
        columns.resize(width, 0);
        factors.resize(width * height, 0.0);
        let rows = |rows: std::ops::Range<usize>| rows.start * width..rows.end * width;
        let mut window = 0..0;
        for y in 0..height {
            let next = y.saturating_sub(support.radius)..(y + support.radius + 1).min(height);
            for row in trusted[rows(window.end..next.end)].chunks_exact(width) {
                columns.iter_mut().zip(row).for_each(|(column, &trusted)| *column += u16::from(trusted));
            }
            for row in trusted[rows(window.start..next.start)].chunks_exact(width) {
                columns.iter_mut().zip(row).for_each(|(column, &trusted)| *column -= u16::from(trusted));
            }
            window = next;
            support.factors(columns, window.len(), before, &mut factors[rows(y..y + 1)]);
        }
    }
}

impl Support {
    /// The factors of a row, whose window has `rows` rows.
    #[inline(always)]
    fn factors(&self, columns: &[u16], rows: usize, before: &mut Vec<u32>, factors: &mut [f32]) {
        let (width, window) = (columns.len(), 2 * self.radius + 1);
        before.clear();
        before.resize(self.radius + 1, 0);
        let mut count = 0;
        before.extend(columns.iter().map(|&column| {
            count += u32::from(column);
            count
        }));
        before.resize(width + window, count);
        let scale = 1.0 / (self.high - self.low);
        let counts = before.iter().zip(&before[window..]).map(|(before, after)| (after - before) as f32);
        for ((x, factor), count) in (0_u32..).zip(factors).zip(counts) {
            let x = x as usize;
            let columns = (x + self.radius + 1).min(width) - x.saturating_sub(self.radius);
            let share = count / (rows * columns) as f32;
            *factor = ((share - self.low) * scale).clamp(self.floor, 1.0);
        }
    }
}

impl Evidence {
    /// Writes 1 where stereo is valid, both views agree and the match is unique, else 0.
    #[inline(always)]
    fn trusted(&self, frame: &Frame<'_>, y: usize, apart: &mut [i32], trusted: &mut [u8]) {
        let (width, evidence) = (frame.width, &frame.evidence);
        let at = y * width;
        let disparity = &frame.disparity.sixteenths[at..][..width];
        Differences::write(frame, y, disparity, apart);
        let least = frame.geometry.least_sixteenths();
        for ((trusted, apart), &disparity) in trusted.iter_mut().zip(apart).zip(disparity) {
            *trusted = u8::from(frame.disparity.is_valid(disparity, least) & (*apart <= CONSISTENT));
        }
        if let Some(unique) = evidence.unique {
            for (trusted, &other) in trusted.iter_mut().zip(&unique.sixteenths[at..][..width]) {
                *trusted &= u8::from(unique.is_valid(other, least));
            }
        }
        if let Some(ambiguity) = evidence.ambiguity {
            for (trusted, &ambiguity) in trusted.iter_mut().zip(&ambiguity[at..][..width]) {
                *trusted &= u8::from(ambiguity <= self.unique_most);
            }
        }
    }
}

/// How far both views are apart, 1/16 px.
pub(super) struct Differences;

impl Differences {
    /// Writes those of the pixels of row `y`; 0 without a right view.
    #[inline(always)]
    pub(super) fn write(frame: &Frame<'_>, y: usize, disparity: &[i16], apart: &mut [i32]) {
        match frame.evidence.right {
            Some(right) => {
                let row = &right.sixteenths[y * frame.width..][..frame.width];
                differences(disparity, row, right.invalid, apart);
            }
            None => apart.fill(0),
        }
    }

    /// 0 where they are consistent, 1 where they are close, else 2.
    #[inline(always)]
    pub(super) fn class(apart: i32) -> usize {
        usize::from(apart > CONSISTENT) + usize::from(apart > CLOSE)
    }
}

/// How far the right view's disparity at each pixel's partner is from the pixel's own, 1/16 px.
///
/// The partner is the nearest column to `x - d` (halves to even), in the image.
#[inline(always)]
fn differences(left: &[i16], right: &[i16], invalid: i16, apart: &mut [i32]) {
    let last = left.len() as i32 - 1;
    // Columns alone are computed in vectors.
    for ((x, &disparity), column) in (0..).zip(left).zip(&mut *apart) {
        let partner = 16 * x - i32::from(disparity);
        let half = i32::from(partner & 15 == 8);
        let nearest = (partner + 8) >> 4;
        *column = (nearest - (half & nearest)).clamp(0, last);
    }
    for (apart, &disparity) in apart.iter_mut().zip(left) {
        let other = right[*apart as usize];
        *apart = if other == invalid { FAR } else { (i32::from(other) + i32::from(disparity)).abs() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_follow_the_share_of_trusted_pixels_in_the_window() {
        // Windows of 3x3 pixels, fewer at the border, in an image of 4x2: column 3 is not trusted.
        let support = Support { radius: 1, low: 0.25, high: 0.75, floor: 0.1 };
        let (mut before, mut factors) = (Vec::new(), [0.0; 4]);
        support.factors(&[2, 2, 2, 0], 2, &mut before, &mut factors);
        let expected = [1.0, 1.0, (2.0 / 3.0 - 0.25) * 2.0, 0.5];
        for (factor, expected) in factors.iter().zip(expected) {
            assert!((factor - expected).abs() < 1e-6, "{factors:?}");
        }
        support.factors(&[0; 4], 2, &mut before, &mut factors);
        assert_eq!(factors, [0.1; 4]);
    }

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
