//! Table I: the mean over frames of every score, by variant and estimator.

mod latex;
mod markdown;
mod terminal;

use std::collections::{HashMap, HashSet};

use depthloom_scores::{PixelSet, SCORE_NAMES};
use polars::frame::DataFrame;
use polars::prelude::{Column, IntoLazy, NamedFrom, Series, col};

use crate::error::AnalysisError;
use crate::estimators::Estimator;
use crate::paper::paper_scores;
use crate::scores::{FrameScore, null_if_nan};

/// The mean over frames, a column an estimator and pixel set.
///
/// The mean is the unweighted one of the frames' scores (monodepth, the KITTI devkits), over the frames that have scores of all
/// estimators of their stage run. A frame on which a score has no pixel adds nothing to that score's mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The columns, in the order they are shown.
    pub columns: Vec<TableColumn>,
    /// Whether the paper's numbers stand beside ours.
    pub with_paper: bool,
}

/// An estimator on a pixel set.
#[derive(Clone, Debug, PartialEq)]
pub struct TableColumn {
    /// The variant, or the estimator itself where all variants share it: what the column stands under.
    pub group: String,
    /// Its name under the group.
    pub name: String,
    /// The estimator.
    pub estimator: String,
    /// The pixels scored over.
    pub set: PixelSet,
    /// How many frames the mean is over.
    pub frames: u64,
    /// The means, in the order of [`SCORE_NAMES`]; `None` if no frame had a pixel to score.
    pub means: [Option<f64>; 8],
    /// The paper's numbers, where it gives them.
    pub paper: Option<[f64; 8]>,
}

/// A score's row: how it is called where there is room, which way is better, and how many decimals are worth showing.
pub(crate) struct Line {
    pub(crate) plain: &'static str,
    pub(crate) latex: &'static str,
    pub(crate) more_is_better: bool,
    pub(crate) decimals: usize,
}

/// The rows, in the order of [`SCORE_NAMES`], called as in the paper.
pub(crate) const LINES: [Line; 8] = [
    Line { plain: "a1 (< 1.25)", latex: r"threshold $\delta < 1.25$", more_is_better: true, decimals: 3 },
    Line { plain: "a2 (< 1.25^2)", latex: r"threshold $\delta < 1.25^2$", more_is_better: true, decimals: 3 },
    Line { plain: "a3 (< 1.25^3)", latex: r"threshold $\delta < 1.25^3$", more_is_better: true, decimals: 3 },
    Line { plain: "abs_rel", latex: "abs relative difference", more_is_better: false, decimals: 3 },
    Line { plain: "sq_rel", latex: "sqr relative difference", more_is_better: false, decimals: 2 },
    Line { plain: "rmse", latex: "RMSE (linear)", more_is_better: false, decimals: 2 },
    Line { plain: "rmse_log", latex: "RMSE (log)", more_is_better: false, decimals: 3 },
    Line { plain: "silog", latex: "RMSE (log, scale inv.)", more_is_better: false, decimals: 3 },
];

impl Table {
    /// Takes the means of the scores per frame.
    pub(crate) fn new(
        scores: &[FrameScore],
        estimators: &[Estimator],
        with_paper: bool,
    ) -> Result<Self, AnalysisError> {
        let means = means(scores, estimators)?;
        let mut columns = Vec::new();
        for (index, estimator) in estimators.iter().enumerate() {
            let mut sets = estimator.sets.clone();
            // "Non-occ only" stands before "Incl Occ".
            sets.sort_by_key(|set| std::cmp::Reverse(*set));
            let several = sets.len() > 1;
            for set in sets {
                let (group, name) = match (&estimator.variant, several || set != PixelSet::All) {
                    (Some(variant), false) => (variant.clone(), estimator.name.clone()),
                    (Some(variant), true) => (variant.clone(), format!("{} {set}", estimator.name)),
                    (None, _) => (estimator.label.clone(), set.to_string()),
                };
                let (frames, means) = means.get(&(index, set)).copied().unwrap_or((0, [None; 8]));
                let paper = if with_paper { paper_scores(estimator, set) } else { None };
                columns.push(TableColumn {
                    group,
                    name,
                    estimator: estimator.label.clone(),
                    set,
                    frames,
                    means,
                    paper,
                });
            }
        }
        Ok(Self { columns, with_paper })
    }

    /// The table for a terminal: aligned text, the best of the set `all` marked by `*`, blocks of at most `width` columns of text.
    #[must_use]
    pub fn terminal(&self, width: usize) -> String {
        terminal::render(self, width)
    }

    /// The table in Markdown (GitHub's), the best of the set `all` in bold.
    #[must_use]
    pub fn markdown(&self) -> String {
        markdown::render(self)
    }

    /// The table in LaTeX, for the packages `booktabs` and `graphicx`; the best of the set `all` in bold.
    #[must_use]
    pub fn latex(&self) -> String {
        latex::render(self)
    }

    /// The long form, a row an estimator and pixel set, sorted: `estimator, scored_on`, the eight scores, `frames`, and the
    /// paper's eight as `paper_a1 ...` where asked for.
    pub(crate) fn long_form(&self) -> Result<DataFrame, AnalysisError> {
        let mut rows: Vec<&TableColumn> = self.columns.iter().collect();
        rows.sort_by(|a, b| (&a.estimator, a.set).cmp(&(&b.estimator, b.set)));
        let texts = |name: &str, of: &dyn Fn(&TableColumn) -> String| {
            Column::from(Series::new(name.into(), rows.iter().map(|row| of(row)).collect::<Vec<_>>()))
        };
        let mut columns =
            vec![texts("estimator", &|row| row.estimator.clone()), texts("scored_on", &|row| row.set.to_string())];
        let floats = |name: String, of: &dyn Fn(&TableColumn) -> Option<f64>| {
            Column::from(Series::new(name.into(), rows.iter().map(|row| of(row)).collect::<Vec<_>>()))
        };
        for (i, name) in SCORE_NAMES.into_iter().enumerate() {
            columns.push(floats(name.to_owned(), &|row| row.means[i]));
        }
        columns.push(Column::from(Series::new("frames".into(), rows.iter().map(|row| row.frames).collect::<Vec<_>>())));
        for (i, name) in SCORE_NAMES.into_iter().enumerate().filter(|_| self.with_paper) {
            columns.push(floats(format!("paper_{name}"), &|row| row.paper.map(|paper| paper[i])));
        }
        DataFrame::new(rows.len(), columns).map_err(AnalysisError::compute("the table"))
    }

    /// For each row, which column is best among those over all pixels.
    pub(crate) fn best(&self, line: usize) -> Option<usize> {
        let over_all = self.columns.iter().enumerate().filter(|(_, column)| column.set == PixelSet::All);
        let scored = over_all.filter_map(|(i, column)| Some((i, column.means[line]?)));
        let better = |a: f64, b: f64| if LINES[line].more_is_better { a > b } else { a < b };
        scored.reduce(|best, other| if better(other.1, best.1) { other } else { best }).map(|(i, _)| i)
    }

    /// The text of a cell: our number, and the paper's in brackets.
    pub(crate) fn cell(&self, line: usize, column: usize) -> String {
        let (column, decimals) = (&self.columns[column], LINES[line].decimals);
        let ours = column.means[line].map_or_else(|| "-".to_owned(), |mean| format!("{mean:.decimals$}"));
        match column.paper {
            Some(paper) => format!("{ours} ({:.2})", paper[line]),
            None => ours,
        }
    }

    /// The columns in groups, as ranges: neighbours under one heading.
    pub(crate) fn groups(&self) -> Vec<std::ops::Range<usize>> {
        let mut groups: Vec<std::ops::Range<usize>> = Vec::new();
        for (i, column) in self.columns.iter().enumerate() {
            match groups.last_mut().filter(|group| self.columns[group.start].group == column.group) {
                Some(group) => group.end = i + 1,
                None => groups.push(i..i + 1),
            }
        }
        groups
    }

    /// What the numbers are, in one line.
    pub(crate) fn about(&self) -> String {
        let counts: HashSet<u64> = self.columns.iter().map(|column| column.frames).collect();
        let most = counts.iter().max().copied().unwrap_or(0);
        let frames = format!("mean over {most} frame{}", if most == 1 { "" } else { "s" });
        if counts.len() <= 1 {
            return frames;
        }
        let fewer = self.columns.iter().filter(|column| column.frames < most);
        let fewer: Vec<String> =
            fewer.map(|column| format!("{} on {}: {}", column.estimator, column.set, column.frames)).collect();
        format!("{frames} ({})", fewer.join(", "))
    }
}

type Means = HashMap<(usize, PixelSet), (u64, [Option<f64>; 8])>;

/// The mean over the frames that have rows of all estimators of their stage run, by estimator and pixel set.
fn means(scores: &[FrameScore], estimators: &[Estimator]) -> Result<Means, AnalysisError> {
    let mut rows_of_frame: HashMap<(usize, &str), usize> = HashMap::new();
    for score in scores {
        *rows_of_frame.entry((estimators[score.estimator].run, &score.frame)).or_default() += 1;
    }
    let rows_of_run = |run: usize| estimators.iter().filter(|e| e.run == run).map(|e| e.sets.len()).sum::<usize>();
    let common = |score: &&FrameScore| {
        let run = estimators[score.estimator].run;
        rows_of_frame[&(run, &*score.frame)] == rows_of_run(run)
    };
    let rows: Vec<&FrameScore> = scores.iter().filter(common).collect();
    let computed = || -> polars::prelude::PolarsResult<Means> {
        let numbers = |of: &dyn Fn(&FrameScore) -> u32| rows.iter().map(|row| of(row)).collect::<Vec<_>>();
        let mut columns = vec![
            Column::from(Series::new("estimator".into(), numbers(&|row| row.estimator as u32))),
            Column::from(Series::new("set".into(), numbers(&|row| u32::from(row.row.set == PixelSet::Answered)))),
        ];
        for (i, name) in SCORE_NAMES.into_iter().enumerate() {
            let scores: Vec<Option<f64>> = rows.iter().map(|row| null_if_nan(row.row.scores()[i])).collect();
            columns.push(Column::from(Series::new(name.into(), scores)));
        }
        let mut aggregates = vec![col("a1").count().alias("frames")];
        aggregates.extend(SCORE_NAMES.map(|name| col(name).mean()));
        let means =
            DataFrame::new(rows.len(), columns)?.lazy().group_by([col("estimator"), col("set")]).agg(aggregates);
        let means = means.collect()?;
        let (estimator, set, frames) =
            (means.column("estimator")?.u32()?, means.column("set")?.u32()?, means.column("frames")?.u32()?);
        let scores = SCORE_NAMES.map(|name| means.column(name).and_then(|column| column.f64()));
        let mut found = Means::new();
        for row in 0..means.height() {
            let (Some(estimator), Some(set), Some(frames)) = (estimator.get(row), set.get(row), frames.get(row)) else {
                continue;
            };
            let set = if set == 1 { PixelSet::Answered } else { PixelSet::All };
            let means = std::array::from_fn(|i| scores[i].as_ref().ok().and_then(|column| column.get(row)));
            found.insert((estimator as usize, set), (u64::from(frames), means));
        }
        Ok(found)
    };
    computed().map_err(AnalysisError::compute("the mean over frames"))
}
