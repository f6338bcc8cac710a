//! The reliability of both estimates, learned from frames without ground truth.
//!
//! Every pixel belongs to a class of evidence about stereo, and to a monocular depth. A class has the prior that stereo
//! is an inlier, a depth has the spread `s_m` of monocular log depth. Both follow from how far stereo and monocular
//! depth are apart, by expectation maximisation: the posterior `q` of every pixel, then
//!
//! ```text
//! p(class)     = mean of q over the class
//! s_m(depth)^2 = mean of u^2 - s_s^2 over trusted pixels of that depth, weighted by q;  u = z_s - z_m
//!                At least half of the mean of u^2: trusted stereo is no worse than the monocular depth.
//! q            = p N(u; 0, s_m^2 + s_s^2) / (p N(u; 0, s_m^2 + s_s^2) + (1 - p) f(u; depth))
//! ```
//!
//! `f` is the density of outliers: a smoothed histogram of `u` over distrusted pixels of that depth. The priors of the
//! trusted and of the distrusted classes are given, so that both components are known from pixels of one kind. Trusted
//! pixels are consistent, unique, among trusted pixels, and far from the end of the range of disparities. Distrusted
//! pixels are inconsistent, and so are most around them.

use super::prior::{Differences, Evidence, SupportFactors};
use super::{Disparities, Frame, Support};
use crate::fusion::functions::ln;
use crate::simd::Level;

/// Classes of agreement of both views: at most 1 px apart, at most 3 px, farther.
pub const AGREEMENTS: usize = 3;
/// Shares of trusted pixels around a pixel at which a class of support begins, after the first.
pub const SUPPORTS: [f32; 3] = [0.3, 0.55, 0.8];
/// The disparity of monocular depth over the largest that stereo searched, at which a class of nearness begins, after
/// the first.
pub const NEARNESSES: [f32; 6] = [0.25, 0.4, 0.55, 0.7, 0.85, 1.0];
/// Number of classes of evidence.
pub const CLASSES: usize = AGREEMENTS * 2 * (SUPPORTS.len() + 1) * (NEARNESSES.len() + 1);
/// The depths that have a spread: quarters between powers of two, from 0.5 m to 128 m.
pub const KNOTS: usize = 33;

/// A match counts as unique if its ambiguity is at most this.
const UNIQUE_MOST: f32 = 0.9;
/// The window of [`SUPPORTS`], whose factor is the share of trusted pixels.
const SHARE: Support = Support { radius: 10, low: 0.0, high: 1.0, floor: 0.0 };
/// Prior of the trusted classes.
const TRUSTED: f64 = 0.99;
/// Prior of the distrusted classes.
const DISTRUSTED: f64 = 0.05;
/// Histograms of outliers are means over this many steps on both sides.
const BLUR: usize = 8;
/// Classes of nearness below this may be trusted.
const FAR_ENOUGH: usize = 3;
/// Differences `u` are counted in steps of `1 / STEPS` up to `MOST` on both sides; the outermost count all beyond.
const STEPS: usize = 64;
const MOST: usize = 3;
const APART: usize = 2 * MOST * STEPS;
/// Pixels with which the prior of a class, and the outliers of a depth, count as much as the mean of all.
const REGULAR: f64 = 100.0;
/// Pixels with which the spread of a depth counts as much as the mean: many, because neighbours have similar errors.
const REGULAR_SPREAD: f64 = 10_000.0;
/// Smallest and largest spread, and its first value.
const LEAST_SPREAD: f64 = 0.02;
const MOST_SPREAD: f64 = 2.0;
const FIRST_SPREAD: f64 = 0.4;
const ITERATIONS: usize = 40;

/// What a frame shows: classes and spreads.
#[derive(Clone, Debug, PartialEq)]
pub struct Reliability {
    /// Prior probability that stereo is an inlier, by [class](class).
    pub inlier: [f32; CLASSES],
    /// Standard deviation of monocular log depth at [`knot`]s; between them it is linear in depth.
    pub spread: [f32; KNOTS],
}

/// The index of a class in [`Reliability::inlier`].
#[must_use]
pub const fn class(agreement: usize, unique: bool, support: usize, nearness: usize) -> usize {
    ((agreement * 2 + unique as usize) * (SUPPORTS.len() + 1) + support) * (NEARNESSES.len() + 1) + nearness
}

/// Whether the prior of a class is given, not learned.
const fn is_trusted(index: usize) -> bool {
    let (rest, nearness) = (index / (NEARNESSES.len() + 1), index % (NEARNESSES.len() + 1));
    rest == SUPPORTS.len() + 1 + SUPPORTS.len() && nearness < FAR_ENOUGH
}

/// Whether a class has outliers only, nearly: the views disagree, and so do most pixels around.
const fn is_distrusted(index: usize) -> bool {
    let rest = index / (NEARNESSES.len() + 1);
    let (support, agreement) = (rest % (SUPPORTS.len() + 1), rest / (SUPPORTS.len() + 1) / 2);
    support == 0 && agreement == AGREEMENTS - 1
}

/// Bits of an `f32` below two digits of its mantissa.
const REST: u32 = 21;
const FIRST_KNOT: u32 = 0.5_f32.to_bits() >> REST;

/// The depth of a knot, metres.
#[must_use]
pub fn knot(index: usize) -> f32 {
    f32::from_bits((FIRST_KNOT + index as u32) << REST)
}

/// The knot at or before a depth, and the place between it and the next, from 0 to 1.
#[inline(always)]
fn place(metres: f32) -> (usize, f32) {
    // Comparisons with NaN are false.
    let metres = if metres > 0.5 { metres } else { 0.5 };
    let bits = if metres < 128.0 { metres.to_bits() } else { 128.0_f32.to_bits() - 1 };
    let rest = bits & ((1 << REST) - 1);
    ((bits >> REST) as usize - FIRST_KNOT as usize, rest as f32 / (1_u32 << REST) as f32)
}

/// The spread at a depth.
#[inline(always)]
pub(super) fn spread_at(spread: &[f32; KNOTS], metres: f32) -> f32 {
    let (index, place) = place(metres);
    // The last interval ends at the last knot.
    let index = index.min(KNOTS - 2);
    spread[index] + place * (spread[index + 1] - spread[index])
}

impl Reliability {
    /// The window over which the share of trusted pixels is taken.
    pub(super) const fn evidence() -> Evidence {
        Evidence { unique_most: UNIQUE_MOST, support: Some(SHARE) }
    }

    /// `(1 - p) / p` of every class.
    pub(super) fn odds(&self) -> [f32; CLASSES] {
        self.inlier.map(|inlier| (1.0 - inlier) / inlier)
    }
}

/// Classes of the pixels of row `y`.
#[inline(always)]
pub(super) fn classes(
    frame: &Frame<'_>,
    y: usize,
    mono: &[f32],
    apart: &[i32],
    support: &[f32],
    each: &mut impl FnMut(usize, usize),
) {
    let (width, at) = (frame.width, y * frame.width);
    let nearest = frame.nearest_metres();
    let least = frame.geometry.least_sixteenths();
    for x in 0..width {
        let agreement = Differences::class(apart[x]);
        let unique = frame.evidence.unique.is_none_or(|map| map.is_valid(map.sixteenths[at + x], least));
        let clear = frame.evidence.ambiguity.is_none_or(|map| map[at + x] <= UNIQUE_MOST);
        let support = SUPPORTS.iter().map(|&share| usize::from(support[x] >= share)).sum();
        let nearness = NEARNESSES.iter().map(|&share| usize::from(nearest >= share * mono[x])).sum();
        each(x, class(agreement, unique & clear, support, nearness));
    }
}

/// What was counted of frames.
#[derive(Debug)]
pub struct Statistics {
    /// Pixels by class, nearest knot and difference.
    counts: Vec<u64>,
    frames: u64,
    metre_pixels: f64,
    support: SupportFactors,
    apart: Vec<i32>,
}

impl Default for Statistics {
    fn default() -> Self {
        let (support, apart) = (SupportFactors::default(), Vec::new());
        Self { counts: vec![0; CLASSES * KNOTS * APART], frames: 0, metre_pixels: 0.0, support, apart }
    }
}

impl Statistics {
    /// Counts the pixels of a frame whose depth is valid and below `cap`, metres, in both estimates. Two depths at the
    /// cap agree exactly, which says nothing of the spread.
    ///
    /// # Panics
    /// If a map has another size than the frame.
    pub fn add(&mut self, frame: &Frame<'_>, cap: f32) {
        frame.check_sizes();
        let Frame { width, height, disparity: Disparities { sixteenths, .. }, geometry, mono, .. } = *frame;
        let (metre_pixels, doffs) = (geometry.metre_pixels(), geometry.doffs_px as f32);
        self.frames += 1;
        self.metre_pixels += f64::from(metre_pixels);
        self.support.prepare(Level::best(), &Reliability::evidence(), frame);
        self.apart.resize(width, 0);
        let least = geometry.least_sixteenths();
        for y in 0..height {
            let (disparity, mono) = (&sixteenths[y * width..][..width], &mono[y * width..][..width]);
            Differences::write(frame, y, disparity, &mut self.apart);
            let counts = &mut self.counts;
            classes(frame, y, mono, &self.apart, self.support.row(y, width), &mut |x, class| {
                let metres = mono[x];
                let stereo = metre_pixels / (f32::from(disparity[x]) / 16.0 + doffs);
                let counts_here = frame.disparity.is_valid(disparity[x], least) && metres > 0.0;
                if counts_here && metres < cap && stereo < cap {
                    let apart = ln(stereo / metres) * STEPS as f32;
                    let bin = (apart + (APART / 2) as f32).clamp(0.0, (APART - 1) as f32) as usize;
                    let (index, place) = place(metres);
                    let nearest = index + usize::from(place >= 0.5);
                    counts[(class * KNOTS + nearest) * APART + bin] += 1;
                }
            });
        }
    }

    /// Number of frames.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.frames
    }

    /// Number of pixels of trusted classes.
    #[must_use]
    pub fn trusted(&self) -> u64 {
        let classes = self.counts.chunks_exact(KNOTS * APART).enumerate();
        classes.filter(|(class, _)| is_trusted(*class)).flat_map(|(_, counts)| counts).sum()
    }

    /// The reliability that explains the frames best, with the mixture's `stereo_noise` (px). `None` without a pixel
    /// of a trusted class.
    #[must_use]
    pub fn reliability(&self, stereo_noise: f64) -> Option<Reliability> {
        if self.trusted() == 0 {
            return None;
        }
        let cells = self.cells(stereo_noise, &self.outliers());
        let (mut inlier, mut spread) = ([0.5; CLASSES], [FIRST_SPREAD; KNOTS]);
        (0..CLASSES).filter(|class| is_trusted(*class)).for_each(|class| inlier[class] = TRUSTED);
        (0..CLASSES).filter(|class| is_distrusted(*class)).for_each(|class| inlier[class] = DISTRUSTED);
        for _ in 0..ITERATIONS {
            let (mut inliers, mut pixels) = ([0.0; CLASSES], [0.0; CLASSES]);
            let (mut squares, mut both, mut weights) = ([0.0; KNOTS], [0.0; KNOTS], [0.0; KNOTS]);
            for cell in &cells {
                let q = cell.posterior(inlier[cell.class], spread[cell.knot]);
                inliers[cell.class] += cell.count * q;
                pixels[cell.class] += cell.count;
                if is_trusted(cell.class) {
                    weights[cell.knot] += cell.count * q;
                    squares[cell.knot] += cell.count * q * (cell.apart * cell.apart - cell.variance);
                    both[cell.knot] += cell.count * q * cell.apart * cell.apart;
                }
            }
            // Where `stereo_noise` explains all of the difference, it is too large for these images.
            let sum = |of: &[f64; KNOTS]| of.iter().sum::<f64>();
            let mean = sum(&squares).max(0.5 * sum(&both)) / sum(&weights);
            for (at, spread) in spread.iter_mut().enumerate() {
                let square = squares[at].max(0.5 * both[at]);
                let variance = (square + REGULAR_SPREAD * mean) / (weights[at] + REGULAR_SPREAD);
                *spread = variance.sqrt().clamp(LEAST_SPREAD, MOST_SPREAD);
            }
            for class in (0..CLASSES).filter(|class| !is_trusted(*class) && !is_distrusted(*class)) {
                let near = |of: &[f64; CLASSES]| -> f64 {
                    (class % (NEARNESSES.len() + 1)..CLASSES).step_by(NEARNESSES.len() + 1).map(|at| of[at]).sum()
                };
                let mean = (near(&inliers) + 0.5) / (near(&pixels) + 1.0);
                inlier[class] = (inliers[class] + REGULAR * mean) / (pixels[class] + REGULAR);
            }
        }
        let inlier = inlier.map(|inlier: f64| inlier.clamp(1e-4, TRUSTED) as f32);
        Some(Reliability { inlier, spread: spread.map(|spread| spread as f32) })
    }

    /// The density of the differences of outliers at each knot, from pixels of distrusted classes.
    fn outliers(&self) -> Vec<f64> {
        let mut counts = vec![0.0; KNOTS * APART];
        for (_, class) in self.counts.chunks_exact(KNOTS * APART).enumerate().filter(|(class, _)| is_distrusted(*class))
        {
            counts.iter_mut().zip(class).for_each(|(sum, &count)| *sum += count as f64);
        }
        let mut all = vec![1.0; APART];
        counts.chunks_exact(APART).for_each(|knot| all.iter_mut().zip(knot).for_each(|(all, count)| *all += count));
        let total: f64 = all.iter().sum();
        let mut densities = Vec::with_capacity(counts.len());
        for knot in counts.chunks_exact(APART) {
            let pixels: f64 = knot.iter().sum();
            let mean = all.iter().map(|all| REGULAR * all / total);
            let shares: Vec<f64> =
                knot.iter().zip(mean).map(|(count, mean)| (count + mean) / (pixels + REGULAR)).collect();
            densities.extend((0..APART).map(|bin| {
                let window = bin.saturating_sub(BLUR)..(bin + BLUR + 1).min(APART);
                let width = window.len() as f64 / STEPS as f64;
                shares[window].iter().sum::<f64>() / width
            }));
        }
        densities
    }

    fn cells(&self, stereo_noise: f64, outliers: &[f64]) -> Vec<Cell> {
        let metre_pixels = self.metre_pixels / self.frames as f64;
        let counted = self.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        let cell = |(at, &count): (usize, &u64)| {
            let (class, knot_index, bin) = (at / (KNOTS * APART), at / APART % KNOTS, at % APART);
            let apart = (bin as f64 + 0.5) / STEPS as f64 - MOST as f64;
            let deviation = (stereo_noise * f64::from(knot(knot_index)) * libm::exp(apart) / metre_pixels).max(1e-3);
            let outlier = outliers[knot_index * APART + bin];
            Cell { class, knot: knot_index, apart, variance: deviation * deviation, outlier, count: count as f64 }
        };
        counted.map(cell).collect()
    }
}

/// Pixels of one class, depth and difference.
struct Cell {
    class: usize,
    knot: usize,
    /// `z_s - z_m`.
    apart: f64,
    /// `s_s^2`.
    variance: f64,
    /// The density of outliers.
    outlier: f64,
    count: f64,
}

impl Cell {
    fn posterior(&self, prior: f64, spread: f64) -> f64 {
        let variance = self.variance + spread * spread;
        let density = libm::exp(-0.5 * self.apart * self.apart / variance) / (std::f64::consts::TAU * variance).sqrt();
        let inlier = prior * density;
        inlier / (inlier + (1.0 - prior) * self.outlier)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knots_are_quarters_between_powers_of_two() {
        assert_eq!([0, 1, 4, 32].map(knot), [0.5, 0.625, 1.0, 128.0]);
        let spread: [f32; KNOTS] = std::array::from_fn(|index| knot(index) * 0.1);
        for metres in [0.5, 0.7, 3.1, 79.0, 127.9] {
            assert!((spread_at(&spread, metres) - 0.1 * metres).abs() < 1e-5 * metres, "{metres}");
        }
        assert_eq!([0.0, f32::NAN, 0.2].map(|metres| spread_at(&spread, metres)), [spread[0]; 3]);
        assert!((spread_at(&spread, f32::INFINITY) - spread[KNOTS - 1]).abs() < 1e-5);
    }

    #[test]
    fn the_prior_is_the_share_of_a_class_that_is_as_far_apart_as_trusted_pixels() {
        // Trusted pixels are within 0.2 of mono, distrusted ones 0.8 farther. Of another class, three of ten pixels are
        // inliers and seven are outliers.
        let mut statistics = Statistics { frames: 1, metre_pixels: 4000.0, ..Statistics::default() };
        let mut add = |class: usize, apart: f64, pixels: f64| {
            for bin in 0..APART {
                let u = ((bin as f64 + 0.5) / STEPS as f64 - MOST as f64 - apart) / 0.2;
                let count = pixels * libm::exp(-0.5 * u * u) / (std::f64::consts::TAU.sqrt() * 0.2 * STEPS as f64);
                statistics.counts[(class * KNOTS + 16) * APART + bin] += count as u64;
            }
        };
        let unknown = class(0, false, 1, 0);
        add(class(0, true, 3, 0), 0.0, 1e6);
        add(class(2, false, 0, 0), 0.8, 1e5);
        add(unknown, 0.0, 3e4);
        add(unknown, 0.8, 7e4);
        let reliability = statistics.reliability(1.0).expect("trusted pixels");
        assert!((reliability.spread[16] - 0.2).abs() < 0.02, "{}", reliability.spread[16]);
        assert!((reliability.inlier[unknown] - 0.3).abs() < 0.03, "{}", reliability.inlier[unknown]);
        assert_eq!(reliability.inlier[class(2, false, 0, 0)], DISTRUSTED as f32);
    }

    #[test]
    fn the_monocular_error_is_at_least_half_of_what_trusted_pixels_are_apart() {
        // 0.1 apart everywhere, while 1 px of noise would be 0.2 in log depth at 8 m.
        let mut statistics = Statistics { frames: 1, metre_pixels: 40.0, ..Statistics::default() };
        let bin = (MOST * STEPS) as f64 + 0.1 * STEPS as f64;
        statistics.counts[(class(0, true, 3, 0) * KNOTS + 16) * APART + bin as usize] = 1_000_000;
        let spread = statistics.reliability(1.0).expect("trusted pixels").spread[16];
        assert!((0.06..0.08).contains(&spread), "{spread}");
    }

    #[test]
    fn trusted_classes_are_consistent_unique_supported_and_far() {
        let trusted: Vec<usize> = (0..CLASSES).filter(|at| is_trusted(*at)).collect();
        assert_eq!(trusted, [0, 1, 2].map(|nearness| class(0, true, 3, nearness)));
        assert_eq!(class(AGREEMENTS - 1, true, SUPPORTS.len(), NEARNESSES.len()), CLASSES - 1);
    }
}
