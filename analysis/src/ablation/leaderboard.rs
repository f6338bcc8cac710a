//! Estimates of several runs in one table, with the settings in which the runs differ.

use depthloom_graphs::plan::VariantId;
use std::collections::HashMap;

use depthloom_recording::{PlanDifference, Recording};
use depthloom_scores::PixelSet;
use serde_json::Value as Json;

use super::answer::{of_frames, scored, source_of};
use super::front::{Better, Goal, front};
use super::ranking::TIMING_NOISE;
use super::{Ablation, Costs, Ranking, Row, Selection, shared_scores};
use crate::best::{Candidate, best};
use crate::compare::parameter_changes;
use crate::comparison::Comparison;
use crate::condition;
use crate::error::{AnalysisError, caught};
use crate::estimators::{Estimator, estimators};
use crate::grid::{Grid, GridCells, GridColumn};
use crate::leading::COMMON;
use crate::scores::FrameScore;
use crate::table::incomplete_frames;

/// A run of a [leaderboard](leaderboard()).
#[derive(Clone, Copy, Debug)]
pub struct BoardRun<'a> {
    /// What it is called.
    pub called: &'a str,
    /// Its recording.
    pub recording: &'a Recording,
    /// What its nodes cost, where that is known.
    pub costs: Option<&'a Costs>,
}

/// A row, and the run that it is of.
struct Entry {
    run: usize,
    row: Row,
    /// By score: the class of rows that it may be compared with, over all runs.
    classes: Vec<Option<usize>>,
}

/// The estimates of several runs, best first: their run, the settings in which the runs differ, their scores.
///
/// # Errors
/// As [`answer`](super::answer()).
pub fn leaderboard(
    runs: &[BoardRun<'_>],
    selection: &Selection,
    ranking: &Ranking,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Grid, AnalysisError> {
    caught(|| {
        if ranking.intervals.is_some() {
            return Err(AnalysisError::asked(
                "intervals are of one run's table".to_owned(),
                "name one run, or take `compare`, which has intervals of differences".to_owned(),
            ));
        }
        let mut opened: Vec<(Vec<Estimator>, Vec<FrameScore>)> = Vec::new();
        for run in runs {
            let all = estimators(run.recording.plan())?;
            let (all, scores) = match selection.common {
                true => shared_scores(run.recording, &all, selection, stop)?,
                false => {
                    let scores = scored(run.recording, &all, stop)?;
                    (all, scores)
                }
            };
            let scores = of_frames(run.recording, &all, scores, selection)?;
            opened.push((all, scores));
        }
        let sources: Vec<_> = runs.iter().map(|run| source_of(run.recording)).collect();
        let ablations: Vec<Ablation<'_>> = (runs.iter().zip(&opened).zip(&sources))
            .map(|((run, (estimators, scores)), source)| {
                Ablation::new(run.recording.plan(), estimators, scores, source, run.costs)
            })
            .collect();
        let board = Board::of(runs, &ablations, selection, ranking)?;
        let mut grid = board.grid(selection, ranking)?;
        for (run, (estimators, scores)) in runs.iter().zip(&opened) {
            let notes = incomplete_frames(run.recording, estimators, scores);
            let notes = notes.into_iter().chain(condition::told(run.recording, &[], true).notes);
            grid.notes.extend(notes.map(|note| format!("{}: {note}", run.called)));
        }
        Ok(grid)
    })
}

struct Board<'a> {
    runs: &'a [BoardRun<'a>],
    ablations: &'a [Ablation<'a>],
    /// The columns behind the keys, by name.
    columns: Vec<String>,
    entries: Vec<Entry>,
}

impl<'a> Board<'a> {
    fn of(
        runs: &'a [BoardRun<'a>],
        ablations: &'a [Ablation<'a>],
        selection: &Selection,
        ranking: &Ranking,
    ) -> Result<Self, AnalysisError> {
        let selection = &ranking.with_depths(selection);
        let mut rows: Vec<(usize, Row)> = Vec::new();
        for (run, ablation) in ablations.iter().enumerate() {
            let (of_run, _) = ranking.rows(ablation, ablation.rows(selection)?)?;
            rows.extend(of_run.into_iter().map(|row| (run, row)));
        }
        let mut board = Self { runs, ablations, columns: ranking.columns.clone(), entries: Vec::new() };
        let mut comparisons: Vec<(PixelSet, Comparison<'_>)> = Vec::new();
        let mut entries = Vec::new();
        let names = board.scores();
        for (run, row) in rows {
            let ablation = &ablations[run];
            let zone = ablation.zone(selection)?;
            let class = |name: &&str, comparisons: &mut Vec<(PixelSet, Comparison<'a>)>| {
                let metric = ablation.metrics.iter().position(|metric| metric.name == *name)?;
                row.comparable_by(metric)?;
                let part = row.of(metric);
                let scores = ablation.frames(part.estimator, part.set, zone).iter().copied();
                let comparison = Comparison::of(ablation.estimator(part), part.mean, scores, ablation.source);
                let comparison = (part.set, comparison);
                Some(comparisons.iter().position(|known| *known == comparison).unwrap_or_else(|| {
                    comparisons.push(comparison);
                    comparisons.len() - 1
                }))
            };
            let classes = names.iter().map(|name| class(name, &mut comparisons)).collect();
            entries.push(Entry { run, row, classes });
        }
        board.entries = entries;
        if board.columns.is_empty() {
            let has = |name: &&str| board.entries.iter().any(|entry| board.number(entry, name).is_some());
            let others = ["density", "ms", "frames"].into_iter();
            board.columns = names.iter().copied().chain(others).filter(has).map(str::to_owned).collect();
        }
        Ok(board)
    }

    /// The scores that any run has.
    fn scores(&self) -> Vec<&'static str> {
        let mut metrics: Vec<_> = self.ablations.iter().flat_map(|ablation| ablation.metrics.iter().copied()).collect();
        metrics.sort_by_key(|metric| metric.place());
        metrics.dedup_by_key(|metric| metric.name);
        metrics.into_iter().map(|metric| metric.name).collect()
    }

    fn number(&self, entry: &Entry, column: &str) -> Option<f64> {
        let ablation = &self.ablations[entry.run];
        ablation.number(&entry.row, ablation.column(column).ok()?)
    }

    /// Which way a column is better, in the first run that has it.
    fn better(&self, column: &str) -> Result<Better, AnalysisError> {
        let found = self.ablations.iter().find_map(|of| Some(of.better(of.measure(column, "a leaderboard is").ok()?)));
        match found {
            Some(better) => Ok(better),
            None => self.ablations[0].measure(column, "a leaderboard is").map(|of| self.ablations[0].better(of)),
        }
    }

    fn grid(&self, selection: &Selection, ranking: &Ranking) -> Result<Grid, AnalysisError> {
        let by = match ranking.sort.as_ref().or_else(|| ranking.pareto.first()) {
            Some(sort) => sort.clone(),
            None => {
                let rows: Vec<Row> = self.entries.iter().filter(|of| of.run == 0).map(|of| of.row.clone()).collect();
                self.ablations[0].metrics[self.ablations[0].first_error(&rows)].name.to_owned()
            }
        };
        let mut order: Vec<usize> = (0..self.entries.len()).collect();
        if !ranking.pareto.is_empty() {
            order = self.front(&ranking.pareto)?;
        }
        let better = self.better(&by)?;
        let value = |place: &usize| self.number(&self.entries[*place], &by).filter(|value| !value.is_nan());
        order.sort_by(|a, b| match (value(a), value(b)) {
            (Some(a), Some(b)) if better == Better::More => b.total_cmp(&a),
            (Some(a), Some(b)) => a.total_cmp(&b),
            (a, b) => a.is_none().cmp(&b.is_none()),
        });
        let all = order.len();
        order.truncate(ranking.top.unwrap_or(all));
        let shown: Vec<&Entry> = order.iter().map(|&place| &self.entries[place]).collect();
        let estimator = |entry: &Entry| self.ablations[entry.run].estimator(&entry.row);
        let key = |name: &str, of: &dyn Fn(&Entry) -> Option<String>| {
            let cells: Vec<Option<String>> = shown.iter().map(|entry| of(entry)).collect();
            let differs = name == "run" || cells.windows(2).any(|two| two[0] != two[1]);
            GridColumn { only_in_files: !differs, ..GridColumn::key(name, cells) }
        };
        let set = |entry: &Entry| {
            let mut sets: Vec<&str> = entry.row.parts().map(|part| part.set.name()).collect();
            sets.dedup();
            Some(if selection.common { COMMON.to_owned() } else { sets.join("+") })
        };
        let mut columns = vec![
            key("run", &|entry| Some(self.runs[entry.run].called.to_owned())),
            key("stage", &|entry| Some(estimator(entry).lead.stage.clone())),
            key("variant", &|entry| estimator(entry).lead.variant.clone()),
            key("estimator", &|entry| Some(self.ablations[entry.run].name(&entry.row))),
            key("set", &set),
        ];
        for (setting, values) in self.settings(&shown) {
            columns.push(GridColumn::key(setting, values));
        }
        for column in &self.columns {
            columns.push(self.column(column, &order)?);
        }
        let rows: Vec<Row> = self.entries.iter().filter(|of| of.run == 0).map(|of| of.row.clone()).collect();
        let about = self.ablations[0].about(&rows, selection)?;
        let count =
            if order.len() == all { format!("{all} rows") } else { format!("the first {} of {all} rows", order.len()) };
        let mut notes = Vec::new();
        if self.columns.iter().any(|column| column == "ms") {
            notes.push("ms: of several runs, timings are of several moments and perhaps machines".to_owned());
        }
        let label = [vec!["leaderboard".to_owned()], selection.label()].concat().join("-");
        let about = format!("{} runs; of the first {about}; {count} by {by}", self.runs.len());
        Ok(Grid { about, label, columns, notes, ..Grid::default() })
    }

    fn column(&self, name: &str, order: &[usize]) -> Result<GridColumn, AnalysisError> {
        let values: Vec<Option<f64>> = order.iter().map(|&place| self.number(&self.entries[place], name)).collect();
        let Some(place) = self.scores().iter().position(|score| *score == name) else {
            let better = self.better(name)?;
            let cells = match name {
                "density" | "disparity_density" => GridCells::Share(values),
                "ms" => GridCells::Number { decimals: 2, best: vec![false; values.len()], values },
                _ => GridCells::Count(values.into_iter().map(|value| value.map(|value| value as u64)).collect()),
            };
            return Ok(GridColumn { more_is_better: Some(better == Better::More), ..GridColumn::of(name, cells) });
        };
        let metric = self.ablations.iter().find_map(|of| of.metrics.iter().copied().find(|metric| metric.name == name));
        let Some(metric) = metric else { return Ok(GridColumn::of(name, GridCells::Share(values))) };
        let candidate = |entry: &Entry| {
            let part =
                self.ablations[entry.run].metrics.iter().position(|of| of.name == name).map(|of| entry.row.of(of));
            let a3 = self.ablations[entry.run].metrics.iter().position(|of| of.name == "a3");
            Candidate {
                class: entry.classes[place],
                value: self.number(entry, name),
                a3: part.zip(a3).and_then(|(part, a3)| part.values[a3]),
                density: part.and_then(|part| part.density),
            }
        };
        let marked = best(&self.entries.iter().map(candidate).collect::<Vec<_>>(), metric.more_is_better);
        let best = order.iter().map(|&place| marked[place]).collect();
        Ok(GridColumn::score(metric, GridCells::Number { decimals: metric.decimals + 1, values, best }))
    }

    /// The entries on the Pareto front; of entries that cannot be compared each kind has its own.
    fn front(&self, names: &[String]) -> Result<Vec<usize>, AnalysisError> {
        let goal = |name: &String| {
            let noise = if name == "ms" { TIMING_NOISE } else { 0.0 };
            self.better(name).map(|better| Goal { better, noise })
        };
        let goals: Vec<Goal> = names.iter().map(goal).collect::<Result<_, _>>()?;
        let scores = self.scores();
        let places: Vec<usize> =
            names.iter().filter_map(|name| scores.iter().position(|score| score == name)).collect();
        let mut kinds: Vec<(Vec<Option<usize>>, Vec<usize>)> = Vec::new();
        for (at, entry) in self.entries.iter().enumerate() {
            let kind: Vec<Option<usize>> = places.iter().map(|place| entry.classes[*place]).collect();
            match kinds.iter_mut().find(|(known, _)| *known == kind) {
                Some((_, members)) => members.push(at),
                None => kinds.push((kind, vec![at])),
            }
        }
        let mut found = Vec::new();
        for (_, members) in kinds {
            let values = |at: &usize| names.iter().map(|name| self.number(&self.entries[*at], name)).collect();
            let values: Vec<Vec<Option<f64>>> = members.iter().map(values).collect();
            found.extend(front(&values, &goals).into_iter().map(|place| members[place]));
        }
        found.sort_unstable();
        Ok(found)
    }

    /// The parameters in which the entries differ: `stage.node.parameter`, and its value by entry; `None` where variants that share an entry do not agree.
    fn settings(&self, entries: &[&Entry]) -> Vec<(String, Vec<Option<String>>)> {
        let text = |value: Json| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let variants = |entry: &Entry| -> Vec<Option<VariantId>> {
            let all = &self.runs[entry.run].recording.plan().variants;
            let is_of = |name: &&String| match &self.ablations[entry.run].estimator(&entry.row).lead.variant {
                Some(variant) => *name == variant,
                None => true,
            };
            let own: Vec<_> = VariantId::all(all.len()).filter(|variant| is_of(&&all[*variant])).map(Some).collect();
            if own.is_empty() { vec![None] } else { own }
        };
        let Some(first) = entries.first() else { return Vec::new() };
        let base = (self.runs[first.run].recording.plan(), variants(first)[0]);
        // Of each variant of a run, what is not as in the first entry.
        let mut known: HashMap<(usize, Option<VariantId>), Vec<Setting>> = HashMap::new();
        for entry in entries {
            for variant in variants(entry) {
                known.entry((entry.run, variant)).or_insert_with(|| {
                    let of = (self.runs[entry.run].recording.plan(), variant);
                    let changes = parameter_changes(base, of).into_iter();
                    let setting = |(node, difference)| match difference {
                        PlanDifference::Parameter { path, before, after } => Some(Setting {
                            name: format!("{node}.{path}"),
                            before: before.map(text),
                            after: after.map(text),
                        }),
                        _ => None,
                    };
                    changes.filter_map(setting).collect()
                });
            }
        }
        let mut names: Vec<(&str, &Option<String>)> = Vec::new();
        for entry in entries {
            for setting in variants(entry).iter().flat_map(|variant| &known[&(entry.run, *variant)]) {
                if !names.iter().any(|(name, _)| *name == setting.name) {
                    names.push((&setting.name, &setting.before));
                }
            }
        }
        let value = |entry: &Entry, (name, before): (&str, &Option<String>)| {
            let of_variant = |variant: Option<VariantId>| {
                let changed = known[&(entry.run, variant)].iter().find(|setting| setting.name == name);
                changed.map_or(before, |setting| &setting.after)
            };
            let variants = variants(entry);
            let value = of_variant(variants[0]);
            value.clone().filter(|_| variants.iter().all(|variant| of_variant(*variant) == value))
        };
        let values = |name| entries.iter().map(|entry| value(entry, name)).collect();
        names.into_iter().map(|name| (name.0.to_owned(), values(name))).collect()
    }
}

/// A parameter that is not as in the first entry.
struct Setting {
    /// `stage.node.parameter`.
    name: String,
    before: Option<String>,
    after: Option<String>,
}
