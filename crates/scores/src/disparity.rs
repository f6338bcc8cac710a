//! Scores of one estimated disparity on one frame: those of the KITTI and Middlebury stereo benchmarks.
//!
//! Estimates and ground truth are f32, compared in f64: differences of whole 1/16 px and 1/256 px are exact, and so is
//! their comparison with a threshold. Errors are added up in the order of pixels; those of such disparities add up
//! exactly.

use crate::zones::{Clues, ZoneParams};
use crate::{DISPARITY, Metric, PixelSet, ScoreRow};

/// The thresholds of bad-x, px, in the order of the catalogue.
const BAD: [f64; 5] = [0.5, 1.0, 2.0, 3.0, 4.0];
/// An outlier of KITTI stereo 2015 is off by more than this, px, and by more than a twentieth of the truth.
const D1: f64 = 3.0;

/// How disparities are scored: found once, used for every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct DisparityScores {
    pub(crate) sets: Vec<PixelSet>,
    pub(crate) metrics: Vec<&'static Metric>,
    pub(crate) zones: ZoneParams,
}

/// The maps of a frame, row-major and of one size.
#[derive(Clone, Copy, Debug)]
pub struct DisparityMaps<'a> {
    /// Columns and rows.
    pub size: (usize, usize),
    /// The estimate, px; 0 and below, and NaN: invalid.
    pub estimate: &'a [f32],
    /// The same with its gaps filled as in the benchmark; required by the pixel set `filled`.
    pub filled: Option<&'a [f32]>,
    /// The truth, px; NaN: unknown.
    pub truth: &'a [f32],
    /// Focal length times baseline, px m: the distance is this divided by disparity plus `doffs_px`. Required by bands
    /// of distance.
    pub focal_baseline_px_m: Option<f64>,
    /// How much farther right the right camera's principal point lies, px.
    pub doffs_px: f64,
}

/// The numbers of valid and of wrong pixels, and the sum of errors.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    valid: u64,
    /// px.
    errors: f64,
    /// By threshold of bad-x; then D1.
    wrong: [u64; 6],
}

impl Counts {
    fn add(&mut self, estimate: f32, truth: f32) {
        // A pixel that is invalid even after filling has no error, and is compared as -1 px, as in KITTI's devkit.
        let is_valid = estimate > 0.0;
        let (d, t) = (if is_valid { f64::from(estimate) } else { -1.0 }, f64::from(truth));
        let error = (d - t).abs();
        if is_valid {
            self.valid += 1;
            self.errors += error;
        }
        for (wrong, threshold) in self.wrong.iter_mut().zip(BAD) {
            *wrong += u64::from(error > threshold);
        }
        self.wrong[5] += u64::from(error > D1 && 20.0 * error > t);
    }
}

impl DisparityScores {
    /// Whether the pixel set `filled` is requested.
    #[must_use]
    pub fn asks_for_filled(&self) -> bool {
        self.sets.contains(&PixelSet::Filled)
    }

    /// The metrics of an estimate against ground truth: of the whole image, then of each zone. Each has one row per
    /// pixel set, in the requested order.
    ///
    /// # Panics
    /// If the size of a map differs from its stated size, or a requested map is missing.
    #[must_use]
    pub fn rows(&self, maps: &DisparityMaps<'_>, clues: &Clues<'_>) -> Vec<ScoreRow> {
        let (width, height) = maps.size;
        let sizes = [maps.estimate.len(), maps.truth.len(), maps.filled.map_or(width * height, <[f32]>::len)];
        assert_eq!(sizes, [width * height; 3], "all maps are of one size");
        assert!(maps.filled.is_some() || !self.asks_for_filled(), "the set `filled` has its map");
        let zones = self.zones.of_frame(width, height, clues);
        let metres = maps.focal_baseline_px_m.unwrap_or(f64::NAN);
        let true_pixels = || (0..maps.truth.len()).filter(|at| !maps.truth[*at].is_nan());
        let mut rows = self.rows_of("", maps, true_pixels());
        for zone in zones {
            let inside = |at: &usize| zone.has(*at, metres / (f64::from(maps.truth[*at]) + maps.doffs_px));
            rows.extend(self.rows_of(&zone.name, maps, true_pixels().filter(inside)));
        }
        rows
    }

    fn rows_of(&self, zone: &str, maps: &DisparityMaps<'_>, pixels: impl Iterator<Item = usize>) -> Vec<ScoreRow> {
        let (mut truth, mut valid, mut filled) = (0, Counts::default(), Counts::default());
        for at in pixels {
            truth += 1;
            if maps.estimate[at] > 0.0 {
                valid.add(maps.estimate[at], maps.truth[at]);
            }
            if let Some(map) = maps.filled {
                filled.add(map[at], maps.truth[at]);
            }
        }
        let missing = truth - valid.valid;
        let row = |&set: &PixelSet| {
            let (pixels, of, also_wrong) = match set {
                PixelSet::Valid => (valid.valid, valid, 0),
                PixelSet::All => (truth, valid, missing),
                PixelSet::Filled => (truth, filled, 0),
            };
            let row = ScoreRow { pixels, truth, valid: valid.valid, ..ScoreRow::new(set, zone) };
            let epe = of.errors / of.valid as f64;
            let share = |wrong: u64| (wrong + also_wrong) as f64 / pixels as f64;
            let scores = std::iter::once(epe).chain(of.wrong.map(share));
            let requested = DISPARITY.iter().zip(scores).filter(|(metric, _)| self.metrics.contains(metric));
            requested.fold(row, |row, (metric, score)| row.with(metric, score))
        };
        self.sets.iter().map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DisparityScoreParams;

    const SETS: [PixelSet; 3] = [PixelSet::Valid, PixelSet::Filled, PixelSet::All];

    fn scores(zones: ZoneParams) -> DisparityScores {
        DisparityScoreParams { sets: SETS.to_vec(), zones, ..DisparityScoreParams::default() }.scores().unwrap()
    }

    fn values(row: &ScoreRow, names: &[&str]) -> Vec<f64> {
        names.iter().map(|name| row.score(name).unwrap()).collect()
    }

    /// Ground truth 10, 80, 100, 20 px and one unknown; estimates 10.5, 84, 95, invalid: errors 0.5, 4, 5 px.
    #[test]
    fn five_pixels_by_hand() {
        let maps = DisparityMaps {
            size: (5, 1),
            estimate: &[10.5, 84.0, 95.0, -1.0, 10.0],
            filled: Some(&[10.5, 84.0, 95.0, 10.0, 10.0]),
            truth: &[10.0, 80.0, 100.0, 20.0, f32::NAN],
            focal_baseline_px_m: None,
            doffs_px: 0.0,
        };
        let rows = scores(ZoneParams::default()).rows(&maps, &Clues::default());
        let all = ["epe", "bad_0.5", "bad_1", "bad_2", "bad_3", "bad_4", "d1"];
        // 0.5 px is not above 0.5, 4 px not above 4; 4 px are exactly 5 % of 80, and 5 px exactly 5 % of 100: no
        // outliers.
        assert_eq!(values(&rows[0], &all), [9.5 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0, 0.0]);
        // Filled, the fourth is 10 px, of 20: off by half.
        assert_eq!(values(&rows[1], &all), [19.5 / 4.0, 0.75, 0.75, 0.75, 0.75, 0.5, 0.25]);
        // An invalid pixel is wrong, and has no end-point error.
        assert_eq!(values(&rows[2], &all), [9.5 / 3.0, 0.75, 0.75, 0.75, 0.75, 0.5, 0.25]);
        assert!(rows.iter().all(|row| row.density() == Some(0.75)));
        assert_eq!(rows.iter().map(|row| row.pixels).collect::<Vec<_>>(), [3, 4, 4]);
    }

    #[test]
    fn an_outlier_is_off_by_more_than_three_pixels_and_by_more_than_five_per_cent() {
        // 3 px of 20 (not above 3), 3 1/16 px of 20, 3 1/16 px of 61.25 (exactly 5 %), 3 1/16 px of 61.
        let maps = DisparityMaps {
            size: (4, 1),
            estimate: &[23.0, 23.0625, 64.3125, 64.0625],
            filled: None,
            truth: &[20.0, 20.0, 61.25, 61.0],
            focal_baseline_px_m: None,
            doffs_px: 0.0,
        };
        let params = DisparityScoreParams { sets: vec![PixelSet::All], ..DisparityScoreParams::default() };
        let rows = params.scores().unwrap().rows(&maps, &Clues::default());
        assert_eq!(values(&rows[0], &["bad_3", "d1"]), [0.75, 0.5]);
    }

    /// NumPy: `e = abs(np.float32([20.53, 20.47, 20.5, 23.03]) - 20); (e > .5).mean(), e.mean()`; in whole sixteenths
    /// the first two are 0.5 px off.
    #[test]
    fn disparities_are_not_rounded() {
        let maps = DisparityMaps {
            size: (4, 1),
            estimate: &[20.53, 20.47, 20.5, 23.03],
            filled: None,
            truth: &[20.0; 4],
            focal_baseline_px_m: None,
            doffs_px: 0.0,
        };
        let params = DisparityScoreParams { sets: vec![PixelSet::All], ..DisparityScoreParams::default() };
        let rows = params.scores().unwrap().rows(&maps, &Clues::default());
        assert_eq!(values(&rows[0], &["bad_0.5", "bad_3"]), [0.5, 0.25]);
        assert!((rows[0].score("epe").unwrap() - 1.132_500_171_661_377).abs() < 1e-12, "{:?}", rows[0].score("epe"));
    }

    #[test]
    fn what_never_valid_is_all_wrong_and_has_no_error() {
        let maps = DisparityMaps {
            size: (2, 1),
            estimate: &[-1.0, 0.0],
            filled: Some(&[0.0, 0.0]),
            truth: &[1.0, 2.0],
            focal_baseline_px_m: None,
            doffs_px: 0.0,
        };
        let rows = scores(ZoneParams::default()).rows(&maps, &Clues::default());
        assert_eq!((rows[0].pixels, rows[0].scores.len()), (0, 0));
        assert_eq!((rows[2].score("epe"), rows[2].score("d1"), rows[2].density()), (None, Some(1.0), Some(0.0)));
    }

    #[test]
    fn objects_make_foreground_and_background_and_distance_comes_of_the_disparity() {
        let maps = DisparityMaps {
            size: (3, 1),
            estimate: &[40.0, 10.0, 5.0],
            filled: Some(&[40.0, 10.0, 5.0]),
            truth: &[40.0, 20.0, 5.0],
            focal_baseline_px_m: Some(400.0),
            doffs_px: 0.0,
        };
        let zones = || ZoneParams { distance_m: vec![0.0, 20.0, 80.0], ..ZoneParams::default() };
        let clues = Clues { objects: Some(&[7, 7, 0]), ..Clues::default() };
        let rows = scores(zones()).rows(&maps, &clues);
        let d1 = |zone: &str| {
            let row = rows.iter().find(|row| row.zone == zone && row.set == PixelSet::All).unwrap();
            (row.pixels, row.score("d1").unwrap())
        };
        assert_eq!((d1(""), d1("background"), d1("foreground")), ((3, 1.0 / 3.0), (1, 0.0), (2, 0.5)));
        // 10 and 20 m, 80 m: the upper bound is outside.
        assert_eq!((d1("0..20"), d1("20..80")), ((1, 0.0), (1, 1.0)));
        // With the principal points 5 px apart, 45 px are 8.9 m, 25 px 16 m and 10 px 40 m.
        let rows = scores(zones()).rows(&DisparityMaps { doffs_px: 5.0, ..maps }, &clues);
        let pixels = |zone: &str| rows.iter().find(|row| row.zone == zone && row.set == PixelSet::All).unwrap().pixels;
        assert_eq!((pixels("0..20"), pixels("20..80")), (2, 1));
    }
}
