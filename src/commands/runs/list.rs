//! `depthloom runs`: which runs there are, newest first.

use std::collections::BTreeSet;

use depthloom_runs::{Best, FoundRun, State};
use depthloom_terminal::{CliError, ExitCode, aligned, print, say};
use schemars::JsonSchema;
use serde::Serialize;

use super::all_in;
use crate::args::RunsArgs;
use crate::output;
use crate::sizes::size;

/// Of `runs`: the runs in a folder, newest first.
#[derive(JsonSchema, Serialize)]
pub struct RunsList {
    folder: String,
    runs: Vec<Glance>,
}

/// A run at a glance.
#[derive(JsonSchema, Serialize)]
pub struct Glance {
    name: String,
    path: String,
    time_utc: String,
    state: State,
    experiment: Option<String>,
    /// How many.
    variants: u64,
    frames: u64,
    failed_frames: u64,
    bytes: u64,
    best: Option<Best>,
    /// What is wrong with it.
    trouble: Option<String>,
    /// Why its values may be wrong although it is complete.
    warning: Option<String>,
}

/// Prints a line a run.
pub fn list(args: &RunsArgs) -> Result<ExitCode, CliError> {
    let runs = all_in(args)?;
    let runs: Vec<(&FoundRun, depthloom_runs::Glance)> =
        runs.iter().rev().map(|run| (run, depthloom_runs::Glance::at(run))).collect();
    if args.json {
        let runs = runs.into_iter().map(|(run, glance)| Glance::of(run, glance)).collect();
        output::print(&RunsList { folder: args.folder.to_string_lossy().into_owned(), runs })?;
        return Ok(ExitCode::Success);
    }
    if runs.is_empty() {
        say(format_args!("no runs in {}", args.folder.display()));
        return Ok(ExitCode::Success);
    }
    let head = ["run", "time (UTC)", "experiment", "variants", "frames", "size", "state", "best score"];
    let mut rows = vec![head.map(str::to_owned)];
    rows.extend(runs.iter().map(|(run, glance)| row(run, glance)));
    let mut text = aligned(&rows, &[3, 4, 5]);
    let warnings: BTreeSet<&str> = runs.iter().filter_map(|(_, glance)| glance.warning.as_deref()).collect();
    for warning in warnings {
        text += &format!("* {warning}\n");
    }
    print(text)?;
    Ok(ExitCode::Success)
}

impl Glance {
    fn of(run: &FoundRun, glance: depthloom_runs::Glance) -> Self {
        Self {
            name: run.name.clone(),
            path: run.path.to_string_lossy().into_owned(),
            time_utc: run.time_utc(),
            state: glance.state,
            experiment: glance.experiment,
            variants: glance.variants,
            frames: glance.frames,
            failed_frames: glance.failed,
            bytes: glance.bytes,
            best: glance.best.as_ref().map(Best::of),
            trouble: glance.trouble,
            warning: glance.warning,
        }
    }
}

fn row(run: &FoundRun, glance: &depthloom_runs::Glance) -> [String; 8] {
    let best = glance.best.as_ref();
    let nothing = || "-".to_owned();
    let count = |count: u64| if glance.experiment.is_some() { count.to_string() } else { nothing() };
    let remark = best.map(|best| format!("{} {:.4}  {}", best.metric, best.value, best.label));
    [
        run.name.clone(),
        run.time.format("%Y-%m-%d %H:%M").to_string(),
        glance.experiment.clone().unwrap_or_else(nothing),
        count(glance.variants),
        count(glance.frames),
        size(glance.bytes),
        glance.state_text() + if glance.warning.is_some() { " *" } else { "" },
        glance.trouble.clone().or(remark).unwrap_or_else(nothing),
    ]
}
