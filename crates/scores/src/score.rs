//! Scores of one estimated depth on one frame.

use crate::crop::Crop;
use crate::extra::Extra;
use crate::pixels::{Alignment, DepthEstimate, ScoredPixels};
use crate::row::{PixelSet, ScoreRow};
use crate::settings::Settings;
use crate::sums::ValidAndMissing;
use crate::uncertainty::{Sparsification, UncertaintyScores};
use crate::zones::{Clues, ZoneParams};
use crate::{Family, Metric};

/// How depths are scored: found once, used for every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthScores {
    pub(crate) settings: Settings,
    pub(crate) sets: Vec<PixelSet>,
    pub(crate) metrics: Vec<&'static Metric>,
    pub(crate) zones: ZoneParams,
    pub(crate) sparsification: Sparsification,
}

impl DepthScores {
    /// The metrics of an estimate against ground truth: of the whole image, then of each zone. Each has one row per
    /// pixel set, in the requested order.
    ///
    /// Maps as those of [`score`]. What aligns an estimate is fitted once, over the whole image.
    ///
    /// # Panics
    /// If a map has another number of pixels.
    #[must_use]
    pub fn rows<'a>(
        &self,
        estimate: impl Into<DepthEstimate<'a>>,
        ground_truth_m: &[f32],
        (width, height): (usize, usize),
        clues: &Clues<'_>,
    ) -> Vec<ScoreRow> {
        self.rows_on(estimate, &self.pixels(ground_truth_m, (width, height)), (width, height), clues)
    }

    /// The scored pixels of a ground truth, for [`DepthScores::rows_on`].
    ///
    /// # Panics
    /// As [`ScoredPixels::new`].
    #[must_use]
    pub fn pixels(&self, ground_truth_m: &[f32], (width, height): (usize, usize)) -> ScoredPixels {
        ScoredPixels::new(ground_truth_m, width, height, &self.settings)
    }

    /// What the [scored pixels](DepthScores::pixels) of a ground truth depend on: `min_m`, `max_m` and the crop.
    #[must_use]
    pub const fn bounds(&self) -> (f64, f64, Crop) {
        (self.settings.min_m, self.settings.max_m, self.settings.crop)
    }

    /// As [`DepthScores::rows`], on pixels found before.
    ///
    /// # Panics
    /// If a map has another number of pixels.
    #[must_use]
    pub fn rows_on<'a>(
        &self,
        estimate: impl Into<DepthEstimate<'a>>,
        pixels: &ScoredPixels,
        (width, height): (usize, usize),
        clues: &Clues<'_>,
    ) -> Vec<ScoreRow> {
        let estimate = estimate.into();
        let alignment = pixels.alignment(estimate, &self.settings);
        let mut rows = self.rows_of("", estimate, pixels, alignment);
        for zone in self.zones.of_frame(width, height, clues) {
            let part = pixels.part(|at, t| zone.has(at, t));
            rows.extend(self.rows_of(&zone.name, estimate, &part, alignment));
        }
        rows
    }

    /// The rows of some pixels. One pass serves all pixel sets, a second one the scores beyond Table I's.
    fn rows_of(
        &self,
        zone: &str,
        estimate: DepthEstimate<'_>,
        pixels: &ScoredPixels,
        alignment: Alignment,
    ) -> Vec<ScoreRow> {
        let settings = &self.settings;
        let counts_missing = self.sets.contains(&PixelSet::All);
        let mut sums = ValidAndMissing::new(counts_missing.then_some(settings.missing_m));
        pixels.each_chunk(estimate, alignment, settings, &mut sums);
        let [valid, missing] = sums.finish();
        let mut all = valid;
        all.merge(&missing);
        let mut extra = Extra::is_requested(&self.metrics).then(|| self.extra(estimate, pixels, alignment));
        let uncertainty = UncertaintyScores::is_requested(&self.metrics).then(|| {
            let pixels = pixels.uncertain(estimate, alignment, settings);
            UncertaintyScores::new(&pixels, estimate.uncertainty_kind(), self.sparsification)
        });
        let row = |&set: &PixelSet| {
            let (of_set, extra) = match (set, &mut extra) {
                (PixelSet::Valid, extra) => (&valid, extra.as_mut().map(|[valid, _]| valid)),
                (_, extra) => (&all, extra.as_mut().map(|[_, all]| all)),
            };
            let row = ScoreRow { truth: pixels.len() as u64, valid: valid.pixels(), ..ScoreRow::new(set, zone) };
            self.requested(of_set.row(row, settings), extra, uncertainty.as_ref())
        };
        self.sets.iter().map(row).collect()
    }

    /// The sums of the metrics that are not in Table I: over the valid pixels, and over all.
    fn extra(&self, estimate: DepthEstimate<'_>, pixels: &ScoredPixels, alignment: Alignment) -> [Extra; 2] {
        let (mut valid, mut missing) = (Extra::new(&self.metrics), Extra::new(&self.metrics));
        let settings = &self.settings;
        let with_missing = |t: f64| missing.push(t, settings.missing_m);
        pixels.visit(estimate, alignment, settings, |t, y| valid.push(t, y), with_missing);
        let mut all = valid.clone();
        all.merge(&missing);
        [valid, all]
    }

    /// The row with the requested metrics, in the catalogue's order.
    fn requested(
        &self,
        row: ScoreRow,
        mut extra: Option<&mut Extra>,
        uncertainty: Option<&UncertaintyScores>,
    ) -> ScoreRow {
        let (table_1, mut row) = (row.scores, ScoreRow { scores: Vec::with_capacity(self.metrics.len()), ..row });
        row.scores.extend(table_1.into_iter().filter(|(metric, _)| self.metrics.contains(metric)));
        let mut later = |metric: &Metric| {
            let extra = extra.as_mut().and_then(|extra| extra.score(metric));
            extra.or_else(|| uncertainty?.score(metric))
        };
        self.metrics.iter().fold(row, |row, metric| match later(metric) {
            Some(value) => row.with(metric, value),
            None => row,
        })
    }
}

/// The metrics of Table I of an estimate against ground truth, one row per pixel set, in the order of `sets`.
///
/// Both maps are row-major metres, `width * height` pixels. An estimate is invalid where it is NaN or infinite; the
/// ground truth is unknown where it is NaN. A row in which no pixel counts has no metrics. The formulas are those of
/// the [catalogue](crate::DEPTH) and [`Settings`].
///
/// # Panics
/// If a map has another number of pixels.
#[must_use]
pub fn score<'a>(
    estimate: impl Into<DepthEstimate<'a>>,
    ground_truth_m: &[f32],
    width: usize,
    height: usize,
    sets: &[PixelSet],
    settings: &Settings,
) -> Vec<ScoreRow> {
    let pixels = ScoredPixels::new(ground_truth_m, width, height, settings);
    score_pixels(estimate, &pixels, sets, &Family::Depth.defaults(), settings)
}

/// These scores on pixels found before: for several estimates of one frame. Otherwise as [`score`].
///
/// # Panics
/// If the estimate has another number of pixels than the truth had.
#[must_use]
pub fn score_pixels<'a>(
    estimate: impl Into<DepthEstimate<'a>>,
    pixels: &ScoredPixels,
    sets: &[PixelSet],
    metrics: &[&'static Metric],
    settings: &Settings,
) -> Vec<ScoreRow> {
    let (sets, metrics, zones) = (sets.to_vec(), metrics.to_vec(), ZoneParams::default());
    let sparsification = Sparsification::default();
    let scores = DepthScores { settings: *settings, sets, metrics, zones, sparsification };
    let estimate = estimate.into();
    scores.rows_of("", estimate, pixels, pixels.alignment(estimate, settings))
}
