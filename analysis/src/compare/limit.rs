//! Limits of `--fail-if`, for example `fused.abs_rel > +1%`.

use std::collections::BTreeSet;

use depthloom_graphs::language::glob;
use depthloom_scores::{Mean, Metric, ScoreRow};
use schemars::JsonSchema;
use serde::Serialize;

use super::contrast::Contrast;
use super::{CompareOptions, Pair};
use crate::error::{AnalysisError, listed, unknown};
use crate::estimates::{Estimate, matches_estimate};

/// The measure of a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Measure {
    /// A metric, which has a row in the comparison.
    Metric(&'static Metric),
    /// The share of valid pixels, which has no row.
    Density,
}

impl Measure {
    /// The name of [`Measure::Density`].
    const DENSITY: &str = "density";

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Metric(metric) => metric.name,
            Self::Density => Self::DENSITY,
        }
    }

    /// The number of decimals of a change in text.
    pub(super) const fn decimals(self) -> usize {
        match self {
            Self::Metric(metric) => metric.decimals + 2,
            Self::Density => 5,
        }
    }
}

/// A bound on the change of a metric.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Limit {
    written: String,
    /// A pattern of the estimates that the limit applies to; `None`: all.
    estimate: Option<String>,
    measure: Measure,
    /// Whether changes above the bound exceed the limit, or changes below it.
    is_above: bool,
    /// Whether a change equal to the bound exceeds the limit.
    is_reached: bool,
    change: f64,
    /// Whether the change is in per cent of the baseline's value.
    is_relative: bool,
}

/// A limit checked against a row.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
#[schemars(rename = "Limit")]
pub(crate) struct JudgedLimit {
    /// As it was written.
    limit: String,
    /// The index of the row in `rows`; null for `density`, which has no row.
    row: Option<u64>,
    /// In per cent of the baseline's value, or in the unit of the metric; null if the baseline's value is 0.
    change: Option<f64>,
    is_percent: bool,
    pub(super) exceeded: bool,
    /// The limit and the change as text.
    #[serde(skip)]
    pub(super) text: String,
}

impl Limit {
    /// Parses `[ESTIMATE.]METRIC > [+|-]NUMBER[%]`; also `<`, `>=`, `<=`.
    pub(super) fn parse(written: &str) -> Result<Self, AnalysisError> {
        let wrong = |what: String| {
            AnalysisError::request(
                what,
                "examples: `fused.abs_rel > +1%`, `d1 >= 0.002`, `no_*/fused.a1 < -0.5%`".to_owned(),
            )
        };
        let Some(place) = written.rfind(['<', '>']) else {
            return Err(wrong(format!("`{written}` has no `>` or `<`")));
        };
        let (left, right) = (written[..place].trim(), &written[place + 1..]);
        let (is_reached, right) = match right.strip_prefix('=') {
            Some(right) => (true, right.trim()),
            None => (false, right.trim()),
        };
        let (number, is_relative) = match right.strip_suffix('%') {
            Some(number) => (number.trim(), true),
            None => (right, false),
        };
        let change = number.parse().ok().filter(|change: &f64| change.is_finite());
        let change = change.ok_or_else(|| wrong(format!("`{right}` in `{written}` is not a number")))?;
        let all = || crate::metrics().map(Measure::Metric).chain([Measure::Density]);
        let is_named = |measure: &Measure| left == measure.name() || left.ends_with(&format!(".{}", measure.name()));
        let Some(measure) = all().filter(is_named).max_by_key(|measure| measure.name().len()) else {
            let name = left.rsplit('.').next().unwrap_or(left);
            return Err(unknown("metric", name, all().map(Measure::name).collect::<Vec<_>>()));
        };
        let estimate = left.strip_suffix(measure.name()).and_then(|left| left.strip_suffix('.')).map(str::to_owned);
        let is_above = written[place..].starts_with('>');
        Ok(Self { written: written.trim().to_owned(), estimate, measure, is_above, is_reached, change, is_relative })
    }

    fn applies_to(&self, pair: &Pair<'_>) -> bool {
        let Some(pattern) = &self.estimate else { return true };
        matches_estimate(pair.other.estimate, pattern) || glob(pattern, &pair.name)
    }

    /// Checks the change from the baseline's value to the value of the other side, whose label is `label`. `row` is the
    /// index of the metric's row.
    fn judge(&self, label: &str, row: usize, baseline: f64, value: f64) -> JudgedLimit {
        let change = match (value - baseline, self.is_relative) {
            (difference, true) if difference != 0.0 => 100.0 * difference / baseline.abs(),
            (difference, _) => difference,
        };
        let beyond = if self.is_above { change > self.change } else { change < self.change };
        let shown = match self.is_relative {
            true => format!("{change:+.2} %"),
            false => format!("{change:+.*}", self.measure.decimals()),
        };
        JudgedLimit {
            limit: self.written.clone(),
            row: matches!(self.measure, Measure::Metric(_)).then_some(row as u64),
            change: Some(change),
            is_percent: self.is_relative,
            exceeded: beyond || self.is_reached && change == self.change,
            text: format!("{} ({label} {}: {shown})", self.written, self.measure.name()),
        }
    }
}

/// Checks all limits.
///
/// A limit that cannot be checked is an error: a guard that checks nothing must not pass.
pub(super) fn judged(
    limits: &[Limit],
    pairs: &[Pair<'_>],
    contrasts: &[Contrast],
    options: &CompareOptions,
) -> Result<Vec<JudgedLimit>, AnalysisError> {
    let mut judged = Vec::new();
    for limit in limits {
        let written = &limit.written;
        let mut checked = 0;
        for (place, pair) in pairs.iter().enumerate().filter(|(_, pair)| limit.applies_to(pair)) {
            let has = |metrics: &[&'static Metric]| match limit.measure {
                Measure::Metric(metric) => metrics.contains(&metric),
                Measure::Density => true,
            };
            if !has(&pair.baseline.estimate.metrics) || !has(&pair.other.estimate.metrics) {
                continue;
            }
            checked += 1;
            let title = &pair.other.estimate.label;
            if !pair.is_scored_alike(options) {
                return Err(AnalysisError::request(
                    format!("cannot check `{written}` for {title}: it and its baseline were scored in different ways"),
                    "score both with the same preset, bounds, crop, alignment and mean".to_owned(),
                ));
            }
            let is_measured = |(_, contrast): &(usize, &Contrast)| {
                contrast.pair == place
                    && match limit.measure {
                        Measure::Metric(metric) => contrast.metric == metric,
                        Measure::Density => true,
                    }
            };
            let values = |(row, contrast): (usize, &Contrast)| match limit.measure {
                Measure::Metric(_) => Some((row, contrast.baseline, contrast.value)),
                Measure::Density => densities(pair, options).map(|(baseline, value)| (row, baseline, value)),
            };
            let Some((row, baseline, value)) = contrasts.iter().enumerate().find(is_measured).and_then(values) else {
                return Err(AnalysisError::request(
                    format!(
                        "cannot check `{written}` for {title}: no common frame has a value of {}",
                        limit.measure.name()
                    ),
                    "add it to `--metrics` if that is given; `depthloom table RUN` shows the metrics of each estimate"
                        .to_owned(),
                ));
            };
            let Estimate { row_key, name, .. } = pair.other.estimate;
            let label = row_key.variant.as_ref().map_or_else(|| name.clone(), |variant| format!("{variant}/{name}"));
            judged.push(limit.judge(&label, row, baseline, value));
        }
        if checked == 0 {
            let names: BTreeSet<&str> = pairs.iter().map(|pair| pair.other.estimate.label.as_str()).collect();
            return Err(AnalysisError::request(
                format!("`{written}` matches no compared estimate with this metric"),
                format!("compared estimates: {}; check that both sides have {}", listed(names), limit.measure.name()),
            ));
        }
    }
    Ok(judged)
}

/// The shares of valid pixels of both sides over their common frames. `None` if they were not recorded.
fn densities(pair: &Pair<'_>, options: &CompareOptions) -> Option<(f64, f64)> {
    let rows = pair.paired.frames.iter().map(|(one, two)| (&one.row, &two.row));
    let both: Vec<_> = rows.filter(|(one, two)| one.density().is_some() && two.density().is_some()).collect();
    let (ours, theirs): (Vec<&ScoreRow>, Vec<&ScoreRow>) = both.into_iter().unzip();
    let density = |rows: &[&ScoreRow]| match pair.mean(options) {
        Mean::Frames => rows.iter().filter_map(|row| row.density()).sum::<f64>() / rows.len() as f64,
        Mean::Pixels => {
            let sum = |count: fn(&ScoreRow) -> u64| rows.iter().map(|row| count(row)).sum::<u64>() as f64;
            sum(|row| row.valid) / sum(|row| row.truth)
        }
    };
    (!ours.is_empty()).then(|| (density(&ours), density(&theirs)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_parse_estimate_metric_and_change() {
        let parsed = |text: &str| {
            let Limit { estimate, measure, is_above, is_reached, change, is_relative, .. } =
                Limit::parse(text).unwrap();
            (estimate, measure.name(), is_above, is_reached, change, is_relative)
        };
        assert_eq!(parsed("fused.abs_rel > +1%"), (Some("fused".to_owned()), "abs_rel", true, false, 1.0, true));
        assert_eq!(parsed("a1<-0.005"), (None, "a1", false, false, -0.005, false));
        // A dot in the name of an estimate, and in that of a metric.
        assert_eq!(
            parsed("p=0.5/raw.bad_0.5 >= 2 %"),
            (Some("p=0.5/raw".to_owned()), "bad_0.5", true, true, 2.0, true)
        );
        assert_eq!(parsed("look.mono.irmse > 0"), (Some("look.mono".to_owned()), "irmse", true, false, 0.0, false));
        assert_eq!(parsed("*.density < -1%"), (Some("*".to_owned()), "density", false, false, -1.0, true));
        for (text, what) in [
            ("fused.abs_rel", "`fused.abs_rel` has no `>` or `<`"),
            ("fused.abs_rel > much", "`much` in `fused.abs_rel > much` is not a number"),
            ("fused.abs_rel > nan", "`nan` in `fused.abs_rel > nan` is not a number"),
            ("fused.abs_rle > 1%", "there is no metric `abs_rle`"),
        ] {
            assert_eq!(Limit::parse(text).unwrap_err().to_string(), what);
        }
    }
}
