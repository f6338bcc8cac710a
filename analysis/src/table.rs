//! Table I: the mean over frames of every score, by variant and estimator.

pub(crate) mod latex;
pub(crate) mod markdown;
mod terminal;

use std::collections::{HashMap, HashSet};

use depthloom_graphs::Key;
use depthloom_scores::{Family, Mean, Metric, PixelSet, ScoreRow, Settings};

use crate::estimators::Estimator;
use crate::paper::paper_scores;
use crate::scores::{FrameScore, metrics_of};
use crate::sheet::{Cells, Sheet};

/// The mean over frames, a column an estimator and pixel set.
///
/// The mean is the unweighted one of the frames' scores (monodepth, the KITTI devkits), or of all pixels alike where that was asked for, over the frames that have scores of all
/// estimators of their stage run. A frame on which a score has no pixel adds nothing to that score's mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The experiment's name.
    pub experiment: String,
    /// The scores, in the order they are shown.
    pub metrics: Vec<&'static Metric>,
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
    /// Whether it is the mean of the frames' scores, or over all their pixels.
    pub mean: Mean,
    /// The means, in the order of [`Table::metrics`]; `None` if it was not asked for, or no frame had a pixel to score.
    pub means: Vec<Option<f64>>,
    /// The mean share of true pixels that were answered; `None` if the recording does not say.
    pub density: Option<f64>,
    /// Columns of one number may be compared: over all true pixels, as many of the same frames, held against the same truth,
    /// scored in the same way. `None`: over the pixels this estimator answered, which are its own.
    pub comparable: Option<usize>,
    /// The paper's numbers, where it gives them: of the eight scores that a `score/depth` takes by default.
    pub paper: Option<[f64; 8]>,
}

impl TableColumn {
    /// The paper's number of a score, where it gives one.
    #[must_use]
    pub fn paper_of(&self, metric: &Metric) -> Option<f64> {
        let place = Family::Depth.defaults().iter().position(|of| *of == metric)?;
        self.paper.map(|paper| paper[place])
    }
}

impl Table {
    /// Takes the means of the scores per frame; `source(run, position)` is the key of a frame's source values.
    pub(crate) fn new(
        experiment: &str,
        scores: &[FrameScore],
        estimators: &[Estimator],
        with_paper: bool,
        source: &dyn Fn(usize, usize) -> Option<Key>,
    ) -> Self {
        let rows = whole_images(scores, estimators);
        let metrics = metrics_of(estimators);
        let means = means(&rows, &metrics, estimators);
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
                let Means { frames, density, means } =
                    means.get(&(index, set)).cloned().unwrap_or_else(|| Means::none(metrics.len()));
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
                    mean: estimator.mean,
                    means,
                    density,
                    comparable,
                    paper,
                });
            }
        }
        Self { experiment: experiment.to_owned(), metrics, columns, with_paper }
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

    /// The long form, a row an estimator and pixel set, sorted: `estimator, scored_on`, the scores, `frames`, the paper's
    /// as `paper_a1 ...` where asked for, `density`.
    pub(crate) fn long_form(&self) -> Sheet<'_> {
        let mut rows: Vec<&TableColumn> = self.columns.iter().collect();
        rows.sort_by(|a, b| (&a.estimator, a.set).cmp(&(&b.estimator, b.set)));
        let mut table = Sheet::new()
            .with("estimator", Cells::Text(rows.iter().map(|row| row.estimator.as_str()).collect()))
            .with("scored_on", Cells::Text(rows.iter().map(|row| row.set.name()).collect()));
        for (i, metric) in self.metrics.iter().enumerate() {
            table = table.with(metric.name, Cells::Number(rows.iter().map(|row| row.means[i]).collect()));
        }
        table = table.with("frames", Cells::Count(rows.iter().map(|row| row.frames).collect()));
        let in_the_paper = Family::Depth.defaults();
        for metric in self.metrics.iter().filter(|metric| self.with_paper && in_the_paper.contains(metric)) {
            let paper = rows.iter().map(|row| row.paper_of(metric));
            table = table.with(format!("paper_{}", metric.name), Cells::Number(paper.collect()));
        }
        table.with("density", Cells::Number(rows.iter().map(|row| row.density).collect()))
    }

    /// Whether a column is the best of a row among two or more that are comparable.
    ///
    /// What was within a factor of 1.25^3 of the truth nowhere is never best: `silog` would prefer an estimate that never answered,
    /// for a missing answer counts as one constant, and a constant has the truth's spread and no error of its own.
    pub(crate) fn is_best(&self, line: usize, column: usize) -> bool {
        let a3 = self.metrics.iter().position(|metric| metric.name == "a3");
        let Some(comparable) = self.columns[column].comparable else { return false };
        let others = || self.columns.iter().enumerate().filter(|(_, other)| other.comparable == Some(comparable));
        // A score of answers alone is of other pixels in every column that left some unanswered.
        let of_answers = self.metrics[line].pooling == depthloom_scores::Pooling::MeanOfAnswers;
        let is_whole =
            |column: &TableColumn| !of_answers || column.set == PixelSet::Filled || column.density == Some(1.0);
        let answers = |column: &TableColumn| {
            is_whole(column) && a3.is_none_or(|a3| column.means[a3].is_some_and(|share| share > 0.0))
        };
        let scored = others().filter(|(_, other)| answers(other));
        let scored = scored.filter_map(|(i, other)| Some((i, other.means[line].filter(|mean| mean.is_finite())?)));
        let better = |a: f64, b: f64| if self.metrics[line].more_is_better { a > b } else { a < b };
        let best = scored.reduce(|best, other| if better(other.1, best.1) { other } else { best });
        others().count() > 1 && best.is_some_and(|(i, _)| i == column)
    }

    /// What the marked cells are; `None` if there are none.
    pub(crate) fn best_of(&self) -> Option<&'static str> {
        let mut marked =
            (0..self.metrics.len()).flat_map(|line| (0..self.columns.len()).map(move |column| (line, column)));
        marked.find(|(line, column)| self.is_best(*line, *column))?;
        let numbers: HashSet<usize> = self.columns.iter().filter_map(|column| column.comparable).collect();
        Some(if numbers.len() == 1 { "best over all true pixels" } else { "best of those over the same true pixels" })
    }

    /// The text of a cell: our number, and the paper's.
    pub(crate) fn cell(&self, line: usize, column: usize) -> (String, Option<String>) {
        let (column, metric) = (&self.columns[column], self.metrics[line]);
        let decimals = metric.decimals;
        let ours = column.means[line].map_or_else(|| "-".to_owned(), |mean| format!("{mean:.decimals$}"));
        (ours, column.paper_of(metric).map(|paper| format!("({paper:.2})")))
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
        let s = if most == 1 { "" } else { "s" };
        let pooled: Vec<&TableColumn> = self.columns.iter().filter(|column| column.mean == Mean::Pixels).collect();
        let frames = match pooled.len() {
            0 => format!("mean over {most} frame{s}"),
            all if all == self.columns.len() => format!("over all pixels of {most} frame{s}"),
            _ => {
                let mut named: Vec<&str> = pooled.iter().map(|column| column.estimator.as_str()).collect();
                named.dedup();
                format!("mean over {most} frame{s}, over all their pixels alike for {}", named.join(", "))
            }
        };
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
    settings: (&'a Option<Settings>, Mean),
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
        Self { settings: (&estimator.settings, estimator.mean), truth, frames: over_all.map(frame).collect() }
    }
}

/// The scores over the whole image of the frames that have rows of all estimators of their stage run.
fn whole_images<'a>(scores: &'a [FrameScore], estimators: &[Estimator]) -> Vec<&'a FrameScore> {
    common(scores, estimators).into_iter().filter(|score| score.row.zone.is_empty()).collect()
}

/// The scores, of zones too, of the frames that have rows of all estimators of their stage run.
pub(crate) fn common<'a>(scores: &'a [FrameScore], estimators: &[Estimator]) -> Vec<&'a FrameScore> {
    let place = |score: &FrameScore| (estimators[score.estimator].run, score.position);
    let mut rows_of_frame: HashMap<(usize, usize), usize> = HashMap::new();
    for score in scores.iter().filter(|score| score.row.zone.is_empty()) {
        *rows_of_frame.entry(place(score)).or_default() += 1;
    }
    let mut rows_of_run: HashMap<usize, usize> = HashMap::new();
    for estimator in estimators {
        *rows_of_run.entry(estimator.run).or_default() += estimator.sets.len();
    }
    let is_whole = |score: &&FrameScore| rows_of_frame.get(&place(score)) == rows_of_run.get(&place(score).0);
    scores.iter().filter(is_whole).collect()
}

/// The means of an estimator on a pixel set.
#[derive(Clone)]
struct Means {
    /// How many frames had a pixel to score.
    frames: u64,
    density: Option<f64>,
    means: Vec<Option<f64>>,
}

impl Means {
    fn none(metrics: usize) -> Self {
        Self { frames: 0, density: None, means: vec![None; metrics] }
    }
}

/// The means by estimator and pixel set.
fn means(
    rows: &[&FrameScore],
    metrics: &[&'static Metric],
    estimators: &[Estimator],
) -> HashMap<(usize, PixelSet), Means> {
    let mut means = means_over_frames(rows, metrics);
    let mut pooled: HashMap<(usize, PixelSet), Vec<&FrameScore>> = HashMap::new();
    for score in rows.iter().filter(|score| estimators[score.estimator].mean == Mean::Pixels) {
        pooled.entry((score.estimator, score.row.set)).or_default().push(score);
    }
    for (key, of) in &mut means {
        if let Some(own) = pooled.get(key) {
            let settings = estimators[key.0].settings.unwrap_or_default();
            let own = || own.iter();
            let pooled = |metric: &&'static Metric| metric.pooled(own().map(|score| &score.row), &settings);
            of.means = metrics.iter().map(pooled).collect();
            let counts = |count: fn(&ScoreRow) -> u64| own().map(|score| count(&score.row)).sum::<u64>();
            let (answered, truth) = (counts(|row| row.answered), counts(|row| row.truth));
            of.density = (truth > 0).then(|| answered as f64 / truth as f64);
        }
    }
    means
}

/// The unweighted means of the frames' scores.
fn means_over_frames(rows: &[&FrameScore], metrics: &[&'static Metric]) -> HashMap<(usize, PixelSet), Means> {
    /// How many frames had a pixel, and by metric how many had a value, and their sum.
    type Sums = (u64, Vec<(u64, f64)>);
    let mut sums: HashMap<(usize, PixelSet), Sums> = HashMap::new();
    for score in rows {
        let empty = || (0, vec![(0, 0.0); metrics.len() + 1]);
        let (frames, sums) = sums.entry((score.estimator, score.row.set)).or_insert_with(empty);
        *frames += u64::from(score.row.pixels > 0);
        let values = metrics.iter().map(|metric| score.row.get(metric)).chain([score.row.density()]);
        for ((count, sum), value) in sums.iter_mut().zip(values) {
            if let Some(value) = value {
                *count += 1;
                *sum += value;
            }
        }
    }
    let mean = |(count, sum): (u64, f64)| (count > 0).then(|| sum / count as f64);
    let means = |(frames, sums): Sums| {
        let mut means: Vec<Option<f64>> = sums.into_iter().map(mean).collect();
        let density = means.pop().flatten();
        Means { frames, density, means }
    };
    sums.into_iter().map(|(key, sums)| (key, means(sums))).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    fn estimator(variant: Option<&str>, name: &str, sets: &[PixelSet]) -> Estimator {
        Estimator {
            label: variant.map_or_else(|| name.to_owned(), |variant| format!("{variant}/{name}")),
            name: name.to_owned(),
            variant: variant.map(str::to_owned),
            run: 0,
            sets: sets.to_vec(),
            family: Family::Depth,
            metrics: Family::Depth.defaults(),
            mean: Mean::Frames,
            settings: Some(Settings::default()),
            preset: "preset paper".to_owned(),
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
        let values = Family::Depth.defaults().into_iter();
        let values = values.map(|metric| (metric, if metric.name == "rmse" { 10.0 * value } else { value }));
        let row = ScoreRow { pixels: 5, truth: 8, answered: 5, ..ScoreRow::new(set, "") };
        let row = values.fold(row, |row, (metric, value)| row.with(metric, value));
        FrameScore { frame: Arc::from(frame), position: frame.parse().unwrap(), estimator, row }
    }

    /// A row with some scores changed.
    fn changed(row: &ScoreRow, to: impl Fn(&str) -> Option<f64>) -> ScoreRow {
        let mut row = row.clone();
        row.scores.iter_mut().for_each(|(metric, value)| *value = to(metric.name).unwrap_or(*value));
        row
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
        scores[0].row = ScoreRow::new(PixelSet::Answered, "");
        let table = table_of(&scores, &estimators(), false);
        assert_eq!((table.columns[0].frames, table.columns[1].frames), (1, 2));
        assert!((table.columns[0].means[0].unwrap() - 0.9).abs() < 1e-12);
        assert_eq!(table.about(), "mean over 2 frames (stereo on answered: 1)");
    }

    #[test]
    fn pixels_of_all_frames_weigh_alike_where_that_is_asked_for_and_it_is_said() {
        let of = |mean| Estimator { mean, ..estimator(None, "mono", &[PixelSet::All]) };
        let mut rows = [score("0", 0, PixelSet::All, 0.5), score("1", 0, PixelSet::All, 0.8)];
        // 5 pixels of 8, and 15 of 16.
        (rows[1].row.pixels, rows[1].row.answered, rows[1].row.truth) = (15, 15, 16);
        let table = |mean| table_of(&rows, &[of(mean)], false);
        let (frames, pixels) = (table(Mean::Frames), table(Mean::Pixels));
        let close = |ours: Option<f64>, expected: f64| assert!((ours.unwrap() - expected).abs() < 1e-12, "{ours:?}");
        close(frames.columns[0].means[0], 0.65);
        close(pixels.columns[0].means[0], (5.0 * 0.5 + 15.0 * 0.8) / 20.0);
        close(pixels.columns[0].means[5], ((5.0 * 25.0 + 15.0 * 64.0_f64) / 20.0).sqrt());
        close(pixels.columns[0].density, 20.0 / 24.0);
        assert_eq!(
            (frames.about(), pixels.about()),
            ("mean over 2 frames".into(), "over all pixels of 2 frames".into())
        );
    }

    #[test]
    fn no_scores_make_a_table_of_dashes() {
        let table = table_of(&[], &estimators(), false);
        assert!(table.columns.iter().all(|column| column.frames == 0 && column.means == vec![None; 8]));
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
        let eight = || Family::Depth.defaults().into_iter().map(|metric| metric.name);
        expected.extend(eight().map(str::to_owned));
        expected.push("frames".to_owned());
        expected.extend(eight().map(|name| format!("paper_{name}")));
        expected.push("density".to_owned());
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
        let capped = Settings { max_m: 50.0, ..Settings::default() };
        let capped = Estimator { settings: Some(capped), ..fused.clone() };
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
            row: changed(&rows[0].row, |metric| match metric {
                "a1" | "a2" | "a3" => Some(0.0),
                "silog" => Some(0.01),
                _ => None,
            }),
            estimator: 2,
            ..rows[0].clone()
        });
        let estimators = ["mono", "fused", "absent"].map(|name| estimator(None, name, &[PixelSet::All]));
        assert_eq!(marked(&table_of(&rows, &estimators, false))[7], [0]);
        // And a mean that is no number is not best either, whichever way is better.
        rows[2].row = changed(&rows[0].row, |metric| match metric {
            "a1" => Some(f64::INFINITY),
            "silog" => Some(f64::NEG_INFINITY),
            _ => None,
        });
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
