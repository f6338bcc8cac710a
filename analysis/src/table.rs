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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use depthloom_scores::{ScoreRow, Settings};

    use super::*;

    fn estimator(variant: Option<&str>, name: &str, sets: &[PixelSet]) -> Estimator {
        Estimator {
            label: variant.map_or_else(|| name.to_owned(), |variant| format!("{variant}/{name}")),
            name: name.to_owned(),
            variant: variant.map(str::to_owned),
            run: 0,
            sets: sets.to_vec(),
            settings: Settings::default(),
            score_topic: None,
            estimate_topic: None,
            truth_topic: None,
        }
    }

    fn estimators() -> Vec<Estimator> {
        vec![
            estimator(None, "stereo", &[PixelSet::Answered, PixelSet::All]),
            estimator(Some("full"), "mono", &[PixelSet::All]),
            estimator(Some("full"), "fused", &[PixelSet::All]),
            estimator(Some("no_scaling"), "mono", &[PixelSet::All]),
            estimator(Some("no_scaling"), "fused", &[PixelSet::All]),
        ]
    }

    /// A score of frame `frame` for which all eight scores are `value`, but for rmse, which is ten times it.
    fn score(frame: &str, estimator: usize, set: PixelSet, value: f64) -> FrameScore {
        let [a1, a2, a3, abs_rel, sq_rel, rmse_log, silog] = [value; 7];
        let row = ScoreRow { set, pixels: 5, a1, a2, a3, abs_rel, sq_rel, rmse: 10.0 * value, rmse_log, silog };
        FrameScore { frame: Arc::from(frame), estimator, row }
    }

    fn scores() -> Vec<FrameScore> {
        let mut scores = Vec::new();
        for (frame, shift) in [("0", 0.0), ("1", 0.2)] {
            scores.push(score(frame, 0, PixelSet::Answered, 0.7 + shift));
            for (estimator, value) in [0.3, 0.4, 0.5, 0.6, 0.7].into_iter().enumerate() {
                scores.push(score(frame, estimator, PixelSet::All, value + shift));
            }
        }
        scores
    }

    fn table(with_paper: bool) -> Table {
        Table::new(&scores(), &estimators(), with_paper).unwrap()
    }

    #[test]
    fn means_are_over_the_frames_that_all_estimators_have() {
        let mut scores = scores();
        // On frame 2 an estimator failed: it counts for nobody.
        scores.extend((0..4).map(|estimator| score("2", estimator, PixelSet::All, 0.0)));
        let table = Table::new(&scores, &estimators(), false).unwrap();
        assert_eq!(table.columns.len(), 6);
        for (column, mean) in table.columns.iter().zip([0.8, 0.4, 0.5, 0.6, 0.7, 0.8]) {
            assert_eq!(column.frames, 2);
            assert!((column.means[0].unwrap() - mean).abs() < 1e-12, "{column:?}");
            assert!((column.means[5].unwrap() - 10.0 * mean).abs() < 1e-12, "{column:?}");
        }
        assert_eq!(table.about(), "mean over 2 frames");
    }

    #[test]
    fn a_frame_without_pixels_adds_nothing_and_is_said() {
        let mut scores = scores();
        scores[0].row = ScoreRow { pixels: 0, ..score("0", 0, PixelSet::Answered, f64::NAN).row };
        let table = Table::new(&scores, &estimators(), false).unwrap();
        assert_eq!((table.columns[0].frames, table.columns[1].frames), (1, 2));
        assert!((table.columns[0].means[0].unwrap() - 0.9).abs() < 1e-12);
        assert_eq!(table.about(), "mean over 2 frames (stereo on answered: 1)");
    }

    #[test]
    fn no_scores_make_a_table_of_dashes() {
        let table = Table::new(&[], &estimators(), false).unwrap();
        assert!(table.columns.iter().all(|column| column.frames == 0 && column.means == [None; 8]));
        assert_eq!(table.cell(0, 0), "-");
        assert_eq!(table.best(0), None);
    }

    #[test]
    fn the_long_form_is_sorted_as_the_oracles() {
        let long = table(true).long_form().unwrap();
        let names: Vec<String> = long.get_column_names().iter().map(ToString::to_string).collect();
        let mut expected = vec!["estimator".to_owned(), "scored_on".to_owned()];
        expected.extend(SCORE_NAMES.map(str::to_owned));
        expected.push("frames".to_owned());
        expected.extend(SCORE_NAMES.map(|name| format!("paper_{name}")));
        assert_eq!(names, expected);
        let labels: Vec<_> = long.column("estimator").unwrap().str().unwrap().iter().map(Option::unwrap).collect();
        assert_eq!(labels, ["full/fused", "full/mono", "no_scaling/fused", "no_scaling/mono", "stereo", "stereo"]);
        assert_eq!(long.column("paper_a1").unwrap().f64().unwrap().get(2), Some(0.85));
    }

    #[test]
    fn best_is_among_those_over_all_pixels() {
        let table = table(false);
        assert_eq!((table.best(0), table.best(5)), (Some(5), Some(1)));
    }

    #[test]
    fn terminal_text() {
        insta::assert_snapshot!("terminal", table(false).terminal(200));
        insta::assert_snapshot!("terminal_narrow_with_paper", table(true).terminal(70));
    }

    #[test]
    fn markdown_text() {
        insta::assert_snapshot!("markdown", table(true).markdown());
    }

    #[test]
    fn latex_text() {
        insta::assert_snapshot!("latex", table(true).latex());
    }
}
