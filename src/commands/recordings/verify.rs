//! `depthloom verify`: recomputes nodes from a recording and compares the values with it.

use std::sync::Arc;

use depthloom_graphs::Registry;
use depthloom_graphs::language::nearest;
use depthloom_recording::{Condition, Recording};
use depthloom_runner::{Options, run};
use depthloom_runs::{open, run_failed};
use depthloom_terminal::{CliError, ExitCode, print, say};
use depthloom_verify::{Checker, ComparedNode, OtherNode, Outcome, Report, SHOWN, Tolerances, Unchecked, node_name};
use schemars::JsonSchema;
use serde::Serialize;

use crate::allow_exec;
use crate::args::VerifyArgs;
use crate::output;
use crate::output::diagnostics::Error;
use crate::output::progress::Progress;
use crate::signals;

/// Output of `verify`: whether recomputed values equal the recorded ones.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Verify {
    run: String,
    /// The nodes that were named on the command line.
    requested: Vec<String>,
    equal: bool,
    /// Values of one in this many frames were recorded.
    every: u64,
    nodes: Vec<ComparedNode>,
    not_compared: Vec<OtherNode>,
    failed: Vec<OtherNode>,
    damage: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// Recomputes nodes and compares their values with the recorded ones.
pub(crate) fn verify(args: &VerifyArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    allow_exec::decide(args.exec, None)?;
    let path = args.run.recording("verify")?;
    let interrupt = signals::listen("stopping: nothing is written")?;
    let recording = Arc::new(open(&path)?);
    let mut replay = depthloom_verify::Replay::new(&recording, registry, &args.nodes)
        .map_err(|pattern| unknown(&recording, &pattern))?;
    let unchecked = std::mem::take(&mut replay.unchecked);
    refuse(args, &recording, &replay, &unchecked)?;

    let default = Options::default();
    let options = Options { workers: args.workers.map_or(default.workers, usize::from), keep_going: true, ..default };
    let progress = Progress::new(&replay.ready.plan, true);
    let checker = Checker::new(Arc::clone(&recording), &mut replay, Tolerances::new(&args.tolerance));
    let report = run(replay.ready, &checker, &options, &progress, &interrupt).map_err(|error| run_failed(&error))?;
    if report.interrupted {
        return Err(CliError::new(ExitCode::Interrupted, "interrupted: not all values were compared"));
    }

    let Outcome { checked, behind, failed, mut damage } = checker.finish();
    damage.extend(unchecked.iter().filter(|unchecked| unchecked.is_damage).map(|unchecked| unchecked.why.clone()));
    let unchecked = unchecked.into_iter().chain(behind).collect();
    let report = Report { recording: &recording, checked, unchecked, failed, damage };
    let verdict = report.verdict().map(|what| CliError::new(ExitCode::FrameFailures, what));
    if args.output.json {
        output::print(&Verify {
            run: args.run.to_string_lossy().into_owned(),
            requested: args.nodes.clone(),
            equal: report.is_equal(),
            every: recording.plan().every,
            nodes: report.compared(),
            not_compared: report.others(&report.unchecked),
            failed: report.others(&report.failed),
            damage: report.damage.clone(),
            error: verdict.as_ref().map(Error::from),
        })?;
    } else {
        print(report.text())?;
        report.damage.iter().take(SHOWN).for_each(|what| say(format_args!("damaged: {what}")));
    }
    if let unfinished @ Condition::Unfinished { .. } = recording.condition() {
        say(format_args!("warning: {} is {unfinished}; only complete frames were compared", path.display()));
    }
    // Lost frames of a damaged recording were not compared.
    let exit = depthloom_runs::end([&*recording]);
    Ok(verdict.map_or(exit, |stop| {
        say(&stop);
        stop.exit
    }))
}

/// The error for a pattern that matches no node.
fn unknown(recording: &Recording, pattern: &str) -> CliError {
    let runs = &recording.plan().runs;
    let names: Vec<String> = runs
        .iter()
        .flat_map(|run| run.nodes.iter().flat_map(|node| [node.name.clone(), format!("{}.{}", run.stage, node.name)]))
        .collect();
    let mut nodes: Vec<&str> = runs.iter().flat_map(|run| &run.nodes).map(|node| node.name.as_str()).collect();
    nodes.sort_unstable();
    nodes.dedup();
    let near = nearest(pattern, names.iter().map(String::as_str));
    let what = format!("the recording has no node `{pattern}`");
    CliError::unknown(what, near, format!("its nodes are {}", nodes.join(", ")))
}

/// Refuses a request that would compare nothing, or not every node that was named.
fn refuse(
    args: &VerifyArgs,
    recording: &Recording,
    replay: &depthloom_verify::Replay,
    unchecked: &[Unchecked],
) -> Result<(), CliError> {
    if recording.is_empty() {
        return Err(CliError::new(ExitCode::Usage, "the recording has no complete frame that could be compared"));
    }
    let is_named = |node: &Unchecked| {
        let run = &recording.plan().runs[node.node.run];
        let name = &run.nodes[node.node.node].name;
        args.nodes.iter().any(|pattern| pattern == name || *pattern == format!("{}.{name}", run.stage))
    };
    let compares = replay.nodes.iter().flatten().any(|node| node.expected.iter().any(Option::is_some));
    let described = |node: &Unchecked| format!("`{}`: {}", node_name(recording, node.node), node.why);
    let in_the_way = unchecked.iter().find(|node| is_named(node)).or_else(|| unchecked.first().filter(|_| !compares));
    match in_the_way {
        Some(node) if node.is_damage => {
            Err(CliError::new(ExitCode::FrameFailures, format!("the recording is damaged: {}", described(node))))
        }
        Some(node) if args.nodes.is_empty() => Err(CliError::usage(
            format!("no node of the recording can be recomputed, among them {}", described(node)),
            "`record:` of the experiment selects what is recorded; the inputs of a node are needed to recompute it",
        )),
        Some(node) => Err(CliError::usage(
            format!("cannot recompute {}", described(node)),
            "`record:` of the experiment selects what is recorded; without names, all nodes that can be recomputed are compared",
        )),
        None if !compares => Err(CliError::new(ExitCode::Usage, "the recording has no values that could be compared")),
        None => Ok(()),
    }
}
