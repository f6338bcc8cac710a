//! `depthloom runs`: which runs there are, newest first.

use depthloom_runs::{Best, FoundRun, Glance};
use depthloom_terminal::{CliError, ExitCode, aligned, print, say, size};
use schemars::JsonSchema;
use serde::Serialize;

use super::all_in;
use crate::args::RunsArgs;
use crate::output;

/// Output of `runs`: the runs in a folder, newest first.
#[derive(JsonSchema, Serialize)]
pub(crate) struct RunsList {
    folder: String,
    runs: Vec<Glance>,
}

pub(super) fn list(args: &RunsArgs) -> Result<ExitCode, CliError> {
    let runs = all_in(args)?;
    let glances: Vec<Glance> = runs.iter().rev().map(Glance::at).collect();
    if args.json {
        output::print(&RunsList { folder: args.folder.path().to_string_lossy().into_owned(), runs: glances })?;
        return Ok(ExitCode::Success);
    }
    if runs.is_empty() {
        say(format_args!("no runs in {}", args.folder.path().display()));
        return Ok(ExitCode::Success);
    }
    let head = ["run", "time (UTC)", "experiment", "variants", "frames", "size", "state", "best score"];
    let mut rows = vec![head.map(str::to_owned)];
    rows.extend(runs.iter().rev().zip(&glances).map(|(run, glance)| row(run, glance)));
    let text = aligned(&rows, &[3, 4, 5]);
    print(text)?;
    Ok(ExitCode::Success)
}

fn row(run: &FoundRun, glance: &Glance) -> [String; 8] {
    let nothing = || "-".to_owned();
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
        glance.trouble.clone().or(remark).unwrap_or_else(nothing),
    ]
}
