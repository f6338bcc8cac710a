//! `depthloom runs`: which runs there are, newest first.

use std::collections::BTreeSet;

use depthloom_graphs::language;
use depthloom_runs::{Best, Condition, FoundRun, Glance, condition_paths};
use depthloom_terminal::{CliError, ExitCode, aligned, print, say, size};
use schemars::JsonSchema;
use serde::Serialize;

use super::all_in;
use crate::args::{ListFilter, RunsArgs};
use crate::output;

/// Output of `runs`: the runs in a folder, newest first.
#[derive(JsonSchema, Serialize)]
pub(crate) struct RunsList {
    folder: String,
    runs: Vec<Glance>,
}

pub(super) fn list(args: &RunsArgs, list: &ListFilter) -> Result<ExitCode, CliError> {
    let all = all_in(args)?;
    let newest_first: Vec<(FoundRun, Glance)> = match list.conditions.is_empty() {
        true => all.into_iter().rev().map(|run| (run.clone(), Glance::at(&run))).collect(),
        false => selected(all, &list.conditions)?,
    };
    if args.json {
        let runs = newest_first.into_iter().map(|(_, glance)| glance).collect();
        output::print(&RunsList { folder: args.folder.path().to_string_lossy().into_owned(), runs })?;
        return Ok(ExitCode::Success);
    }
    if newest_first.is_empty() {
        let which = if list.conditions.is_empty() { "no runs" } else { "no run fulfils the conditions" };
        say(format_args!("{which} in {}", args.folder.path().display()));
        return Ok(ExitCode::Success);
    }
    if list.names {
        print(newest_first.iter().map(|(run, _)| format!("{}\n", run.name)).collect::<String>())?;
        return Ok(ExitCode::Success);
    }
    let head = ["run", "time (UTC)", "experiment", "variants", "frames", "size", "state", "best score", "tags", "note"];
    let mut rows = vec![head.map(str::to_owned)];
    rows.extend(newest_first.iter().map(|(run, glance)| row(run, glance)));
    print(match newest_first.iter().all(|(_, glance)| glance.notes.is_empty()) {
        true => aligned(&rows.iter().map(without_notes).collect::<Vec<_>>(), &RIGHT),
        false => aligned(&rows, &RIGHT),
    })?;
    Ok(ExitCode::Success)
}

/// The runs that fulfil all conditions, newest first. A path that no run has is an error.
fn selected(runs: Vec<FoundRun>, conditions: &[Condition]) -> Result<Vec<(FoundRun, Glance)>, CliError> {
    let mut is_known = vec![false; conditions.len()];
    let mut known_paths = BTreeSet::new();
    let (mut chosen, any) = (Vec::new(), !runs.is_empty());
    for run in runs.into_iter().rev() {
        let (glance, plan) = Glance::with_plan(&run);
        let holds = conditions.iter().map(|condition| condition.holds(&glance, plan.as_ref()));
        let holds = holds
            .collect::<Result<Vec<_>, _>>()
            .map_err(|what| CliError::usage(what, "write the path of a file that exists"))?;
        is_known.iter_mut().zip(&holds).for_each(|(is_known, holds)| *is_known |= holds.is_some());
        if holds.iter().all(|holds| *holds == Some(true)) {
            chosen.push((run, glance));
        }
        known_paths.extend(plan.iter().flat_map(condition_paths));
    }
    let unknown = conditions
        .iter()
        .zip(&is_known)
        .find(|(condition, is_known)| any && !**is_known && !known_paths.contains(&condition.path));
    match unknown {
        Some((condition, _)) => {
            let nearest = language::nearest(&condition.path, known_paths.iter().map(String::as_str));
            let what = format!("no run has `{}`", condition.path);
            let otherwise = "paths are STAGE.NODE.with.NAME, STAGE.NODE.kind, sources.NAME.with.NAME, best, experiment, frames, state, tag or variants";
            Err(CliError::unknown(what, nearest, otherwise))
        }
        None => Ok(chosen),
    }
}

/// The columns of numbers.
const RIGHT: [usize; 3] = [3, 4, 5];
/// The most characters of a note in the list.
const NOTE: usize = 40;

fn without_notes(row: &[String; 10]) -> [String; 8] {
    std::array::from_fn(|column| row[column].clone())
}

fn row(run: &FoundRun, glance: &Glance) -> [String; 10] {
    let nothing = || "-".to_owned();
    let text = |text: String| if text.is_empty() { nothing() } else { text };
    let count = |count: u64| if glance.experiment.is_some() { count.to_string() } else { nothing() };
    let remark = glance.best.as_ref().map(Best::text);
    [
        run.name.clone(),
        run.time.format("%Y-%m-%d %H:%M").to_string(),
        glance.experiment.clone().unwrap_or_else(nothing),
        count(glance.variants),
        count(glance.frames),
        size(glance.bytes),
        glance.state_text(),
        text([remark, glance.trouble.clone()].into_iter().flatten().collect::<Vec<_>>().join("; ")),
        text(glance.notes.tags.iter().map(String::as_str).collect::<Vec<_>>().join(" ")),
        text(short(glance.notes.note.as_deref().unwrap_or_default())),
    ]
}

/// The first line of a note, cut to a width.
fn short(note: &str) -> String {
    let line = note.lines().next().unwrap_or_default();
    let is_cut = line.chars().count() > NOTE || note.lines().nth(1).is_some();
    let mut text: String = line.chars().take(NOTE).collect();
    if is_cut {
        text.push_str("...");
    }
    text
}
