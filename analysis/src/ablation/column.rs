//! The columns that rows have numbers in: scores, costs, counts, axes.

use depthloom_scores::{Family, Mean, Metric, Pooling};

use super::front::Better;
use super::{Ablation, Row, listed, nearest_of};
use crate::error::AnalysisError;

/// The name of the column of core-milliseconds.
const MS: &str = "ms";
/// The columns that are no scores, the last three of rows of a depth and its disparity.
const OTHERS: [&str; 7] =
    ["density", MS, "frames", "pixels", "disparity_density", "disparity_frames", "disparity_pixels"];

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Column {
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
    const fn of(self, row: &Row) -> Option<&Row> {
        match (self, &row.joined) {
            (Self::Own, _) => Some(row),
            (Self::Disparity, Some(disparity)) => Some(disparity),
            (Self::Disparity, None) => None,
        }
    }
}

impl Column {
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
    pub(super) fn column(&self, name: &str) -> Result<Column, AnalysisError> {
        match name {
            "density" => return Ok(Column::Density(Part::Own)),
            "disparity_density" => return Ok(Column::Density(Part::Disparity)),
            MS => return Ok(Column::Ms),
            "frames" => return Ok(Column::Frames(Part::Own)),
            "disparity_frames" => return Ok(Column::Frames(Part::Disparity)),
            "pixels" => return Ok(Column::Pixels(Part::Own)),
            "disparity_pixels" => return Ok(Column::Pixels(Part::Disparity)),
            _ => {}
        }
        if let Some(axis) = self.axes.iter().position(|axis| axis.name == name) {
            return Ok(Column::Axis(axis));
        }
        if Metric::named(name).is_some() {
            return self.metric(name).map(Column::Metric);
        }
        let axes = self.axes.iter().map(|axis| axis.name.as_str());
        let scores = self.metrics.iter().map(|metric| metric.name);
        let known: Vec<&str> = axes.clone().chain(scores).chain(self.others().iter().copied()).collect();
        let help = nearest_of(name, known).unwrap_or_else(|| {
            let axes = if self.axes.is_empty() { String::new() } else { format!("axes {}, ", listed(axes)) };
            format!("there are {axes}scores {}, and {}", listed(self.metric_names()), listed(self.others().to_vec()))
        });
        Err(AnalysisError::asked(format!("there is no column `{name}`"), help))
    }

    /// The columns that are no scores.
    pub(super) fn others(&self) -> &'static [&'static str] {
        let has = |family: Family| self.metrics.iter().any(|metric| family.metrics().contains(metric));
        if has(Family::Depth) && has(Family::Disparity) { &OTHERS } else { &OTHERS[..4] }
    }

    /// The column of that name, of which less or more is better; `use_of` says what it is wanted for.
    pub(super) fn measure(&self, name: &str, use_of: &str) -> Result<Column, AnalysisError> {
        let column = self.column(name)?;
        if column.is_axis() {
            return Err(AnalysisError::asked(
                format!("`{name}` is an axis: neither way of it is better"),
                format!(
                    "{use_of} of scores ({}) and of {}",
                    listed(self.metric_names()),
                    listed(self.others().to_vec())
                ),
            ));
        }
        Ok(column)
    }

    pub(super) fn column_name(&self, column: Column) -> &str {
        match column {
            Column::Axis(axis) => &self.axes[axis].name,
            Column::Metric(metric) => self.metrics[metric].name,
            Column::Density(Part::Own) => "density",
            Column::Density(Part::Disparity) => "disparity_density",
            Column::Ms => MS,
            Column::Frames(Part::Own) => "frames",
            Column::Frames(Part::Disparity) => "disparity_frames",
            Column::Pixels(Part::Own) => "pixels",
            Column::Pixels(Part::Disparity) => "disparity_pixels",
        }
    }

    /// A row's number in a column.
    pub(super) fn number(&self, row: &Row, column: Column) -> Option<f64> {
        match column {
            Column::Axis(axis) => self.level(row, axis).map(|level| level as f64),
            Column::Metric(metric) => row.value(metric),
            Column::Density(part) => part.of(row)?.density,
            Column::Ms => row.core_ms,
            Column::Frames(_) | Column::Pixels(_) => column.count(row).map(|count| count as f64),
        }
    }

    /// Which way a column is better; of an axis, its order.
    pub(super) fn better(&self, column: Column) -> Better {
        match column {
            Column::Axis(_) | Column::Ms => Better::Less,
            Column::Metric(metric) if !self.metrics[metric].more_is_better => Better::Less,
            Column::Metric(_) | Column::Density(_) | Column::Frames(_) | Column::Pixels(_) => Better::More,
        }
    }

    /// How many decimals of a column are shown.
    pub(super) fn decimals(&self, column: Column) -> usize {
        match column {
            // Variants differ by less than methods do.
            Column::Metric(metric) => self.metrics[metric].decimals + 1,
            Column::Density(_) => 4,
            Column::Ms => 2,
            Column::Axis(_) | Column::Frames(_) | Column::Pixels(_) => 1,
        }
    }

    /// An error where no row has a value in a column that was asked for.
    pub(super) fn require(&self, rows: &[Row], column: Column) -> Result<(), AnalysisError> {
        if rows.iter().any(|row| self.number(row, column).is_some()) {
            return Ok(());
        }
        let name = self.column_name(column);
        let (what, help) = match column {
            Column::Ms => (
                "core-milliseconds of these estimates are not known".to_owned(),
                "they come from `timings.parquet`, which a run leaves beside its recording: name the run's folder, or run again",
            ),
            Column::Density(Part::Own) => (
                "how many pixels were answered was not recorded".to_owned(),
                "recordings of earlier versions do not hold it: run again",
            ),
            Column::Density(Part::Disparity) | Column::Frames(Part::Disparity) | Column::Pixels(Part::Disparity) => (
                format!("no row has a value of `{name}`"),
                "rows have it that are of a depth and of the disparity it was made of by `depth/from-disparity`, where both are scored",
            ),
            Column::Metric(metric) => {
                let asked: Vec<&Row> =
                    rows.iter().filter(|row| self.estimator(row).metrics.contains(&self.metrics[metric])).collect();
                let has_pixels = asked.iter().any(|row| row.pixels > 0);
                let pooled = asked.iter().all(|row| row.mean == Mean::Pixels);
                if asked.is_empty() {
                    let family = match self.metrics[metric] {
                        of if Family::Depth.metrics().contains(of) => "depths",
                        _ => "disparities",
                    };
                    let help = format!("it is a score of {family}: choose other --estimators");
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
            Column::Axis(_) | Column::Frames(Part::Own) | Column::Pixels(Part::Own) => (
                format!("no row has a value of `{name}`"),
                "the selected estimates are of no variant: choose other --estimators",
            ),
        };
        Err(AnalysisError::asked(what, help.to_owned()))
    }
}
