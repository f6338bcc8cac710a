//! Which pixels of a frame are scored.

use crate::Settings;

/// The pixels of a frame whose truth is scored: found once, used for every estimate of the frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScoredPixels {
    /// Row-major positions.
    at: Vec<u32>,
    /// The truth there, metres.
    truth_m: Vec<f32>,
    /// How many pixels the image has.
    of: usize,
}

impl ScoredPixels {
    /// The pixels of a truth (row-major metres; NaN: nothing measured) that the settings score.
    ///
    /// # Panics
    /// If the truth has not `width * height` pixels, or more than 2^32.
    #[must_use]
    pub fn new(truth_m: &[f32], width: usize, height: usize, settings: &Settings) -> Self {
        assert_eq!(truth_m.len(), width * height, "the truth has as many pixels as the image");
        assert!(u32::try_from(truth_m.len()).is_ok(), "an image has fewer than 2^32 pixels");
        let window = settings.crop.window(width, height);
        // Bounds as the maps hold them: a truth of exactly 1e-3 m in f32 is not above 1e-3.
        let (min_m, max_m) = (settings.min_m as f32, settings.max_m as f32);
        let (mut at, mut truths) = (Vec::new(), Vec::new());
        let (mut row_at, mut row_truths) = (vec![0; width], vec![0.0; width]);
        for row in window.rows {
            let first = row * width;
            let mut scored = 0;
            for column in window.columns.clone() {
                let t = truth_m[first + column];
                row_at[scored] = (first + column) as u32;
                row_truths[scored] = t;
                // Without a branch: sparse truth has no pattern to predict. NaN compares false.
                scored += usize::from(t > min_m && t < max_m);
            }
            at.extend_from_slice(&row_at[..scored]);
            truths.extend_from_slice(&row_truths[..scored]);
        }
        Self { at, truth_m: truths, of: truth_m.len() }
    }

    /// The same pixels by whole metres of their truth, within a metre as they were; what is `farthest_m` away or farther comes last,
    /// as one metre. For what depends on no order: sums do, in their last bits.
    #[must_use]
    pub fn by_metre(&self, farthest_m: u32) -> Self {
        let metre = |t: f32| (t as u32).min(farthest_m) as usize;
        let mut next = vec![0; farthest_m as usize + 2];
        self.truth_m.iter().for_each(|&t| next[metre(t) + 1] += 1);
        let mut before = 0;
        for place in &mut next {
            before += *place;
            *place = before;
        }
        let mut sorted = Self { at: vec![0; self.len()], truth_m: vec![0.0; self.len()], of: self.of };
        for (&at, &t) in self.at.iter().zip(&self.truth_m) {
            let place = &mut next[metre(t)];
            (sorted.at[*place], sorted.truth_m[*place]) = (at, t);
            *place += 1;
        }
        sorted
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

    /// Where the scored pixels are: row-major positions in the image, ascending unless they were [put in another
    /// order](Self::by_metre).
    #[must_use]
    pub fn positions(&self) -> &[u32] {
        &self.at
    }

    /// The truth at the scored pixels, metres, in the same order.
    #[must_use]
    pub fn truth_m(&self) -> &[f32] {
        &self.truth_m
    }

    /// Calls `f(t, y)` for every scored pixel with an answer, in order: the truth, and the estimate as it is scored
    /// (median scaled if asked for, clamped), both in metres; and `missing(t)` for every one without.
    ///
    /// # Panics
    /// If the estimate is of another size than the truth.
    pub(crate) fn visit(
        &self,
        estimate_m: &[f32],
        settings: &Settings,
        mut answered: impl FnMut(f64, f64),
        mut missing: impl FnMut(f64),
    ) {
        assert_eq!(estimate_m.len(), self.of, "the estimate has as many pixels as the truth");
        let factor = if settings.median_scaling { self.median_factor(estimate_m) } else { 1.0 };
        for (&at, &t) in self.at.iter().zip(&self.truth_m) {
            let y = estimate_m[at as usize];
            if y.is_finite() {
                answered(f64::from(t), (f64::from(y) * factor).clamp(settings.min_m, settings.max_m));
            } else {
                missing(f64::from(t));
            }
        }
    }

    /// Calls `f(t, e)` for every scored pixel with an answer, in order: the truth and the absolute error
    /// `e = |y - t|` of the estimate as it is scored (median scaled if asked for, clamped), metres.
    ///
    /// # Panics
    /// If the estimate is of another size than the truth.
    pub fn absolute_errors(&self, estimate_m: &[f32], settings: &Settings, mut f: impl FnMut(f32, f64)) {
        self.visit(estimate_m, settings, |t, y| f(t as f32, (y - t).abs()), |_| {});
    }

    /// `median(truth) / median(estimate)` over the scored pixels with an answer; 1 where there is none, or the median is zero.
    fn median_factor(&self, estimate_m: &[f32]) -> f64 {
        let answers = self.at.iter().zip(&self.truth_m).map(|(&at, &t)| (estimate_m[at as usize], t));
        let (mut ys, mut ts): (Vec<f32>, Vec<f32>) = answers.filter(|(y, _)| y.is_finite()).unzip();
        let (Some(t), Some(y)) = (median(&mut ts), median(&mut ys)) else { return 1.0 };
        if y > 0.0 { t / y } else { 1.0 }
    }
}

/// The median, as numpy's: the mean of the middle two of an even number.
fn median(values: &mut [f32]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    let even = values.len().is_multiple_of(2);
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f32::total_cmp);
    let upper = f64::from(upper);
    let lower = below.iter().copied().max_by(f32::total_cmp).filter(|_| even);
    Some(lower.map_or(upper, |lower| f64::midpoint(f64::from(lower), upper)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Crop, Preset};

    #[test]
    fn truth_at_the_bounds_is_not_scored() {
        let truth = [f32::NAN, 0.0, 0.001, 0.002, 79.99, 80.0, 81.0, f32::INFINITY];
        let pixels = ScoredPixels::new(&truth, 8, 1, &Settings::default());
        assert_eq!(pixels.truth_m(), [0.002, 79.99]);
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
    fn pixels_by_metre_are_the_same_pixels() {
        let truth = [3.5, 9.0, 3.25, f32::NAN, 70.0, 1.0, 60.0, 3.75];
        let pixels = ScoredPixels::new(&truth, 4, 2, &Settings::default()).by_metre(50);
        assert_eq!(pixels.positions(), [5, 0, 2, 7, 1, 4, 6]);
        assert_eq!(pixels.truth_m(), [1.0, 3.5, 3.25, 3.75, 9.0, 70.0, 60.0]);
        assert!(ScoredPixels::default().by_metre(50).is_empty());
    }

    #[test]
    fn median_is_numpys() {
        assert_eq!(median(&mut []), None);
        assert_eq!(median(&mut [3.0]), Some(3.0));
        assert_eq!(median(&mut [4.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 8.0]), Some(3.0));
    }

    #[test]
    fn estimates_of_unknown_scale_are_brought_to_the_truths_median() {
        let settings = Settings { crop: Crop::None, ..Preset::Monodepth2.settings() };
        let (truth, estimate) = ([10.0, 20.0, 30.0, 40.0], [1.0, 2.0, 3.0, f32::NAN]);
        let mut errors = Vec::new();
        ScoredPixels::new(&truth, 4, 1, &settings).absolute_errors(&estimate, &settings, |_, e| errors.push(e));
        assert_eq!(errors, [0.0, 0.0, 0.0]);
    }
}
