//! The measures of rows, each a column: scores, costs, counts, axes.

use depthloom_scores::{Family, Mean, Metric, Pooling};

use super::front::Better;
use super::{Ablation, Row};
use crate::error::{AnalysisError, listed, nearest_of};

/// The measures besides axes and metrics, the last three of rows of a depth and its disparity.
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

/// Whose pixels are counted in a row of a depth and its disparity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// The row's own; of such a row, the depth's.
    Own,
    /// The disparity's.
    Disparity,
}

impl Part {
    fn of(self, row: &Row) -> Option<&Row> {
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

    /// Whether it is of the disparity in a row of a depth and its disparity.
    pub(super) const fn is_of_disparity(self) -> bool {
        matches!(self, Self::Density(Part::Disparity) | Self::Frames(Part::Disparity) | Self::Pixels(Part::Disparity))
    }

    /// A row's count of frames or pixels.
    pub(super) fn count(self, row: &Row) -> Option<u64> {
        match self {
            Self::Frames(part) => part.of(row).map(|row| row.frames),
            Self::Pixels(part) => part.of(row).map(|row| row.pixels),
            _ => None,
        }
    }
}

impl Ablation<'_> {
    /// The column of that name.
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
            format!("there are {axes}scores {}, and {}", listed(self.metric_names()), listed(self.others()))
        });
        Err(AnalysisError::asked(format!("there is no column `{name}`"), help))
    }

    /// The measures besides axes and metrics that rows may have.
    fn others(&self) -> impl Iterator<Item = &str> + Clone {
        let has = |family: Family| self.metrics.iter().any(|metric| family.metrics().contains(metric));
        let count = if has(Family::Depth) && has(Family::Disparity) { NAMED.len() } else { 4 };
        NAMED.iter().take(count).map(|(name, _)| *name)
    }

    /// The column of that name, of which less or more is better; `use_of` says what it is wanted for.
    pub(super) fn goal_measure(&self, name: &str, use_of: &str) -> Result<Measure, AnalysisError> {
        let column = self.measure(name)?;
        if column.is_axis() {
            return Err(AnalysisError::asked(
                format!("`{name}` is an axis: neither way of it is better"),
                format!("{use_of} of scores ({}) and of {}", listed(self.metric_names()), listed(self.others())),
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

    /// A row's number in a column.
    pub(super) fn number(&self, row: &Row, column: Measure) -> Option<f64> {
        match column {
            Measure::Axis(axis) => self.level(row, axis).map(|level| level as f64),
            Measure::Metric(metric) => row.value(metric),
            Measure::Density(part) => part.of(row)?.density,
            Measure::Ms => row.core_ms,
            Measure::Frames(_) | Measure::Pixels(_) => column.count(row).map(|count| count as f64),
        }
    }

    /// Which way a column is better; of an axis, its order.
    pub(super) fn better(&self, column: Measure) -> Better {
        match column {
            Measure::Axis(_) | Measure::Ms => Better::Less,
            Measure::Metric(metric) if !self.metrics[metric].more_is_better => Better::Less,
            Measure::Metric(_) | Measure::Density(_) | Measure::Frames(_) | Measure::Pixels(_) => Better::More,
        }
    }

    /// How many decimals of a column are shown.
    pub(super) fn decimals(&self, column: Measure) -> usize {
        match column {
            // Variants differ by less than methods do.
            Measure::Metric(metric) => self.metrics[metric].decimals + 1,
            Measure::Density(_) => 4,
            Measure::Ms => 2,
            Measure::Axis(_) | Measure::Frames(_) | Measure::Pixels(_) => 1,
        }
    }

    /// An error where no row has a value in a column that was asked for.
    pub(super) fn require(&self, rows: &[Row], column: Measure) -> Result<(), AnalysisError> {
        if rows.iter().any(|row| self.number(row, column).is_some()) {
            return Ok(());
        }
        let name = self.measure_name(column);
        let (what, help) = match column {
            Measure::Ms if self.has_timings => (
                "no row has a value of `ms`: nodes of these estimates did not run, because their values were reused"
                    .to_owned(),
                "`depthloom run --fresh` recomputes and times them",
            ),
            Measure::Ms => (
                "core-milliseconds of these estimates are not known".to_owned(),
                "they come from `timings.parquet`, which a run leaves beside its recording: name the run's folder, or run again",
            ),
            Measure::Density(Part::Own) => (
                "the number of valid pixels was not recorded".to_owned(),
                "recordings of earlier versions do not hold it: run again",
            ),
            Measure::Density(Part::Disparity) | Measure::Frames(Part::Disparity) | Measure::Pixels(Part::Disparity) => {
                (
                    format!("no row has a value of `{name}`"),
                    "rows have it that are of a depth and of the disparity it was made of by `depth/from-disparity`, where both are scored",
                )
            }
            Measure::Metric(metric) => {
                let asked: Vec<&Row> =
                    rows.iter().filter(|row| self.estimate(row).metrics.contains(&self.metrics[metric])).collect();
                let has_pixels = asked.iter().any(|row| row.pixels > 0);
                let pooled = asked.iter().all(|row| row.mean == Mean::Pixels);
                if asked.is_empty() {
                    let family = match self.metrics[metric] {
                        of if Family::Depth.metrics().contains(of) => "depths",
                        _ => "disparities",
                    };
                    let help = format!("it is a score of {family}: choose other --estimates");
                    return Err(AnalysisError::asked(
                        format!("`{name}` was not taken of the selected estimates"),
                        help,
                    ));
                }
                if has_pixels && pooled && self.metrics[metric].pooling == Pooling::None {
                    (
                        format!("`{name}` over the pixels of all frames does not follow from the frames' scores"),
                        "take `--mean frames`",
                    )
                } else {
                    (
                        format!("no row has a value of `{name}`"),
                        "no frame had a pixel to score there: choose another --zone or --set",
                    )
                }
            }
            Measure::Axis(_) | Measure::Frames(Part::Own) | Measure::Pixels(Part::Own) => (
                format!("no row has a value of `{name}`"),
                "the selected estimates are of no variant: choose other --estimates",
            ),
        };
        Err(AnalysisError::asked(what, help.to_owned()))
    }
}
