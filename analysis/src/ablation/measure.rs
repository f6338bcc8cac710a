//! The measures of rows, one per column: metrics, costs, counts, axes.

use depthloom_scores::{Family, Mean, Metric, Pooling};

use super::front::Better;
use super::{Ablation, Row};
use crate::error::{AnalysisError, listed, nearest_of};

/// The measures besides axes and metrics. The last three exist only in joined rows of a depth and its disparity.
const NAMED: [(&str, Measure); 7] = [
    ("density", Measure::Density(Part::Own)),
    ("ms", Measure::Ms),
    ("frames", Measure::Frames(Part::Own)),
    ("pixels", Measure::Pixels(Part::Own)),
    ("disparity_density", Measure::Density(Part::Disparity)),
    ("disparity_frames", Measure::Frames(Part::Disparity)),
    ("disparity_pixels", Measure::Pixels(Part::Disparity)),
];

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measure {
    Axis(usize),
    Metric(usize),
    Density(Part),
    Ms,
    Frames(Part),
    Pixels(Part),
}

/// The part of a joined row whose pixels are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// The row's own pixels; in a joined row, those of the depth.
    Own,
    /// The pixels of the disparity.
    Disparity,
}

impl Part {
    fn row(self, row: &Row) -> Option<&Row> {
        match self {
            Self::Own => Some(row),
            Self::Disparity => row.joined.as_deref(),
        }
    }
}

impl Measure {
    pub(super) const fn is_axis(self) -> bool {
        matches!(self, Self::Axis(_))
    }

    pub(super) const fn metric(self) -> Option<usize> {
        match self {
            Self::Metric(metric) => Some(metric),
            _ => None,
        }
    }

    /// Whether it is a measure of the disparity in a joined row.
    pub(super) const fn is_of_disparity(self) -> bool {
        matches!(self, Self::Density(Part::Disparity) | Self::Frames(Part::Disparity) | Self::Pixels(Part::Disparity))
    }

    /// The number of frames or pixels of a row.
    pub(super) fn count(self, row: &Row) -> Option<u64> {
        match self {
            Self::Frames(part) => part.row(row).map(|row| row.frames),
            Self::Pixels(part) => part.row(row).map(|row| row.pixels),
            _ => None,
        }
    }
}

impl Ablation<'_> {
    /// The measure with this name.
    pub(super) fn measure(&self, name: &str) -> Result<Measure, AnalysisError> {
        if let Some((_, measure)) = NAMED.iter().find(|(known, _)| *known == name) {
            return Ok(*measure);
        }
        if let Some(axis) = self.axes.iter().position(|axis| axis.name == name) {
            return Ok(Measure::Axis(axis));
        }
        if Metric::named(name).is_some() {
            return self.metric(name).map(Measure::Metric);
        }
        let axes = self.axes.iter().map(|axis| axis.name.as_str());
        let scores = self.metrics.iter().map(|metric| metric.name);
        let known: Vec<&str> = axes.clone().chain(scores).chain(self.others()).collect();
        let help = nearest_of(name, known).unwrap_or_else(|| {
            let axes = if self.axes.is_empty() { String::new() } else { format!("axes {}, ", listed(axes)) };
            format!("available: {axes}metrics {}, and {}", listed(self.metric_names()), listed(self.others()))
        });
        Err(AnalysisError::request(format!("there is no column `{name}`"), help))
    }

    /// The measures besides axes and metrics that rows may have.
    fn others(&self) -> impl Iterator<Item = &str> + Clone {
        let has = |family: Family| self.metrics.iter().any(|metric| family.metrics().contains(metric));
        let count = if has(Family::Depth) && has(Family::Disparity) { NAMED.len() } else { 4 };
        NAMED.iter().take(count).map(|(name, _)| *name)
    }

    /// The measure with this name, which must have a better direction; `purpose` is the option or table that needs it.
    pub(super) fn goal_measure(&self, name: &str, purpose: &str) -> Result<Measure, AnalysisError> {
        let column = self.measure(name)?;
        if column.is_axis() {
            return Err(AnalysisError::request(
                format!("`{name}` is an axis: it has no better direction"),
                format!(
                    "{purpose} needs a metric ({}) or one of {}",
                    listed(self.metric_names()),
                    listed(self.others())
                ),
            ));
        }
        Ok(column)
    }

    pub(super) fn measure_name(&self, column: Measure) -> &str {
        match column {
            Measure::Axis(axis) => &self.axes[axis].name,
            Measure::Metric(metric) => self.metrics[metric].name,
            other => NAMED.iter().find(|(_, measure)| *measure == other).map_or("", |(name, _)| name),
        }
    }

    /// The number of a row in a column.
    pub(super) fn number(&self, row: &Row, column: Measure) -> Option<f64> {
        match column {
            Measure::Axis(axis) => self.level(row, axis).map(|level| level as f64),
            Measure::Metric(metric) => row.value(metric),
            Measure::Density(part) => part.row(row)?.density,
            Measure::Ms => row.core_ms,
            Measure::Frames(_) | Measure::Pixels(_) => column.count(row).map(|count| count as f64),
        }
    }

    /// The better direction of a column; for an axis, its order.
    pub(super) fn better(&self, column: Measure) -> Better {
        match column {
            Measure::Axis(_) | Measure::Ms => Better::Less,
            Measure::Metric(metric) if !self.metrics[metric].more_is_better => Better::Less,
            Measure::Metric(_) | Measure::Density(_) | Measure::Frames(_) | Measure::Pixels(_) => Better::More,
        }
    }

    /// The number of decimals that are shown.
    pub(super) fn decimals(&self, column: Measure) -> usize {
        match column {
            // Differences between variants are smaller than those between methods.
            Measure::Metric(metric) => self.metrics[metric].decimals + 1,
            Measure::Density(_) => 4,
            Measure::Ms => 2,
            Measure::Axis(_) | Measure::Frames(_) | Measure::Pixels(_) => 1,
        }
    }

    /// Returns an error if no row has a value in a requested column.
    pub(super) fn require(&self, rows: &[Row], column: Measure) -> Result<(), AnalysisError> {
        if rows.iter().any(|row| self.number(row, column).is_some()) {
            return Ok(());
        }
        let name = self.measure_name(column);
        let (what, help) = match column {
            Measure::Ms if self.has_timings => (
                "no row has a value of `ms`: the values of these estimates were reused, so their nodes were not timed"
                    .to_owned(),
                "run again with `depthloom run --fresh` to time all nodes",
            ),
            Measure::Ms => (
                "no row has a value of `ms`: there are no timings".to_owned(),
                "name the run's folder, which contains `timings.parquet`, or run again",
            ),
            Measure::Density(Part::Own) => (
                "no row has a value of `density`: the number of valid pixels was not recorded".to_owned(),
                "recordings of earlier versions do not contain it: run again",
            ),
            Measure::Density(Part::Disparity) | Measure::Frames(Part::Disparity) | Measure::Pixels(Part::Disparity) => {
                (
                    format!("no row has a value of `{name}`"),
                    "score both a disparity and the depth that `depth/from-disparity` computes from it",
                )
            }
            Measure::Metric(metric) => {
                let scored: Vec<&Row> =
                    rows.iter().filter(|row| self.estimate(row).metrics.contains(&self.metrics[metric])).collect();
                let has_pixels = scored.iter().any(|row| row.pixels > 0);
                let pooled = scored.iter().all(|row| row.mean == Mean::Pixels);
                if scored.is_empty() {
                    let family = match self.metrics[metric] {
                        metric if Family::Depth.metrics().contains(metric) => "depths",
                        _ => "disparities",
                    };
                    let help = format!("it is a metric of {family}: select others with `--estimates`");
                    return Err(AnalysisError::request(
                        format!("`{name}` was not scored for the selected estimates"),
                        help,
                    ));
                }
                if has_pixels && pooled && self.metrics[metric].pooling == Pooling::None {
                    (
                        format!("`{name}` over the pixels of all frames cannot be computed from the scores of frames"),
                        "use `--mean frames`",
                    )
                } else {
                    (
                        format!("no row has a value of `{name}`"),
                        "no frame has a pixel to score: choose another `--zone` or `--pixels`",
                    )
                }
            }
            Measure::Axis(_) | Measure::Frames(Part::Own) | Measure::Pixels(Part::Own) => (
                format!("no row has a value of `{name}`"),
                "the selected estimates belong to no variant: select others with `--estimates`",
            ),
        };
        Err(AnalysisError::request(what, help.to_owned()))
    }
}
