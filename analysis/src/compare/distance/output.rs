//! The JSON output of a comparison by distance.

use schemars::JsonSchema;
use serde::Serialize;

use super::super::contrast::Verdicts;
use super::table::DistanceComparison;
use super::{Compared, DistancePair, Handover, MIN_PIXELS, Near, Statistic};
use crate::tables::JsonRow;

/// The output of `compare --by distance`: differences by distance, with intervals and tests.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct DistanceComparisonOutput {
    /// Describes the numbers.
    about: String,
    method: DistanceMethod,
    verdicts: Verdicts,
    /// The handover distance of each pair and statistic.
    handovers: Vec<HandoverAt>,
    /// One row per bin, statistic and pair, with the columns of the CSV form, which docs/tables.md explains.
    rows: Vec<JsonRow>,
    notes: Vec<String>,
}

/// The method of intervals and tests.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct DistanceMethod {
    /// `BCa` or `percentile`.
    interval: &'static str,
    /// `percentile`: the method of intervals of handover distances.
    handover_interval: &'static str,
    /// From 0 to 1.
    confidence: f64,
    resamples: u64,
    seed: u64,
    /// `wilcoxon`.
    test: &'static str,
    /// `holm`, over the bins of a pair's statistic.
    correction: &'static str,
    /// The number of corrected tests of the first pair.
    tests: u64,
    /// Bins with fewer pixels are ignored for the handover distance.
    thin_pixels: u64,
}

/// The handover distance of two estimates: near it use one, beyond it the other. Null if one alone is best.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct HandoverAt {
    baseline: String,
    other: String,
    /// `mean` or `median`.
    statistic: &'static str,
    /// The estimate that is better nearer than the handover.
    near: Option<String>,
    far: Option<String>,
    distance_m: Option<f64>,
    /// The ends of its interval over the resamples that have such a handover.
    distance_low_m: Option<f64>,
    distance_high_m: Option<f64>,
    /// The share of resamples that have a handover.
    share: Option<f64>,
    /// All distances at which the difference crosses zero.
    crossings_m: Vec<f64>,
}

impl HandoverAt {
    fn new(pair: &DistancePair, statistic: Statistic, handover: Option<&Handover>) -> Self {
        let [baseline, other] = &pair.estimates;
        let (near, far) = match handover.map(|handover| handover.near) {
            Some(Near::Other) => (other, baseline),
            Some(Near::Baseline) | None => (baseline, other),
        };
        let title = |estimate: &Compared| handover.map(|_| estimate.title.clone());
        let interval = handover.and_then(|handover| handover.interval);
        Self {
            baseline: baseline.title.clone(),
            other: other.title.clone(),
            statistic: statistic.name(),
            near: title(near),
            far: title(far),
            distance_m: handover.map(|handover| handover.distance_m),
            distance_low_m: interval.map(|interval| interval.low),
            distance_high_m: interval.map(|interval| interval.high),
            share: handover.map(|handover| handover.share),
            crossings_m: handover.map_or_else(Vec::new, |handover| handover.crossings_m.clone()),
        }
    }
}

impl DistanceComparison {
    /// The JSON output, with the columns of the CSV form.
    #[must_use]
    pub fn output(&self) -> DistanceComparisonOutput {
        let first_rows = self.pairs.first().map_or(&[][..], |pair| &pair.rows);
        let tested = first_rows.iter().filter(|row| row.statistic == Statistic::Mean && row.test.is_some());
        let handovers = self.pairs.iter().flat_map(|pair| {
            let of_pair = pair.handovers.iter();
            of_pair.map(move |(statistic, handover)| HandoverAt::new(pair, *statistic, handover.as_ref()))
        });
        DistanceComparisonOutput {
            about: self.table.about.clone(),
            method: DistanceMethod {
                interval: self.resampling.method.name(),
                handover_interval: "percentile",
                confidence: self.resampling.confidence,
                resamples: self.resampling.resamples.into(),
                seed: self.resampling.seed,
                test: "wilcoxon",
                correction: "holm",
                tests: tested.count() as u64,
                thin_pixels: MIN_PIXELS,
            },
            verdicts: self.pairs.iter().flat_map(|pair| &pair.rows).map(|row| row.verdict).collect(),
            handovers: handovers.collect(),
            rows: self.table.json_rows(),
            notes: self.table.notes.clone(),
        }
    }
}
