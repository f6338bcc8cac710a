//! Which pixels of a frame are scored.

use depthloom_simd::{Level, Pass};

use crate::aligned::{Aligned, Scaled, ScaledAndShifted};
use crate::crop::Window;
use crate::quantile::median;
use crate::{Align, Line, Settings, UncertainPixel, Uncertainty, UncertaintyKind};

/// Pixels that are worked on at a time.
pub(crate) const CHUNK: usize = 256;

/// The pixels of a frame whose truth is scored: found once, used for every estimate of the frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScoredPixels {
    /// Row-major positions.
    at: Vec<u32>,
    /// The truth there, metres.
    ground_truth_m: Vec<f32>,
    /// How many pixels the image has.
    of: usize,
}

impl ScoredPixels {
    /// The pixels of a truth (row-major metres; NaN: nothing measured) that the settings score.
    ///
    /// # Panics
    /// If the truth has not `width * height` pixels, or more than 2^32.
    #[must_use]
    pub fn new(ground_truth_m: &[f32], width: usize, height: usize, settings: &Settings) -> Self {
        assert_eq!(ground_truth_m.len(), width * height, "the truth has as many pixels as the image");
        assert!(u32::try_from(ground_truth_m.len()).is_ok(), "an image has fewer than 2^32 pixels");
        let window = settings.crop.window(width, height);
        // Bounds as the maps hold them: a truth of exactly 1e-3 m in f32 is not above 1e-3.
        let (min_m, max_m) = (settings.min_m as f32, settings.max_m as f32);
        let (at, truths) = Level::best().run(Search { ground_truth_m, width, window, min_m, max_m });
        Self { at, ground_truth_m: truths, of: ground_truth_m.len() }
    }

    /// How many pixels are scored.
    #[must_use]
    pub fn len(&self) -> usize {
        self.at.len()
    }

    /// Whether no pixel is scored.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.at.is_empty()
    }

    /// Where the scored pixels are: row-major positions in the image, ascending.
    #[must_use]
    pub fn positions(&self) -> &[u32] {
        &self.at
    }

    /// The truth at the scored pixels, metres, in the same order.
    #[must_use]
    pub fn ground_truth_m(&self) -> &[f32] {
        &self.ground_truth_m
    }

    /// Those of them that are `kept(position, truth)`, in the same order.
    #[must_use]
    pub(crate) fn part(&self, kept: impl Fn(usize, f64) -> bool) -> Self {
        let both = self.at.iter().zip(&self.ground_truth_m);
        let (at, ground_truth_m) = both.filter(|&(&at, &t)| kept(at as usize, f64::from(t))).unzip();
        Self { at, ground_truth_m, of: self.of }
    }

    /// Calls `valid(t, y)` for every scored pixel with an estimate, in order: the truth, and the estimate as it is
    /// scored (aligned, clamped), both in metres; and `missing(t)` for every one without.
    ///
    /// # Panics
    /// If the estimate is of another size than the truth.
    pub(crate) fn visit(
        &self,
        estimate: DepthEstimate<'_>,
        alignment: Alignment,
        settings: &Settings,
        valid: impl FnMut(f64, f64),
        missing: impl FnMut(f64),
    ) {
        self.each_chunk(estimate, alignment, settings, &mut Visit { valid, missing });
    }

    /// Hands on all scored pixels, chunk by chunk.
    ///
    /// # Panics
    /// If the estimate is of another size than the truth.
    pub(crate) fn each_chunk(
        &self,
        estimate: DepthEstimate<'_>,
        alignment: Alignment,
        settings: &Settings,
        each: &mut impl EachChunk,
    ) {
        self.each_chunk_at(Level::best(), estimate, alignment, settings, each);
    }

    pub(crate) fn each_chunk_at(
        &self,
        level: Level,
        estimate: DepthEstimate<'_>,
        alignment: Alignment,
        settings: &Settings,
        each: &mut impl EachChunk,
    ) {
        assert_eq!(estimate.metres.len(), self.of, "the estimate has as many pixels as the truth");
        match alignment {
            Alignment::Factor(factor) => {
                level.run(Chunks { pixels: self, aligned: Scaled::new(estimate, factor, settings), each });
            }
            Alignment::Inverse { scale, shift } => {
                let aligned = ScaledAndShifted::new(estimate, scale, shift, settings);
                level.run(Chunks { pixels: self, aligned, each });
            }
        }
    }

    /// The absolute errors `|y - t|` of the estimate as it is scored (aligned, clamped) at all scored pixels, in order,
    /// metres; NaN where it is missing. An `f32` holds them to 6e-8 of themselves, 5 micrometres at 80 m.
    ///
    /// # Panics
    /// If the estimate is of another size than the truth.
    #[must_use]
    pub fn absolute_errors<'a>(&self, estimate: impl Into<DepthEstimate<'a>>, settings: &Settings) -> Vec<f32> {
        self.mapped(estimate.into(), settings, |t, y| (y - t).abs() as f32)
    }

    /// The estimate as it is scored (aligned, clamped) at all scored pixels, in order, metres; NaN where it is missing.
    ///
    /// # Panics
    /// If the estimate is of another size than the truth.
    #[must_use]
    pub fn scored_estimate<'a>(&self, estimate: impl Into<DepthEstimate<'a>>, settings: &Settings) -> Vec<f32> {
        self.mapped(estimate.into(), settings, |_, y| y as f32)
    }

    /// The scored pixels with an estimate, in order, with its uncertainty; empty without uncertainty. A standard
    /// deviation is aligned with the estimate, to first order: `median` multiplies it by the same factor,
    /// `scale-and-shift` by the derivative of the aligned estimate.
    ///
    /// # Panics
    /// If the estimate or its uncertainty is of another size than the truth.
    #[must_use]
    pub fn uncertain(
        &self,
        estimate: DepthEstimate<'_>,
        alignment: Alignment,
        settings: &Settings,
    ) -> Vec<UncertainPixel> {
        let Some(uncertainty) = estimate.uncertainty else { return Vec::new() };
        let (Uncertainty::Deviation(map) | Uncertainty::Confidence(map)) = uncertainty;
        assert_eq!([estimate.metres.len(), map.len()], [self.of; 2], "all maps have as many pixels as the truth");
        let scored = |at: usize| match alignment {
            Alignment::Factor(factor) => Scaled::new(estimate, factor, settings).at(at),
            Alignment::Inverse { scale, shift } => ScaledAndShifted::new(estimate, scale, shift, settings).at(at),
        };
        let known = |value: f64| if value.is_finite() { value } else { f64::INFINITY };
        let pixel = |(&at, &t): (&u32, &f32)| {
            let (at, ground_truth_m) = (at as usize, f64::from(t));
            let estimate_m = scored(at);
            let value = f64::from(map[at]);
            let derivative = match alignment {
                Alignment::Factor(factor) => factor.abs(),
                Alignment::Inverse { scale, .. } => {
                    let ratio = estimate_m * estimate.inverse(at, settings.min_m);
                    scale.abs() * ratio * ratio
                }
            };
            let uncertainty = match uncertainty {
                Uncertainty::Deviation(_) if value < 0.0 => f64::INFINITY,
                Uncertainty::Deviation(_) => known(value * derivative),
                Uncertainty::Confidence(_) => known(-value),
            };
            (!estimate_m.is_nan()).then_some(UncertainPixel { ground_truth_m, estimate_m, uncertainty })
        };
        self.at.iter().zip(&self.ground_truth_m).filter_map(pixel).collect()
    }

    /// `of(t, y)` at all scored pixels; `y` is NaN where the estimate is missing.
    fn mapped(&self, estimate: DepthEstimate<'_>, settings: &Settings, of: impl Fn(f64, f64) -> f32) -> Vec<f32> {
        let mut mapped = Mapped { of, out: Vec::with_capacity(self.len()) };
        self.each_chunk(estimate, self.alignment(estimate, settings), settings, &mut mapped);
        mapped.out
    }

    /// What the settings do to this estimate, fitted over the scored pixels that have one.
    ///
    /// # Panics
    /// If the estimate is of another size than the truth.
    #[must_use]
    pub fn alignment<'a>(&self, estimate: impl Into<DepthEstimate<'a>>, settings: &Settings) -> Alignment {
        let estimate = estimate.into();
        assert_eq!(estimate.metres.len(), self.of, "the estimate has as many pixels as the truth");
        match settings.align {
            Align::None => Alignment::Factor(1.0),
            Align::Median => Alignment::Factor(self.median_factor(estimate.metres)),
            Align::ScaleAndShift => self.inverse_fit(estimate, settings.min_m),
        }
    }

    /// `median(truth) / median(estimate)` over the scored pixels with an estimate; 1 without such pixels, or if the
    /// median is zero.
    fn median_factor(&self, estimate_m: &[f32]) -> f64 {
        let pairs = self.at.iter().zip(&self.ground_truth_m).map(|(&at, &t)| (t, estimate_m[at as usize]));
        let (mut ts, mut ys): (Vec<f32>, Vec<f32>) = pairs.filter(|(_, y)| y.is_finite()).unzip();
        let (Some(t), Some(y)) = (median(&mut ts, f32::total_cmp), median(&mut ys, f32::total_cmp)) else { return 1.0 };
        if y > 0.0 { t / y } else { 1.0 }
    }

    /// Least squares of `s/y + b` against `1/t`; nothing is changed where all estimates are alike, for any `s` would
    /// do.
    fn inverse_fit(&self, estimate: DepthEstimate<'_>, min_m: f64) -> Alignment {
        let all = self.at.iter().zip(&self.ground_truth_m);
        let pairs = all.map(|(&at, &t)| (estimate.inverse(at as usize, min_m), 1.0 / f64::from(t), 1.0));
        match Line::least_squares(pairs.filter(|(x, ..)| !x.is_nan())) {
            Some(Line { scale, shift }) => Alignment::Inverse { scale, shift },
            None => Alignment::Factor(1.0),
        }
    }
}

/// A depth map to be scored, row-major.
#[derive(Clone, Copy, Debug)]
pub struct DepthEstimate<'a> {
    /// Metres; NaN or infinite: missing.
    pub metres: &'a [f32],
    /// The output of a network of inverse depth up to scale and shift, 1/m, where it is not the inverse of `metres`:
    /// where that is capped, or the output is zero or negative. NaN at other pixels. An alignment in inverse depth
    /// takes it; nothing else does.
    pub inverse: Option<&'a [f32]>,
    /// Its predicted uncertainty, if it has one.
    pub uncertainty: Option<Uncertainty<'a>>,
}

impl<'a> DepthEstimate<'a> {
    /// The estimate with an uncertainty.
    #[must_use]
    pub fn with_uncertainty(self, uncertainty: Option<Uncertainty<'a>>) -> Self {
        Self { uncertainty, ..self }
    }

    /// Whether it has an uncertainty, and which.
    #[must_use]
    pub fn uncertainty_kind(&self) -> UncertaintyKind {
        match self.uncertainty {
            None => UncertaintyKind::None,
            Some(Uncertainty::Deviation(_)) => UncertaintyKind::Deviation,
            Some(Uncertainty::Confidence(_)) => UncertaintyKind::Confidence,
        }
    }

    /// Inverse depth at a pixel, 1/m; NaN where it is missing. A depth of zero or below counts as `min_m`.
    pub(crate) fn inverse(&self, at: usize, min_m: f64) -> f64 {
        let own = self.inverse.map_or(f32::NAN, |map| map[at]);
        if own.is_finite() {
            return f64::from(own);
        }
        match self.metres[at] {
            y if !y.is_finite() => f64::NAN,
            y if y > 0.0 => 1.0 / f64::from(y),
            _ => 1.0 / min_m,
        }
    }
}

impl<'a> From<&'a [f32]> for DepthEstimate<'a> {
    fn from(metres: &'a [f32]) -> Self {
        Self { metres, inverse: None, uncertainty: None }
    }
}

impl<'a> From<&'a Vec<f32>> for DepthEstimate<'a> {
    fn from(metres: &'a Vec<f32>) -> Self {
        metres.as_slice().into()
    }
}

impl<'a, const N: usize> From<&'a [f32; N]> for DepthEstimate<'a> {
    fn from(metres: &'a [f32; N]) -> Self {
        metres.as_slice().into()
    }
}

/// What is done to an estimate before it is clamped: see [`Align`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alignment {
    /// It is multiplied.
    Factor(f64),
    /// Its inverse is scaled and shifted.
    Inverse {
        /// Without a unit.
        scale: f64,
        /// 1/m.
        shift: f64,
    },
}

impl Alignment {
    /// The whole estimate aligned, and clamped as it is scored, metres; NaN where it is missing.
    #[must_use]
    pub fn applied<'a>(self, estimate: impl Into<DepthEstimate<'a>>, settings: &Settings) -> Vec<f32> {
        let estimate = estimate.into();
        let pixels = 0..estimate.metres.len();
        match self {
            Self::Factor(factor) => {
                let scaled = Scaled::new(estimate, factor, settings);
                pixels.map(|at| scaled.at(at) as f32).collect()
            }
            Self::Inverse { scale, shift } => {
                let scaled = ScaledAndShifted::new(estimate, scale, shift, settings);
                pixels.map(|at| scaled.at(at) as f32).collect()
            }
        }
    }
}

/// Looks for the scored pixels.
struct Search<'a> {
    ground_truth_m: &'a [f32],
    width: usize,
    window: Window,
    min_m: f32,
    max_m: f32,
}

impl Pass for Search<'_> {
    /// Positions, and truths in metres.
    type Output = (Vec<u32>, Vec<f32>);

    #[inline(always)]
    fn run(self) -> (Vec<u32>, Vec<f32>) {
        const GROUP: usize = 16;
        let Self { ground_truth_m, width, window, min_m, max_m } = self;
        // Bits of positive floats order as the floats do; those of NaN and of negative numbers are above. So both
        // bounds are one comparison of integers.
        let (lowest, count) = (min_m.to_bits() + 1, max_m.to_bits().saturating_sub(min_m.to_bits() + 1));
        let is_scored = |t: f32| t.to_bits().wrapping_sub(lowest) < count;
        let (mut at, mut truths) = (Vec::new(), Vec::new());
        let (mut row_at, mut row_truths) = (vec![0; width], vec![0.0; width]);
        for row in window.rows {
            let first = row * width + window.columns.start;
            let mut scored = 0;
            for (group, first) in
                ground_truth_m[first..][..window.columns.len()].chunks(GROUP).zip((first..).step_by(GROUP))
            {
                // Most groups of a sparse truth are without it.
                if !group.iter().fold(false, |any, t| any | is_scored(*t)) {
                    continue;
                }
                for (&t, position) in group.iter().zip(first..) {
                    row_at[scored] = position as u32;
                    row_truths[scored] = t;
                    // Without a branch: sparse truth has no pattern to predict.
                    scored += usize::from(is_scored(t));
                }
            }
            at.extend_from_slice(&row_at[..scored]);
            truths.extend_from_slice(&row_truths[..scored]);
        }
        (at, truths)
    }
}

/// What is done with the scored pixels.
pub(crate) trait EachChunk {
    /// Takes the next pixels, at most [`CHUNK`]: the truth, and the estimate as it is scored (aligned, clamped), NaN
    /// where it is missing; metres. `#[inline(always)]`, as what a [`Pass`] calls.
    fn chunk(&mut self, ground_truth_m: &[f32], estimate_m: &[f64]);
}

struct Chunks<'a, A, E> {
    pixels: &'a ScoredPixels,
    aligned: A,
    each: &'a mut E,
}

impl<A: Aligned, E: EachChunk> Pass for Chunks<'_, A, E> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut metres = [0.0; CHUNK];
        for (at, truths) in self.pixels.at.chunks(CHUNK).zip(self.pixels.ground_truth_m.chunks(CHUNK)) {
            let metres = &mut metres[..at.len()];
            // Two loops: the first reads pixels from all over the map, the second is done in vectors.
            for (metres, at) in metres.iter_mut().zip(at) {
                *metres = self.aligned.before(*at as usize);
            }
            for metres in &mut *metres {
                *metres = self.aligned.scored(*metres);
            }
            self.each.chunk(truths, metres);
        }
    }
}

struct Visit<V, M> {
    valid: V,
    missing: M,
}

impl<V: FnMut(f64, f64), M: FnMut(f64)> EachChunk for Visit<V, M> {
    #[inline(always)]
    fn chunk(&mut self, ground_truth_m: &[f32], estimate_m: &[f64]) {
        for (&t, &y) in ground_truth_m.iter().zip(estimate_m) {
            if y.is_nan() {
                (self.missing)(f64::from(t));
            } else {
                (self.valid)(f64::from(t), y);
            }
        }
    }
}

struct Mapped<F> {
    of: F,
    out: Vec<f32>,
}

impl<F: Fn(f64, f64) -> f32> EachChunk for Mapped<F> {
    #[inline(always)]
    fn chunk(&mut self, ground_truth_m: &[f32], estimate_m: &[f64]) {
        self.out.extend(ground_truth_m.iter().zip(estimate_m).map(|(&t, &y)| (self.of)(f64::from(t), y)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Crop, Preset};

    #[test]
    fn truth_at_the_bounds_is_not_scored() {
        let truth = [f32::NAN, 0.0, 0.001, 0.002, 79.99, 80.0, 81.0, f32::INFINITY];
        let pixels = ScoredPixels::new(&truth, 8, 1, &Settings::default());
        assert_eq!(pixels.ground_truth_m(), [0.002, 79.99]);
    }

    #[test]
    fn only_pixels_inside_the_crop_are_scored() {
        let settings = Settings { crop: Crop::Garg, ..Settings::default() };
        let truth = vec![10.0; 1242 * 375];
        let pixels = ScoredPixels::new(&truth, 1242, 375, &settings);
        assert_eq!(pixels.len(), (371 - 153) * (1197 - 44));
        assert_eq!((pixels.at[0], pixels.at[pixels.len() - 1]), (153 * 1242 + 44, 370 * 1242 + 1196));
    }

    #[test]
    fn estimates_of_unknown_scale_are_brought_to_the_truths_median() {
        let settings = Settings { crop: Crop::None, ..Preset::Monodepth2.settings() };
        let (truth, estimate) = ([10.0, 20.0, 30.0, 40.0], [1.0, 2.0, 3.0, f32::NAN]);
        let errors = ScoredPixels::new(&truth, 4, 1, &settings).absolute_errors(&estimate, &settings);
        assert_eq!(errors[..3], [0.0, 0.0, 0.0]);
        assert!(errors.len() == 4 && errors[3].is_nan());
    }

    #[test]
    fn estimates_of_unknown_scale_and_shift_are_brought_to_the_truth_in_inverse_depth() {
        let settings = Settings { align: Align::ScaleAndShift, ..Settings::default() };
        let truth = [2.0, 4.0, 8.0, 16.0, 5.0];
        // 1/y = 3/t + 0.25, and an invalid pixel.
        let estimate = truth.map(|t: f32| if t == 5.0 { f32::NAN } else { 1.0 / (3.0 / t + 0.25) });
        let pixels = ScoredPixels::new(&truth, 5, 1, &settings);
        let Alignment::Inverse { scale, shift } = pixels.alignment(&estimate, &settings) else { panic!("fitted") };
        assert!((scale - 1.0 / 3.0).abs() < 1e-6 && (shift + 0.25 / 3.0).abs() < 1e-6, "{scale} {shift}");
        let errors = pixels.absolute_errors(&estimate, &settings);
        assert!(errors[..4].iter().all(|error| *error < 1e-4) && errors[4].is_nan(), "{errors:?}");
        // The line through (1/2, 1/3), (1/4, 1/4), (1/5, 1/10) that is nearest along the second axis.
        let (truth, estimate) = ([3.0, 4.0, 10.0], [2.0, 4.0, 5.0]);
        let fitted = ScoredPixels::new(&truth, 3, 1, &settings).alignment(&estimate, &settings);
        let Alignment::Inverse { scale, shift } = fitted else { panic!("fitted") };
        assert!(
            (scale - 0.6344086021505375).abs() < 1e-12 && (shift - 0.02688172043010753).abs() < 1e-12,
            "{scale} {shift}"
        );
        // Alike everywhere: there is no scale to be found.
        let flat = ScoredPixels::new(&truth, 3, 1, &settings).alignment(&[2.0; 3], &settings);
        assert_eq!(flat, Alignment::Factor(1.0));
    }

    /// NumPy 2.4, in f64:
    /// ```python
    /// raw = np.float32([-50, 0, 10, 160, 900, 2500, 60]); t = np.array([60, 45, 50, 12, 3, 1, 20.])
    /// s, b = np.linalg.lstsq(np.c_[raw, np.ones(7)].astype(float), 1 / t, rcond=None)[0]
    /// z = s * raw.astype(float) + b; y = np.where(z > 0, 1 / z, 80).clip(1e-3, 80)
    /// ```
    #[test]
    fn outputs_of_zero_and_below_are_aligned_as_they_are() {
        let settings = Settings { align: Align::ScaleAndShift, ..Settings::default() };
        let raw: [f32; 7] = [-50.0, 0.0, 10.0, 160.0, 900.0, 2500.0, 60.0];
        let truth = [60.0, 45.0, 50.0, 12.0, 3.0, 1.0, 20.0];
        // As `mono/onnx` gives them.
        let metres = raw.map(|x| if x > 0.0 { 1.0 / x } else { 80.0 });
        let inverse = raw.map(|x| if x > 0.0 { f32::NAN } else { x });
        let estimate = DepthEstimate { metres: &metres, inverse: Some(&inverse), uncertainty: None };
        let pixels = ScoredPixels::new(&truth, 7, 1, &settings);
        let Alignment::Inverse { scale, shift } = pixels.alignment(estimate, &settings) else { panic!("fitted") };
        assert!(
            (scale - 0.000_386_909_621_712_560_7).abs() < 1e-7 && (shift - 0.020_059_872_832_083_943).abs() < 1e-7,
            "{scale} {shift}"
        );
        let numpy = [
            80.0,
            49.850_764_676_862_305,
            41.790_350_346_644_24,
            12.200_268_038_249_783,
            2.715_336_116_812_055_8,
            1.012_828_560_367_153_6,
            23.108_323_661_747_97,
        ];
        for (scored, expected) in pixels.scored_estimate(estimate, &settings).into_iter().zip(numpy) {
            assert!((f64::from(scored) - expected).abs() < 1e-4, "{scored} {expected}");
        }
        let whole = pixels.alignment(estimate, &settings).applied(estimate, &settings);
        assert_eq!(whole, pixels.scored_estimate(estimate, &settings));
    }
}
