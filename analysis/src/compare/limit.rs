//! What must not be: `fused.abs_rel > +1%`.

use std::collections::BTreeSet;

use depthloom_graphs::language::glob;
use depthloom_scores::Metric;

use super::contrast::Contrast;
use super::{CompareOptions, Pair, listed};
use crate::ablation::{is_of, unknown};
use crate::error::AnalysisError;

/// A bound on how a score may change.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Limit {
    written: String,
    /// A pattern of the estimates that it is on; `None`: all.
    estimator: Option<String>,
    metric: &'static Metric,
    /// Whether a change above it is too much, or one below.
    is_above: bool,
    /// Whether the bound itself is too much already.
    is_reached: bool,
    change: f64,
    /// Whether the change is one in per cent of the baseline's value.
    is_relative: bool,
}

/// How an estimate stands to a limit.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Judged {
    /// The limit, as written.
    pub(super) limit: String,
    /// The score's place in the comparison.
    pub(super) contrast: usize,
    /// The change, in per cent of the baseline's value or in the score's unit.
    pub(super) change: f64,
    pub(super) is_relative: bool,
    pub(super) is_exceeded: bool,
}

impl Limit {
    /// Reads `[ESTIMATOR.]SCORE > [+|-]NUMBER[%]`; also `<`, `>=`, `<=`.
    pub(super) fn parse(written: &str) -> Result<Self, AnalysisError> {
        let wrong = |what: String| {
            AnalysisError::asked(
                what,
                "write it as `fused.abs_rel > +1%`, `d1 >= 0.002` or `no_*/fused.a1 < -0.5%`".to_owned(),
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
        let change = change.ok_or_else(|| wrong(format!("`{right}` in `{written}` is no number")))?;
        let of = |metric: &&'static Metric| left == metric.name || left.ends_with(&format!(".{}", metric.name));
        let Some(metric) = crate::metrics().filter(of).max_by_key(|metric| metric.name.len()) else {
            let name = left.rsplit('.').next().unwrap_or(left);
            return Err(unknown("score", name, crate::metrics().map(|metric| metric.name).collect::<Vec<_>>()));
        };
        let estimator = left.strip_suffix(metric.name).and_then(|left| left.strip_suffix('.')).map(str::to_owned);
        let is_above = written[place..].starts_with('>');
        Ok(Self { written: written.trim().to_owned(), estimator, metric, is_above, is_reached, change, is_relative })
    }

    fn is_on(&self, pair: &Pair<'_>) -> bool {
        let Some(pattern) = &self.estimator else { return true };
        is_of(pair.other.estimator, pattern) || glob(pattern, &pair.name)
    }

    fn judge(&self, place: usize, contrast: &Contrast) -> Judged {
        let change = if self.is_relative { 100.0 * contrast.change() } else { contrast.difference() };
        let beyond = if self.is_above { change > self.change } else { change < self.change };
        Judged {
            limit: self.written.clone(),
            contrast: place,
            change,
            is_relative: self.is_relative,
            is_exceeded: beyond || self.is_reached && change == self.change,
        }
    }
}

/// How all that limits are on stand to them.
///
/// What cannot be held against a limit is an error, and not kept: a guard that looks at nothing guards nothing.
pub(super) fn judged(
    limits: &[Limit],
    pairs: &[Pair<'_>],
    contrasts: &[Contrast],
    options: &CompareOptions,
) -> Result<Vec<Judged>, AnalysisError> {
    let mut judged = Vec::new();
    for limit in limits {
        let written = &limit.written;
        let mut met = 0;
        for (place, pair) in pairs.iter().enumerate().filter(|(_, pair)| limit.is_on(pair)) {
            let has = |metrics: &[&'static Metric]| metrics.contains(&limit.metric);
            if !has(&pair.baseline.estimator.metrics) || !has(&pair.other.estimator.metrics) {
                continue;
            }
            met += 1;
            let title = &pair.other.estimator.label;
            if !pair.is_scored_alike(options) {
                return Err(AnalysisError::asked(
                    format!("`{written}` cannot be told of {title}: the two were scored in different ways"),
                    "score both alike: same preset, bounds, crop, alignment and mean".to_owned(),
                ));
            }
            let of = |(_, contrast): &(usize, &Contrast)| contrast.pair == place && contrast.metric == limit.metric;
            let Some((place, contrast)) = contrasts.iter().enumerate().find(of) else {
                return Err(AnalysisError::asked(
                    format!(
                        "`{written}` cannot be told of {title}: there is no {} on a frame of both",
                        limit.metric.name
                    ),
                    "name it in --scores, if there are any; `depthloom table RUN` says what has which".to_owned(),
                ));
            };
            judged.push(limit.judge(place, contrast));
        }
        if met == 0 {
            let names: BTreeSet<&str> = pairs.iter().map(|pair| pair.other.estimator.label.as_str()).collect();
            return Err(AnalysisError::asked(
                format!("`{written}` is on nothing that is compared"),
                format!("compared are {}; was {} taken of both?", listed(names), limit.metric.name),
            ));
        }
    }
    Ok(judged)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_names_estimate_score_and_change() {
        let of = |text: &str| {
            let Limit { estimator, metric, is_above, is_reached, change, is_relative, .. } =
                Limit::parse(text).unwrap();
            (estimator, metric.name, is_above, is_reached, change, is_relative)
        };
        assert_eq!(of("fused.abs_rel > +1%"), (Some("fused".to_owned()), "abs_rel", true, false, 1.0, true));
        assert_eq!(of("a1<-0.005"), (None, "a1", false, false, -0.005, false));
        // A dot in a name, and in that of a score.
        assert_eq!(of("p=0.5/raw.bad_0.5 >= 2 %"), (Some("p=0.5/raw".to_owned()), "bad_0.5", true, true, 2.0, true));
        assert_eq!(of("look.mono.irmse > 0"), (Some("look.mono".to_owned()), "irmse", true, false, 0.0, false));
        for (text, what) in [
            ("fused.abs_rel", "`fused.abs_rel` has no `>` or `<`"),
            ("fused.abs_rel > much", "`much` in `fused.abs_rel > much` is no number"),
            ("fused.abs_rel > nan", "`nan` in `fused.abs_rel > nan` is no number"),
            ("fused.abs_rle > 1%", "there is no score `abs_rle`"),
        ] {
            assert_eq!(Limit::parse(text).unwrap_err().to_string(), what);
        }
    }
}
