//! Table I: the mean over frames of every score, by variant and estimator.

mod latex;
mod markdown;
mod terminal;

use std::collections::{HashMap, HashSet};

use depthloom_graphs::Key;
use depthloom_scores::{PixelSet, SCORE_NAMES, Settings};

use crate::estimators::Estimator;
use crate::paper::paper_scores;
use crate::scores::FrameScore;
use crate::sheet::{Cells, Sheet};

/// The mean over frames, a column an estimator and pixel set.
///
/// The mean is the unweighted one of the frames' scores (monodepth, the KITTI devkits), over the frames that have scores of all
/// estimators of their stage run. A frame on which a score has no pixel adds nothing to that score's mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The experiment's name.
    pub experiment: String,
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
    /// Columns of one number may be compared: over all true pixels, as many of the same frames, held against the same truth,
    /// scored in the same way. `None`: over the pixels this estimator answered, which are its own.
    pub comparable: Option<usize>,
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
    /// Takes the means of the scores per frame; `source(run, position)` is the key of a frame's source values.
    pub(crate) fn new(
        experiment: &str,
        scores: &[FrameScore],
        estimators: &[Estimator],
        with_paper: bool,
        source: &dyn Fn(usize, usize) -> Option<Key>,
    ) -> Self {
        let rows = common(scores, estimators);
        let means = means(&rows);
        let mut comparisons: Vec<Comparison<'_>> = Vec::new();
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
                let comparable = (set == PixelSet::All).then(|| {
                    let comparison = Comparison::of(index, estimator, &rows, source);
                    comparisons.iter().position(|known| *known == comparison).unwrap_or_else(|| {
                        comparisons.push(comparison);
                        comparisons.len() - 1
                    })
                });
                columns.push(TableColumn {
                    group,
                    name,
                    estimator: estimator.label.clone(),
                    set,
                    frames,
                    means,
                    comparable,
                    paper,
                });
            }
        }
        Self { experiment: experiment.to_owned(), columns, with_paper }
    }

    /// The table for a terminal: aligned text, the best of what is comparable marked by `*`, blocks of at most `width` columns of text.
    #[must_use]
    pub fn terminal(&self, width: usize) -> String {
        terminal::render(self, width)
    }

    /// The table in Markdown (GitHub's), the best of what is comparable in bold.
    #[must_use]
    pub fn markdown(&self) -> String {
        markdown::render(self)
    }

    /// The table in LaTeX, for the package `booktabs`, in the type's own size; the best of what is comparable in bold.
    #[must_use]
    pub fn latex(&self) -> String {
        latex::render(self)
    }

    /// The long form, a row an estimator and pixel set, sorted: `estimator, scored_on`, the eight scores, `frames`, and the
    /// paper's eight as `paper_a1 ...` where asked for.
    pub(crate) fn long_form(&self) -> Sheet<'_> {
        let mut rows: Vec<&TableColumn> = self.columns.iter().collect();
        rows.sort_by(|a, b| (&a.estimator, a.set).cmp(&(&b.estimator, b.set)));
        let mut table = Sheet::new()
            .with("estimator", Cells::Text(rows.iter().map(|row| row.estimator.as_str()).collect()))
            .with("scored_on", Cells::Text(rows.iter().map(|row| row.set.name()).collect()));
        for (i, name) in SCORE_NAMES.into_iter().enumerate() {
            table = table.with(name, Cells::Number(rows.iter().map(|row| row.means[i]).collect()));
        }
        table = table.with("frames", Cells::Count(rows.iter().map(|row| row.frames).collect()));
        for (i, name) in SCORE_NAMES.into_iter().enumerate().filter(|_| self.with_paper) {
            let paper = rows.iter().map(|row| row.paper.map(|paper| paper[i]));
            table = table.with(format!("paper_{name}"), Cells::Number(paper.collect()));
        }
        table
    }

    /// Whether a column is the best of a row among two or more that are comparable.
    ///
    /// What was within a factor of 1.25^3 of the truth nowhere is never best: `silog` would prefer an estimate that never answered,
    /// for a missing answer counts as one constant, and a constant has the truth's spread and no error of its own.
    pub(crate) fn is_best(&self, line: usize, column: usize) -> bool {
        const A3: usize = 2;
        let Some(comparable) = self.columns[column].comparable else { return false };
        let others = || self.columns.iter().enumerate().filter(|(_, other)| other.comparable == Some(comparable));
        let answers = |column: &TableColumn| column.means[A3].is_some_and(|share| share > 0.0);
        let scored = others().filter(|(_, other)| answers(other));
        let scored = scored.filter_map(|(i, other)| Some((i, other.means[line].filter(|mean| mean.is_finite())?)));
        let better = |a: f64, b: f64| if LINES[line].more_is_better { a > b } else { a < b };
        let best = scored.reduce(|best, other| if better(other.1, best.1) { other } else { best });
        others().count() > 1 && best.is_some_and(|(i, _)| i == column)
    }

    /// What the marked cells are; `None` if there are none.
    pub(crate) fn best_of(&self) -> Option<&'static str> {
        let mut marked = (0..LINES.len()).flat_map(|line| (0..self.columns.len()).map(move |column| (line, column)));
        marked.find(|(line, column)| self.is_best(*line, *column))?;
        let numbers: HashSet<usize> = self.columns.iter().filter_map(|column| column.comparable).collect();
        Some(if numbers.len() == 1 { "best over all true pixels" } else { "best of those over the same true pixels" })
    }

    /// The text of a cell: our number, and the paper's.
    pub(crate) fn cell(&self, line: usize, column: usize) -> (String, Option<String>) {
        let (column, decimals) = (&self.columns[column], LINES[line].decimals);
        let ours = column.means[line].map_or_else(|| "-".to_owned(), |mean| format!("{mean:.decimals$}"));
        (ours, column.paper.map(|paper| format!("({:.2})", paper[line])))
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

/// What makes columns comparable: the frames, by source, id and number of pixels, and how they were scored.
#[derive(PartialEq)]
struct Comparison<'a> {
    settings: &'a Settings,
    truth: Option<&'a str>,
    frames: Vec<(Option<Key>, &'a str, u64)>,
}

impl<'a> Comparison<'a> {
    fn of(
        index: usize,
        estimator: &'a Estimator,
        rows: &[&'a FrameScore],
        source: &dyn Fn(usize, usize) -> Option<Key>,
    ) -> Self {
        let over_all = rows.iter().filter(|score| score.estimator == index && score.row.set == PixelSet::All);
        let frame = |score: &&'a FrameScore| (source(estimator.run, score.position), &*score.frame, score.row.pixels);
        let truth = estimator.truth.as_deref();
        Self { settings: &estimator.settings, truth, frames: over_all.map(frame).collect() }
    }
}

/// The scores of the frames that have rows of all estimators of their stage run.
fn common<'a>(scores: &'a [FrameScore], estimators: &[Estimator]) -> Vec<&'a FrameScore> {
    let place = |score: &FrameScore| (estimators[score.estimator].run, score.position);
    let mut rows_of_frame: HashMap<(usize, usize), usize> = HashMap::new();
    for score in scores {
        *rows_of_frame.entry(place(score)).or_default() += 1;
    }
    let mut rows_of_run: HashMap<usize, usize> = HashMap::new();
    for estimator in estimators {
        *rows_of_run.entry(estimator.run).or_default() += estimator.sets.len();
    }
    scores.iter().filter(|score| rows_of_frame[&place(score)] == rows_of_run[&place(score).0]).collect()
}

type Means = HashMap<(usize, PixelSet), (u64, [Option<f64>; 8])>;

/// The means, and over how many frames, by estimator and pixel set.
fn means(rows: &[&FrameScore]) -> Means {
    let mut sums: HashMap<(usize, PixelSet), [(u64, f64); 8]> = HashMap::new();
    for score in rows {
        let sums = sums.entry((score.estimator, score.row.set)).or_default();
        for ((count, sum), score) in sums.iter_mut().zip(score.row.scores()).filter(|(_, score)| !score.is_nan()) {
            *count += 1;
            *sum += score;
        }
    }
    let mean = |(count, sum): (u64, f64)| (count > 0).then(|| sum / count as f64);
    sums.into_iter().map(|(key, sums)| (key, (sums[0].0, sums.map(mean)))).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use depthloom_scores::ScoreRow;

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
            estimate: None,
            truth: None,
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
        FrameScore { frame: Arc::from(frame), position: frame.parse().unwrap(), estimator, row }
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
        table_of(&scores(), &estimators(), with_paper)
    }

    fn table_of(scores: &[FrameScore], estimators: &[Estimator], with_paper: bool) -> Table {
        Table::new("street_1", scores, estimators, with_paper, &|_, _| None)
    }

    /// By line: the marked columns.
    fn marked(table: &Table) -> [Vec<usize>; 8] {
        std::array::from_fn(|line| (0..table.columns.len()).filter(|column| table.is_best(line, *column)).collect())
    }

    #[test]
    fn means_are_over_the_frames_that_all_estimators_have() {
        let mut scores = scores();
        // On frame 2 an estimator failed: it counts for nobody.
        scores.extend((0..4).map(|estimator| score("2", estimator, PixelSet::All, 0.0)));
        let table = table_of(&scores, &estimators(), false);
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
        let table = table_of(&scores, &estimators(), false);
        assert_eq!((table.columns[0].frames, table.columns[1].frames), (1, 2));
        assert!((table.columns[0].means[0].unwrap() - 0.9).abs() < 1e-12);
        assert_eq!(table.about(), "mean over 2 frames (stereo on answered: 1)");
    }

    #[test]
    fn no_scores_make_a_table_of_dashes() {
        let table = table_of(&[], &estimators(), false);
        assert!(table.columns.iter().all(|column| column.frames == 0 && column.means == [None; 8]));
        assert_eq!(table.cell(0, 0), ("-".to_owned(), None));
        assert_eq!(marked(&table), [const { Vec::<usize>::new() }; 8]);
        assert_eq!(table.best_of(), None);
    }

    #[test]
    fn the_long_form_is_sorted_as_the_oracles() {
        let mut csv = Vec::new();
        table(true).long_form().write_csv(&mut csv).unwrap();
        let csv = String::from_utf8(csv).unwrap();
        let lines: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
        let mut expected = vec!["estimator".to_owned(), "scored_on".to_owned()];
        expected.extend(SCORE_NAMES.map(str::to_owned));
        expected.push("frames".to_owned());
        expected.extend(SCORE_NAMES.map(|name| format!("paper_{name}")));
        assert_eq!(lines[0], expected);
        let labels: Vec<&str> = lines[1..].iter().map(|line| line[0]).collect();
        assert_eq!(labels, ["full/fused", "full/mono", "no_scaling/fused", "no_scaling/mono", "stereo", "stereo"]);
        assert_eq!(lines[3][11], "0.85");
    }

    #[test]
    fn best_is_among_those_over_all_pixels() {
        let marked = marked(&table(false));
        assert_eq!((&marked[0][..], &marked[5][..]), ([5].as_slice(), [1].as_slice()));
        assert_eq!(table(false).best_of(), Some("best over all true pixels"));
    }

    #[test]
    fn fault_02_frames_are_told_apart_by_their_place_and_not_by_their_id() {
        // The same frame asked for twice, and one of another street that happens to have its id.
        let mut scores = Vec::new();
        for (position, shift) in [(0, 0.0), (1, 0.0), (2, 0.3)] {
            let rows = [(0, PixelSet::Answered), (0, PixelSet::All), (1, PixelSet::All)];
            let row = |(estimator, set)| FrameScore { position, ..score("7", estimator, set, 0.3 + shift) };
            scores.extend(rows.map(row));
        }
        let table = table_of(&scores, &estimators()[..2], false);
        assert_eq!(table.about(), "mean over 3 frames");
        assert!(table.columns.iter().all(|column| (column.means[0].unwrap() - 0.4).abs() < 1e-12), "{table:?}");
    }

    #[test]
    fn fault_20_only_what_is_comparable_is_marked() {
        let none = [const { Vec::<usize>::new() }; 8];
        let two = |first: &Estimator, second: &Estimator, frames: [&[&str]; 2]| {
            let rows =
                |i: usize| frames[i].iter().map(move |frame| score(frame, i, PixelSet::All, 0.5 + 0.1 * i as f64));
            table_of(&rows(0).chain(rows(1)).collect::<Vec<_>>(), &[first.clone(), second.clone()], false)
        };
        let (mono, fused) =
            (estimator(Some("a"), "mono", &[PixelSet::All]), estimator(Some("a"), "fused", &[PixelSet::All]));
        let same = two(&mono, &fused, [&["0", "1"], &["0", "1"]]);
        assert_eq!((&marked(&same)[0][..], &marked(&same)[3][..]), ([1].as_slice(), [0].as_slice()));
        let elsewhere = Estimator { run: 1, ..fused.clone() };
        assert_eq!(
            marked(&two(&mono, &elsewhere, [&["0", "1"], &["0", "1"]])),
            marked(&same),
            "another run on the same frames"
        );
        assert_eq!(marked(&two(&mono, &elsewhere, [&["0", "1"], &["0", "2"]])), none, "other frames");
        assert_eq!(marked(&two(&mono, &elsewhere, [&["0", "1"], &["0"]])), none, "fewer frames");
        let capped = Estimator { settings: Settings { max_m: 50.0, ..fused.settings }, ..fused.clone() };
        assert_eq!(marked(&two(&mono, &capped, [&["0"], &["0"]])), none, "scored in another way");
        let other_truth = Estimator { truth: Some("/s/lidar/depth".to_owned()), ..fused };
        assert_eq!(marked(&two(&mono, &other_truth, [&["0"], &["0"]])), none, "against another truth");
        assert_eq!(
            marked(&table_of(&[score("0", 0, PixelSet::All, 0.5)], std::slice::from_ref(&mono), false)),
            none,
            "alone"
        );
        let answered = [mono.clone(), mono].map(|mono| Estimator { sets: vec![PixelSet::Answered], ..mono });
        let rows = [0, 1].map(|i| score("0", i, PixelSet::Answered, 0.5));
        assert_eq!(marked(&table_of(&rows, &answered, false)), none, "on the pixels each answered");
    }

    #[test]
    fn fault_20_sources_with_equal_ids_are_not_the_same_frames() {
        let estimators =
            [estimator(Some("a"), "mono", &[PixelSet::All]), estimator(Some("b"), "mono", &[PixelSet::All])];
        let estimators = [estimators[0].clone(), Estimator { run: 1, ..estimators[1].clone() }];
        let rows = [score("0", 0, PixelSet::All, 0.5), score("0", 1, PixelSet::All, 0.6)];
        let key = |run: usize, _: usize| Some(Key::of_content(&[run as u8]));
        let table = Table::new("x", &rows, &estimators, false, &key);
        assert_eq!(table.best_of(), None);
        assert!(table_of(&rows, &estimators, false).best_of().is_some(), "of one source they would be");
    }

    #[test]
    fn fault_42_an_estimate_that_never_answered_is_never_best() {
        let mut rows = vec![score("0", 0, PixelSet::All, 0.5), score("0", 1, PixelSet::All, 0.6)];
        // What a missing answer everywhere gives: no pixel is near, and the spread of the log error is the truth's own.
        rows.push(FrameScore {
            row: ScoreRow { a1: 0.0, a2: 0.0, a3: 0.0, silog: 0.01, ..rows[0].row },
            estimator: 2,
            ..rows[0].clone()
        });
        let estimators = ["mono", "fused", "absent"].map(|name| estimator(None, name, &[PixelSet::All]));
        assert_eq!(marked(&table_of(&rows, &estimators, false))[7], [0]);
        // And a mean that is no number is not best either, whichever way is better.
        rows[2].row = ScoreRow { a1: f64::INFINITY, silog: f64::NEG_INFINITY, ..rows[0].row };
        let marked = marked(&table_of(&rows, &estimators, false));
        assert_eq!((&marked[0][..], &marked[7][..]), ([1].as_slice(), [0].as_slice()));
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
    fn fault_38_latex_is_neither_a_poster_nor_a_hairline() {
        let names: Vec<String> = (0..48).map(|i| format!("variant_{i}")).collect();
        let of_variant =
            |name: &String| ["mono", "fused"].map(|estimate| estimator(Some(name), estimate, &[PixelSet::All]));
        let many: Vec<Estimator> = names.iter().flat_map(of_variant).collect();
        let rows: Vec<FrameScore> = (0..many.len()).map(|i| score("0", i, PixelSet::All, 0.5)).collect();
        let latex = table_of(&rows, &many, false).latex();
        assert!(!latex.contains("resizebox"));
        let blocks: Vec<usize> = latex
            .lines()
            .filter_map(|line| line.strip_prefix("\\begin{tabular}"))
            .map(|columns| columns.matches('r').count())
            .collect();
        assert_eq!(blocks.iter().sum::<usize>(), 96);
        assert!(blocks.iter().all(|columns| (2..=8).contains(columns)), "{blocks:?}");

        let lone = table_of(&rows[..1], &many[..1], true).latex();
        assert!(lone.contains("\\begin{table}[t]") && lone.contains("\\label{tab:street-1}"), "{lone}");
        assert!(
            !lone.contains("\\textbf{0") && !lone.contains("in bold"),
            "a lone column is the best of nothing: {lone}"
        );
        let with_paper = table(true);
        for text in [with_paper.latex(), with_paper.markdown()] {
            assert!(
                text.contains("{0.800} (0.85)") || text.contains("**0.800** (0.85)"),
                "the paper's is not bold: {text}"
            );
        }
    }

    #[test]
    fn latex_text() {
        insta::assert_snapshot!("latex", table(true).latex());
    }
}
