//! `depthloom runs`: which runs there are, newest first.

use std::collections::BTreeSet;

use serde_json::json;

use crate::args::RunsArgs;
use crate::columns::aligned;
use crate::exit::{Exit, Stop};
use crate::outputs::Output;
use crate::runs::{FoundRun, Glance, all};
use crate::sizes::size;
use crate::streams::{print, print_output, say};

/// Prints a line a run.
pub fn list(args: &RunsArgs) -> Result<Exit, Stop> {
    let runs = all_in(args)?;
    let runs: Vec<(&FoundRun, Glance)> = runs.iter().rev().map(|run| (run, Glance::at(run))).collect();
    if args.json {
        let runs: Vec<_> = runs.iter().map(|(run, glance)| glance.json(run)).collect();
        print_output(Output::RunsList, json!({ "folder": args.folder.to_string_lossy(), "runs": runs }))?;
        return Ok(Exit::Whole);
    }
    if runs.is_empty() {
        say(format_args!("no runs in {}", args.folder.display()));
        return Ok(Exit::Whole);
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
    Ok(Exit::Whole)
}

fn row(run: &FoundRun, glance: &Glance) -> [String; 8] {
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

/// The runs of the folder, oldest first.
pub(super) fn all_in(args: &RunsArgs) -> Result<Vec<FoundRun>, Stop> {
    all(&args.folder).map_err(|error| {
        let stop = Stop::because(Exit::Before, format_args!("failed to list {}", args.folder.display()), &error);
        stop.remedy("runs lie in `runs` where `depthloom run` was called without --out; name another folder with --in")
    })
}
