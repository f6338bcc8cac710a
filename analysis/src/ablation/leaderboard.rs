//! Estimates of several runs in one table, with the settings in which the runs differ.

use depthloom_graphs::plan::VariantId;
use std::collections::{BTreeSet, HashMap};

use depthloom_recording::{PlanDifference, Recording};
use depthloom_scores::Metric;
use serde_json::Value as Json;

use super::answer::{selected_frames, selected_scores, source_keys};
use super::best::candidate;
use super::comparability::Classes;
use super::front::{Better, Goal, fronts, sort_best_first};
use super::{Ablation, Costs, Ranking, Row, Selection};
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, check_patterns, matching_patterns};
use crate::input::condition::recording_notes;
use crate::input::parameters::parameter_changes;
use crate::scores::incomplete_frames;
use crate::tables::best::{Candidate, marks};
use crate::tables::{Column, Format, Rows, Table};
use crate::titles::Titles;

/// A run of a [leaderboard](leaderboard()).
#[derive(Clone, Copy, Debug)]
pub struct BoardRun<'a> {
    /// Its name.
    pub called: &'a str,
    /// Its recording.
    pub recording: &'a Recording,
    /// The costs of its nodes, if known.
    pub costs: Option<&'a Costs>,
}

/// A row and its run.
struct Entry {
    run: usize,
    row: Row,
    /// For each metric of the board, the class of comparable rows over all runs.
    classes: Vec<Option<usize>>,
}

/// The estimates of several runs, best first, with their run, the settings in which the runs differ, and their metrics.
///
/// # Errors
/// As [`answer`](super::answer()).
pub fn leaderboard(
    runs: &[BoardRun<'_>],
    selection: &Selection,
    ranking: &Ranking,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Table, AnalysisError> {
    caught(|| {
        if ranking.intervals.is_some() {
            return Err(AnalysisError::request(
                "`--ci` needs a single run".to_owned(),
                "name one run, or use `depthloom compare`, which has intervals of differences".to_owned(),
            ));
        }
        let opened =
            runs.iter().map(|run| selected_scores(run.recording, selection, stop)).collect::<Result<Vec<_>, _>>()?;
        let sources: Vec<_> = runs.iter().map(|run| source_keys(run.recording)).collect();
        let ablations: Vec<Ablation<'_>> = (runs.iter().zip(&opened).zip(&sources))
            .map(|((run, (estimates, scores)), source)| {
                Ablation::new(run.recording.plan(), estimates, scores, source, run.costs)
            })
            .collect();
        if let Some(patterns) = &selection.estimates {
            let all: Vec<Estimate> = opened.iter().flat_map(|(estimates, _)| estimates.iter().cloned()).collect();
            check_patterns(patterns, &all)?;
        }
        let mut table = Board::new(runs, &ablations, selection, ranking)?.table(selection, ranking)?;
        Titles::new(runs.iter().map(|run| run.recording.plan())).apply(&mut table);
        for (run, (estimates, scores)) in runs.iter().zip(&opened) {
            let frames = selected_frames(run.recording, selection)?;
            let notes = incomplete_frames(run.recording, estimates, scores, frames.as_ref());
            let notes = notes.into_iter().chain(recording_notes(run.recording));
            table.notes.extend(notes.map(|note| format!("{}: {note}", run.called)));
        }
        Ok(table)
    })
}

struct Board<'a> {
    runs: &'a [BoardRun<'a>],
    ablations: &'a [Ablation<'a>],
    /// The metrics that any run has.
    metrics: Vec<&'static Metric>,
    entries: Vec<Entry>,
}

impl<'a> Board<'a> {
    fn new(
        runs: &'a [BoardRun<'a>],
        ablations: &'a [Ablation<'a>],
        selection: &Selection,
        ranking: &Ranking,
    ) -> Result<Self, AnalysisError> {
        let selection = &ranking.with_depths(selection);
        let mut metrics: Vec<_> = ablations.iter().flat_map(|ablation| ablation.metrics.iter().copied()).collect();
        metrics.sort_by_key(|metric| metric.place());
        metrics.dedup();
        let (mut classes, mut entries) = (Classes::default(), Vec::new());
        for (run, ablation) in ablations.iter().enumerate() {
            // A name has to exist in one of the runs, not in each.
            let patterns = selection.estimates.as_deref();
            let patterns = patterns.map(|patterns| matching_patterns(patterns, ablation.estimates));
            let selection = &match patterns {
                Some(None) => continue,
                Some(estimates) => Selection { estimates, ..selection.clone() },
                None => selection.clone(),
            };
            let zone = ablation.zone(selection)?;
            for row in ranking.rows(ablation, ablation.rows(selection)?)?.0 {
                let class = |metric: &&Metric| {
                    let metric = ablation.metrics.iter().position(|known| known == metric)?;
                    row.comparable_by(metric)?;
                    let part = row.part_with(metric);
                    let scores = ablation.frames(part.estimate, part.set, zone);
                    classes.class(ablation.estimate(part), (part.set, part.mean), scores, ablation.source)
                };
                let classes = metrics.iter().map(class).collect();
                entries.push(Entry { run, row, classes });
            }
        }
        Ok(Self { runs, ablations, metrics, entries })
    }

    fn ablation(&self, entry: &Entry) -> &'a Ablation<'a> {
        &self.ablations[entry.run]
    }

    /// The value of an entry in the column with this name.
    fn number(&self, entry: &Entry, name: &str) -> Option<f64> {
        let ablation = self.ablation(entry);
        ablation.number(&entry.row, ablation.measure(name).ok()?)
    }

    /// The direction of a column, from the first run that has it.
    fn goal(&self, name: &str) -> Result<Goal, AnalysisError> {
        let goal = |ablation: &Ablation<'_>| Ok(ablation.goal(ablation.goal_measure(name, "a leaderboard")?));
        let found = self.ablations.iter().find_map(|ablation| goal(ablation).ok());
        found.map_or_else(|| goal(&self.ablations[0]), Ok)
    }

    fn table(&self, selection: &Selection, ranking: &Ranking) -> Result<Table, AnalysisError> {
        // The first run with a selected estimate.
        let lead = self.entries.first().map_or(0, |entry| entry.run);
        let rows_of = |run: usize| -> Vec<Row> {
            self.entries.iter().filter(|entry| entry.run == run).map(|entry| entry.row.clone()).collect()
        };
        let first = rows_of(lead);
        let by = match ranking.sort.as_ref().or_else(|| ranking.pareto.first()) {
            Some(sort) => sort,
            None => self.ablations[lead].metrics[self.ablations[lead].first_error(&first)].name,
        };
        let number = |place: usize, name: &str| self.number(&self.entries[place], name);
        let mut order: Vec<usize> = (0..self.entries.len()).collect();
        if !ranking.pareto.is_empty() {
            let goals = ranking.pareto.iter().map(|name| self.goal(name)).collect::<Result<Vec<_>, _>>()?;
            let group = |place: usize| {
                let metrics = self.metrics.iter().zip(&self.entries[place].classes);
                let chosen = metrics.filter(|(metric, _)| ranking.pareto.iter().any(|name| name == metric.name));
                chosen.map(|(_, class)| *class).collect()
            };
            let values = |place: usize| ranking.pareto.iter().map(|name| number(place, name)).collect();
            order = fronts(self.entries.len(), group, values, &goals);
        }
        sort_best_first(&mut order, self.goal(by)?.better, |place| number(place, by));
        let all = order.len();
        order.truncate(ranking.top.unwrap_or(all));
        let shown: Vec<&Entry> = order.iter().map(|&place| &self.entries[place]).collect();
        let mut columns = self.keys(&shown, selection);
        let mut names: Vec<&str> = ranking.columns.iter().map(String::as_str).collect();
        if names.is_empty() {
            let has = |name: &&str| self.entries.iter().any(|entry| self.number(entry, name).is_some());
            names = self.metrics.iter().map(|metric| metric.name).chain(["density", "ms", "frames"]).collect();
            names.retain(has);
        }
        for name in &names {
            columns.push(self.column(name, &order)?);
        }
        let about = self.ablations[lead].about(&first, selection)?;
        let count =
            if order.len() == all { format!("{all} rows") } else { format!("the first {} of {all} rows", order.len()) };
        let notes = names
            .contains(&"ms")
            .then(|| "ms: the runs were timed at different times and perhaps on different machines".to_owned());
        let label = [vec!["leaderboard".to_owned()], selection.label()].concat().join("-");
        let mut others = (0..self.runs.len()).filter(|&run| run != lead).map(|run| (run, rows_of(run)));
        let is_same_for_all = others.all(|(run, rows)| {
            rows.is_empty() || self.ablations[run].about(&rows, selection).is_ok_and(|other| other == about)
        });
        let scope = match (is_same_for_all, lead) {
            (true, _) => String::new(),
            (false, 0) => "in the first run: ".to_owned(),
            (false, lead) => format!("in {}: ", self.runs[lead].called),
        };
        let about = format!("{} runs; {scope}{about}; {count} by {by}", self.runs.len());
        let classes: BTreeSet<usize> = shown.iter().flat_map(|entry| entry.classes.iter().flatten().copied()).collect();
        let marks = (classes.len() > 1).then_some("best among rows over the same pixels with ground truth");
        Ok(Table { about, label, marks, notes: notes.into_iter().collect(), ..Table::new(columns) })
    }

    /// The columns that identify entries. Text shows only those on which entries differ.
    fn keys(&self, shown: &[&Entry], selection: &Selection) -> Vec<Column> {
        let rows = Rows(shown);
        let estimate = |entry: &Entry| self.ablation(entry).estimate(&entry.row);
        let mut columns = vec![
            rows.key("stage", |entry| &estimate(entry).row_key.stage),
            rows.key("variant", |entry| estimate(entry).row_key.variant.as_ref()),
            rows.key("estimate", |entry| self.ablation(entry).name(&entry.row)),
            rows.key("set", |entry| selection.set_name(&entry.row)),
        ];
        // Also those on which only rows beyond `--top` differ: without them, a row could not be identified.
        let all: Vec<&Entry> = self.entries.iter().collect();
        let differs = |of: &dyn Fn(&Entry) -> Option<String>| all.iter().any(|entry| of(entry) != of(all[0]));
        let is_shown = [
            differs(&|entry| Some(estimate(entry).row_key.stage.clone())),
            differs(&|entry| estimate(entry).row_key.variant.clone()),
            differs(&|entry| Some(self.ablation(entry).name(&entry.row))),
            differs(&|entry| Some(selection.set_name(&entry.row))),
        ];
        for (column, is_shown) in columns.iter_mut().zip(is_shown) {
            column.only_in_files = !is_shown;
        }
        columns.insert(0, rows.key("run", |entry| self.runs[entry.run].called));
        let settings = self.settings(shown).into_iter();
        columns.extend(settings.map(|(setting, values)| Rows(&values).key(setting, Option::as_ref)));
        columns
    }

    fn column(&self, name: &str, order: &[usize]) -> Result<Column, AnalysisError> {
        let shown: Vec<&Entry> = order.iter().map(|&place| &self.entries[place]).collect();
        let (rows, goal) = (Rows(&shown), self.goal(name)?);
        let column = rows.number(name, |entry| self.number(entry, name)).better(goal.better == Better::More);
        let Some(place) = self.metrics.iter().position(|metric| metric.name == name) else {
            return Ok(match name {
                "density" | "disparity_density" => column.format(Format::Percent),
                "ms" => column.format(Format::Fixed(2)),
                _ => rows.count(name, |entry| self.number(entry, name).map(|count| count as u64)),
            });
        };
        let candidate = |entry: &Entry| {
            let (ablation, class) = (self.ablation(entry), entry.classes[place]);
            let metric = ablation.metrics.iter().position(|known| *known == self.metrics[place]);
            metric.map_or_else(Candidate::default, |metric| candidate(ablation, &entry.row, metric, class))
        };
        let candidates: Vec<Candidate> = self.entries.iter().map(candidate).collect();
        let marks = marks(&candidates);
        Ok(column.metric(self.metrics[place]).marked(order.iter().map(|&place| marks[place]).collect()))
    }

    /// The parameters in which entries differ: `stage.node.parameter`, and the value of each entry. `None` if variants
    /// that share an entry have different values.
    fn settings(&self, entries: &[&Entry]) -> Vec<(String, Vec<Option<String>>)> {
        let text = |value: Json| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let variants = |entry: &Entry| -> Vec<Option<VariantId>> {
            let all = &self.runs[entry.run].recording.plan().variants;
            let is_own = |name: &&String| match &self.ablations[entry.run].estimate(&entry.row).row_key.variant {
                Some(variant) => *name == variant,
                None => true,
            };
            let own: Vec<_> = VariantId::all(all.len()).filter(|variant| is_own(&&all[*variant])).map(Some).collect();
            if own.is_empty() { vec![None] } else { own }
        };
        let Some(first) = entries.first() else { return Vec::new() };
        let base = (self.runs[first.run].recording.plan(), variants(first)[0]);
        // The settings of each variant that differ from those of the first entry.
        let mut known: HashMap<(usize, Option<VariantId>), Vec<Setting>> = HashMap::new();
        for entry in entries {
            for variant in variants(entry) {
                known.entry((entry.run, variant)).or_insert_with(|| {
                    let other = (self.runs[entry.run].recording.plan(), variant);
                    let changes = parameter_changes(base, other).into_iter();
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
            let setting_of_variant = |variant: Option<VariantId>| {
                let changed = known[&(entry.run, variant)].iter().find(|setting| setting.name == name);
                changed.map_or(before, |setting| &setting.after)
            };
            let variants = variants(entry);
            let value = setting_of_variant(variants[0]);
            value.clone().filter(|_| variants.iter().all(|variant| setting_of_variant(*variant) == value))
        };
        let values = |name| entries.iter().map(|entry| value(entry, name)).collect();
        names.into_iter().map(|name| (name.0.to_owned(), values(name))).collect()
    }
}

/// A parameter that differs from the first entry.
struct Setting {
    /// `stage.node.parameter`.
    name: String,
    before: Option<String>,
    after: Option<String>,
}
