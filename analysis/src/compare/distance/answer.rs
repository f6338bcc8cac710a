//! What was found, as it is shown and written.

use depthloom_graphs::Key;

use super::super::{CompareOptions, few_frames};
use super::{DistancePair, DistanceRow, Near, Statistic};
use crate::error::{AnalysisError, caught};
use crate::grid::{Grid, GridCells, GridColumn};
use crate::statistics::Resampling;

/// Estimates held against others by distance: a row a bin, statistic and pair.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceComparison {
    pub(crate) pairs: Vec<DistancePair>,
    pub(crate) grid: Grid,
    pub(super) resampling: Resampling,
    key: Key,
}

pub(super) fn put_together(
    pairs: Vec<DistancePair>,
    mut notes: Vec<String>,
    options: &CompareOptions,
    key: Key,
    several_runs: bool,
) -> DistanceComparison {
    let rows: Vec<(&DistancePair, &DistanceRow)> =
        pairs.iter().flat_map(|pair| pair.rows.iter().map(move |row| (pair, row))).collect();
    let resampling = options.resampling;
    let told = pairs.iter().flat_map(|pair| told(pair, &resampling)).collect::<Vec<_>>();
    notes.splice(0..0, told);
    let least = pairs.iter().map(|pair| pair.frames).min().unwrap_or(0);
    notes.extend(few_frames(least));
    let titles: Vec<String> =
        pairs.iter().map(|pair| format!("{} against {}", pair.estimates[1].title, pair.estimates[0].title)).collect();
    let level = 1.0 - resampling.confidence;
    let about = format!(
        "absolute error by true distance, metres, {}: pixels that both answered; interval of the difference: {}; p_holm: Wilcoxon signed rank over \
         frames, two-sided, corrected for the bins of a statistic; verdict: p_holm below {} and an interval without 0",
        titles.join(", "),
        resampling.about(),
        (level * 1e8).round() / 1e8
    );
    let starts: Vec<usize> = (0..rows.len())
        .filter(|&at| {
            let of = |at: usize| (rows[at].0 as *const DistancePair, rows[at].1.statistic);
            at == 0 || of(at) != of(at - 1)
        })
        .collect();
    let gaps = starts.iter().copied().filter(|at| *at > 0).collect();
    let columns = columns(&rows, several_runs, pairs.len() > 1, &resampling);
    let label = "compared-by-distance".to_owned();
    let grid = Grid { about, label, caption: None, columns, gaps, starts, notes };
    DistanceComparison { pairs, grid, resampling, key }
}

/// Where one hands over to the other, in words.
fn told(pair: &DistancePair, resampling: &Resampling) -> Vec<String> {
    let [baseline, other] = &pair.estimates;
    let of_statistic = |(statistic, handover): &(Statistic, Option<super::Handover>)| {
        let by = statistic.name();
        let Some(of) = handover else {
            return format!(
                "by the {by}, neither of {} and {} should hand over to the other: one alone is best at all distances together",
                baseline.title, other.title
            );
        };
        let (near, far) = match of.near {
            Near::Baseline => (&baseline.title, &other.title),
            Near::Other => (&other.title, &baseline.title),
        };
        let interval = match of.interval {
            Some(interval) => format!(" ({} from {:.1} to {:.1} m", resampling.level(), interval.low, interval.high),
            None => " (".to_owned(),
        };
        let share = if of.share < 1.0 { format!(", in {:.0} % of resamples", 100.0 * of.share) } else { String::new() };
        let crossings = match of.crossings_m.len() {
            0 | 1 => String::new(),
            count => format!("; the difference crosses zero {count} times"),
        };
        let sure = match (of.interval, of.share < 1.0) {
            (None, _) => String::new(),
            (Some(_), _) => format!("{interval}{share})"),
        };
        format!("by the {by}, {near} hands over to {far} at {:.1} m{sure}{crossings}", of.distance_m)
    };
    pair.handovers.iter().map(of_statistic).collect()
}

fn columns(
    rows: &[(&DistancePair, &DistanceRow)],
    several_runs: bool,
    several_pairs: bool,
    resampling: &Resampling,
) -> Vec<GridColumn> {
    type Of<'a> = (&'a DistancePair, &'a DistanceRow);
    let text = |of: &dyn Fn(Of<'_>) -> Option<String>| rows.iter().map(|row| of(*row)).collect::<Vec<_>>();
    let in_files = |name: &str, of: &dyn Fn(Of<'_>) -> Option<String>| GridColumn {
        only_in_files: true,
        ..GridColumn::key(name, text(of))
    };
    let count = |name: &str, unit: &'static str, of: &dyn Fn(Of<'_>) -> u64| {
        let cells = GridCells::Count(rows.iter().map(|row| Some(of(*row))).collect());
        GridColumn { unit: Some(unit), ..GridColumn::of(name, cells) }
    };
    let metres = |name: &str, decimals: usize, of: &dyn Fn(Of<'_>) -> Option<f64>| {
        let values: Vec<Option<f64>> = rows.iter().map(|row| of(*row)).collect();
        let best = vec![false; values.len()];
        GridColumn { unit: Some("m"), ..GridColumn::of(name, GridCells::Number { decimals, values, best }) }
    };
    let hidden = |column: GridColumn| GridColumn { only_in_files: true, ..column };
    let in_text = |name: String, of: &dyn Fn(Of<'_>) -> String| GridColumn {
        only_in_text: true,
        ..GridColumn::of(name, GridCells::Text(text(&|row| Some(of(row)))))
    };
    let decimals = usize::from(rows.iter().any(|(_, row)| row.from_m.fract() != 0.0 || row.to_m.fract() != 0.0)) * 2;
    let mut columns = vec![
        in_files("stage", &|(pair, _)| Some(pair.estimates[1].stage.clone())),
        in_files("variant", &|(pair, _)| pair.estimates[1].variant.clone()),
        in_files("estimator", &|(pair, _)| Some(pair.estimates[1].estimator.clone())),
        in_files("run", &|(pair, _)| Some(pair.estimates[1].run.clone())),
        in_files("baseline_run", &|(pair, _)| Some(pair.estimates[0].run.clone())),
        in_files("baseline_stage", &|(pair, _)| Some(pair.estimates[0].stage.clone())),
        in_files("baseline_variant", &|(pair, _)| pair.estimates[0].variant.clone()),
        in_files("baseline_estimator", &|(pair, _)| Some(pair.estimates[0].estimator.clone())),
    ];
    if several_pairs || several_runs {
        let title = |(pair, _): Of<'_>| Some(pair.estimates[1].title.clone());
        columns.push(GridColumn { once: true, only_in_text: true, ..GridColumn::key("other", text(&title)) });
    }
    columns.push(GridColumn {
        once: true,
        ..GridColumn::key("statistic", text(&|(_, row)| Some(row.statistic.name().to_owned())))
    });
    columns.extend([
        GridColumn { is_key: true, ..metres("bin_from_m", decimals, &|(_, row)| Some(row.from_m)) },
        GridColumn { is_key: true, ..metres("bin_to_m", decimals, &|(_, row)| Some(row.to_m)) },
        count("pixels", "pixels", &|(_, row)| row.pixels),
        count("frames", "frames", &|(_, row)| row.frames as u64),
        metres("baseline_m", 3, &|(_, row)| Some(row.baseline_m)),
        metres("value_m", 3, &|(_, row)| Some(row.value_m)),
        metres("difference_m", 3, &|(_, row)| Some(row.difference_m())),
        in_text(format!("{} interval", resampling.level()), &|(_, row)| match row.interval {
            Some(of) => format!("[{:+.3}, {:+.3}]", of.low, of.high),
            None => "-".to_owned(),
        }),
        hidden(metres("difference_low_m", 3, &|(_, row)| row.interval.map(|of| of.low))),
        hidden(metres("difference_high_m", 3, &|(_, row)| row.interval.map(|of| of.high))),
        hidden(count("wins", "frames", &|(_, row)| row.wins)),
        hidden(count("ties", "frames", &|(_, row)| row.ties)),
        hidden(count("losses", "frames", &|(_, row)| row.losses)),
        in_text("+/=/-".to_owned(), &|(_, row)| format!("{}/{}/{}", row.wins, row.ties, row.losses)),
    ]);
    let p = |name: &str, of: &dyn Fn(&DistanceRow) -> Option<f64>| {
        let values: Vec<Option<f64>> = rows.iter().map(|(_, row)| of(row)).collect();
        let texts = values.iter().map(|p| p.map(|p| if p < 1e-4 { format!("{p:.0e}") } else { format!("{p:.4}") }));
        let texts = texts.collect();
        let unit = Some(crate::sheet::DIMENSIONLESS);
        GridColumn { unit, ..GridColumn::of(name, GridCells::Written { values, texts }) }
    };
    columns.push(hidden(p("p", &|row| row.test.map(|test| test.p))));
    let from = |row: &DistanceRow| row.test.map(|test| test.distribution.name().to_owned());
    columns.push(hidden(GridColumn::of("p_from", GridCells::Text(text(&|(_, row)| from(row))))));
    columns.push(p("p_holm", &|row| row.p_holm));
    let verdict = text(&|(_, row)| Some(row.verdict.name().to_owned()));
    columns.push(GridColumn::of("verdict", GridCells::Text(verdict)));
    columns
}

impl DistanceComparison {
    /// As aligned text; where it is wider than `width` columns, in blocks below each other.
    #[must_use]
    pub fn terminal(&self, width: usize) -> String {
        self.grid.terminal(width)
    }

    /// In Markdown (GitHub's).
    #[must_use]
    pub fn markdown(&self) -> String {
        self.grid.markdown()
    }

    /// In LaTeX, for the package `booktabs`.
    #[must_use]
    pub fn latex(&self) -> String {
        self.grid.latex()
    }

    /// As CSV: all digits, an empty field where there is no value.
    #[must_use]
    pub fn csv(&self) -> Vec<u8> {
        self.grid.sheet().csv()
    }

    /// The bytes of a Parquet file with the columns of [`DistanceComparison::csv`].
    ///
    /// # Errors
    /// If polars makes none of them.
    pub fn parquet(&self) -> Result<Vec<u8>, AnalysisError> {
        caught(|| self.grid.sheet().parquet("asked", &self.key).map_err(AnalysisError::compute("the table")))
    }
}
