//! `depthloom runs prune`: removes runs by age, by the room they take, and by how many there are.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use chrono::{DateTime, Utc};
use depthloom_graphs::{counted, regular_file};
use schemars::JsonSchema;
use serde::Serialize;

use super::{Removed, RemovedRuns, all_in};
use crate::args::{PruneArgs, RunsArgs};
use crate::output::diagnostics::Error;
use depthloom_runs::{FoundRun, Glance, State, environment, run_folder::Removal};
use depthloom_terminal::{CliError, ExitCode, print, size};

/// How much of an experiment is read, bytes: none is larger.
const LARGEST: u64 = 64 << 20;

/// Output of `runs prune`: what was removed, or would be.
#[derive(JsonSchema, Serialize)]
pub(crate) struct RunsPrune {
    dry_run: bool,
    /// The number of runs that the rules were applied to.
    runs: u64,
    /// Runs that the rules selected, but that were kept.
    kept: Vec<KeptRun>,
    removed: Vec<Removed>,
    bytes: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// A run that was kept, and why.
#[derive(JsonSchema, Serialize)]
pub(super) struct KeptRun {
    path: String,
    why: String,
}

/// Removes the runs that the rules select, and reports those that were kept nevertheless.
pub(super) fn prune(args: &RunsArgs, rules: &PruneArgs) -> Result<ExitCode, CliError> {
    let runs: Vec<Run> = all_in(args)?.into_iter().map(Run::new).collect();
    let chosen = chosen(&runs, rules, Utc::now());
    let (marked, chosen): (Vec<usize>, Vec<usize>) = chosen.into_iter().partition(|&run| runs[run].mark.is_some());
    let (chosen, mut kept) = without_those_that_are_read(&runs, &chosen);
    kept.extend(marked.iter().filter_map(|&run| Some((&runs[run], runs[run].mark.clone()?))));
    let selected = || runs.iter().filter(|run| run.is_of(rules));
    let mut removed = RemovedRuns::default();
    for run in chosen.iter().map(|&run| &runs[run]) {
        match Removal::prepare(&run.found.path) {
            Ok(removal) if rules.dry_run => removed.add("would remove", removal.folder(), run.bytes, args.json)?,
            Ok(removal) => removed.remove(removal, args.json)?,
            // The run was started in the meantime, or the folder has files of others.
            Err(stop) => kept.push((run, stop.message.what)),
        }
    }
    if !args.json {
        for (run, why) in &kept {
            print(format!("kept {}: {why}\n", run.found.path.display()))?;
        }
        let all = selected().map(|run| run.bytes).sum();
        let verb = if rules.dry_run { "would remove" } else { "removed" };
        let (gone, bytes) = removed.sum();
        let runs = counted(selected().count(), "run");
        print(format!("{verb} {gone} of {runs}, {} of {}\n", size(bytes), size(all)))?;
    }
    let path = |run: &Run| run.found.path.to_string_lossy().into_owned();
    let kept_runs = kept.into_iter().map(|(run, why)| KeptRun { path: path(run), why }).collect();
    let (dry_run, runs) = (rules.dry_run, selected().count() as u64);
    removed.finish(args, |removed, bytes, error| RunsPrune { dry_run, runs, kept: kept_runs, removed, bytes, error })
}

/// A run, and what rules ask of it.
#[derive(Debug)]
struct Run {
    found: FoundRun,
    state: State,
    experiment: Option<String>,
    bytes: u64,
    /// The tag or note for which it is kept.
    mark: Option<String>,
}

impl Run {
    fn new(found: FoundRun) -> Self {
        let Glance { state, experiment, bytes, .. } = Glance::at(&found);
        let mark = depthloom_runs::mark(&found.path);
        Self { found, state, experiment, bytes, mark }
    }

    fn is_of(&self, rules: &PruneArgs) -> bool {
        rules.experiment.is_none() || self.experiment == rules.experiment
    }
}

/// The indices of the runs that the rules select. The runs are sorted, oldest first.
fn chosen(runs: &[Run], rules: &PruneArgs, now: DateTime<Utc>) -> Vec<usize> {
    let mut left: BTreeMap<&Option<String>, usize> = BTreeMap::new();
    let mut is_kept = vec![false; runs.len()];
    // Runs of other experiments are kept.
    let is_selected = |run: &Run| run.is_of(rules);
    for (place, run) in runs.iter().enumerate().rev().filter(|(_, run)| run.state == State::Complete) {
        let left = left.entry(&run.experiment).or_insert(rules.keep.unwrap_or(0));
        is_kept[place] = *left > 0;
        *left = left.saturating_sub(1);
    }
    let age = |run: &Run| (now - run.found.time).to_std().unwrap_or(Duration::ZERO);
    let by_number_alone = rules.keep.is_some() && rules.older_than.is_none() && rules.max_size.is_none();
    let is_chosen = |run: &Run| {
        rules.older_than.is_some_and(|limit| age(run) > limit)
            || (rules.unfinished && run.state == State::Unfinished)
            || (by_number_alone && run.state == State::Complete)
    };
    let may_go = |place: usize| !is_kept[place] && runs[place].state != State::Running && is_selected(&runs[place]);
    let mut chosen: Vec<bool> = (0..runs.len()).map(|place| may_go(place) && is_chosen(&runs[place])).collect();
    if let Some(most) = rules.max_size {
        let stays = |chosen: &[bool]| -> u64 {
            let stay = runs.iter().zip(chosen).filter(|(run, goes)| !**goes && is_selected(run));
            stay.map(|(run, _)| run.bytes).sum()
        };
        for place in 0..runs.len() {
            if stays(&chosen) <= most {
                break;
            }
            chosen[place] |= may_go(place);
        }
    }
    (0..runs.len()).filter(|&place| chosen[place]).collect()
}

/// Keeps runs whose model, recording or experiment another kept run reads, with the reason.
fn without_those_that_are_read<'a>(runs: &'a [Run], chosen: &[usize]) -> (Vec<usize>, Vec<(&'a Run, String)>) {
    let (mut chosen, mut kept) = (chosen.to_vec(), Vec::new());
    let reads: Vec<Reads> = runs.iter().map(|run| Reads::new(&run.found.path)).collect();
    loop {
        let stay: Vec<usize> = (0..runs.len()).filter(|place| !chosen.contains(place)).collect();
        let reader = |place: usize| stay.iter().find(|&&stays| reads[stays].is_in(&runs[place].found.path));
        let Some((at, reader)) = chosen.iter().enumerate().find_map(|(at, &place)| Some((at, *reader(place)?))) else {
            return (chosen, kept);
        };
        kept.push((&runs[chosen.remove(at)], format!("{} reads it", runs[reader].found.name)));
    }
}

struct Reads {
    /// The resolved experiment with absolute paths. The values of environment variables are not in it.
    resolved: String,
    /// The files that it read; empty if an earlier version made the run.
    files: Vec<PathBuf>,
}

impl Reads {
    fn new(run: &Path) -> Self {
        let resolved = regular_file::read(&run.join("experiment.resolved.yaml"), LARGEST).unwrap_or_default();
        let files = environment::read(run)["reads"].as_array().cloned().unwrap_or_default();
        let files = files.iter().filter_map(|file| file.as_str()).map(PathBuf::from).collect();
        Self { resolved: String::from_utf8_lossy(&resolved).into_owned(), files }
    }

    /// Whether one of the files is in a folder.
    fn is_in(&self, folder: &Path) -> bool {
        let Ok(folder) = folder.canonicalize() else { return false };
        self.files.iter().any(|file| file.starts_with(&folder)) || names(&self.resolved, &folder)
    }
}

/// Whether a text names a folder, or something in it.
fn names(text: &str, folder: &Path) -> bool {
    let Some(folder) = folder.to_str() else { return false };
    let ends = |rest: &str| rest.chars().next().is_none_or(|next| "/\\\"'\n\r ,]}".contains(next));
    text.match_indices(folder).any(|(at, found)| ends(&text[at + found.len()..]))
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};
    use std::time::Duration;

    use chrono::{DateTime, TimeDelta, Utc};

    use super::{FoundRun, PruneArgs, Run, State, chosen, names};

    const DAY: Duration = Duration::from_secs(86_400);

    /// A run with this age and size.
    fn run(experiment: &str, days: i64, bytes: u64, state: State) -> Run {
        let time = DateTime::<Utc>::UNIX_EPOCH - TimeDelta::days(days);
        let found = FoundRun { name: format!("{experiment}/{days}"), path: PathBuf::new(), time };
        Run { found, state, experiment: Some(experiment.to_owned()), bytes, mark: None }
    }

    fn rules() -> PruneArgs {
        PruneArgs { keep: None, older_than: None, max_size: None, unfinished: false, experiment: None, dry_run: false }
    }

    fn names_of(runs: &[Run], rules: &PruneArgs) -> Vec<String> {
        let chosen = chosen(runs, rules, DateTime::<Utc>::UNIX_EPOCH);
        chosen.into_iter().map(|place| runs[place].found.name.clone()).collect()
    }

    fn some() -> Vec<Run> {
        vec![
            run("a", 9, 10, State::Complete),
            run("b", 8, 10, State::Complete),
            run("a", 7, 10, State::Unfinished),
            run("a", 6, 10, State::Running),
            run("a", 5, 10, State::Complete),
            run("a", 4, 10, State::Complete),
            run("a", 3, 10, State::Unfinished),
        ]
    }

    #[test]
    fn the_newest_whole_runs_of_each_experiment_stay() {
        let runs = some();
        assert_eq!(names_of(&runs, &PruneArgs { keep: Some(2), ..rules() }), ["a/9"]);
        assert_eq!(names_of(&runs, &PruneArgs { keep: Some(0), ..rules() }), ["a/9", "b/8", "a/5", "a/4"]);
        let unfinished = PruneArgs { keep: Some(1), unfinished: true, ..rules() };
        assert_eq!(names_of(&runs, &unfinished), ["a/9", "a/7", "a/5", "a/3"]);
        assert_eq!(names_of(&runs, &PruneArgs { unfinished: true, ..rules() }), ["a/7", "a/3"]);
    }

    #[test]
    fn what_is_older_goes_and_what_runs_stays() {
        let runs = some();
        let older = PruneArgs { older_than: Some(4 * DAY), ..rules() };
        assert_eq!(names_of(&runs, &older), ["a/9", "b/8", "a/7", "a/5"]);
        let and_kept = PruneArgs { keep: Some(2), ..older };
        assert_eq!(names_of(&runs, &and_kept), ["a/9", "a/7"]);
    }

    #[test]
    fn the_oldest_go_until_the_rest_fits() {
        let runs = some();
        let limited = |most: u64| PruneArgs { max_size: Some(most), ..rules() };
        assert_eq!(names_of(&runs, &limited(70)), [""; 0]);
        assert_eq!(names_of(&runs, &limited(69)), ["a/9"]);
        assert_eq!(names_of(&runs, &limited(45)), ["a/9", "b/8", "a/7"]);
        assert_eq!(names_of(&runs, &PruneArgs { keep: Some(1), ..limited(45) }), ["a/9", "a/7", "a/5"]);
        assert_eq!(names_of(&runs, &limited(0)).len(), 6, "one runs");
        // Of one experiment alone, no other counts.
        let of_b = |most: u64| PruneArgs { experiment: Some("b".to_owned()), ..limited(most) };
        assert_eq!(names_of(&runs, &of_b(10)), [""; 0]);
        assert_eq!(names_of(&runs, &of_b(9)), ["b/8"]);
    }

    #[test]
    fn a_folder_is_named_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().canonicalize().unwrap().join("one");
        std::fs::create_dir(&run).unwrap();
        let is_named = |text: String| names(&text, Path::new(&run));
        let path = run.display();
        assert!(is_named(format!("model: {path}/models/net.onnx\n")) && is_named(format!("root: \"{path}\"")));
        assert!(!is_named(format!("model: {path}-2/models/net.onnx")) && !is_named(String::new()));
    }
}
