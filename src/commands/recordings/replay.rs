//! `depthloom replay`: nodes made again from a recording, and compared with it.

use std::sync::Arc;

use depthloom_graphs::Registry;
use depthloom_graphs::language::nearest;
use depthloom_recording::Recording;
use depthloom_runner::{Options, run};
use depthloom_runs::{open, recording_of, run_failed};
use depthloom_terminal::{CliError, ExitCode, print, say};
use depthloom_verify::{Checker, ComparedNode, OtherNode, Outcome, Report, SHOWN, Tolerances, Unchecked, node_name};
use schemars::JsonSchema;
use serde::Serialize;

use crate::allow_exec;
use crate::args::ReplayArgs;
use crate::output;
use crate::output::diagnostics::Error;
use crate::output::progress::Progress;
use crate::signals;

/// Of `replay`: whether nodes make again what was recorded.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Replay {
    run: String,
    /// The nodes that were named.
    asked: Vec<String>,
    equal: bool,
    /// Of how many frames values were kept.
    every: u64,
    nodes: Vec<ComparedNode>,
    not_compared: Vec<OtherNode>,
    failed: Vec<OtherNode>,
    damage: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// Makes nodes again and says whether their values are those recorded.
pub(crate) fn replay(args: &ReplayArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    allow_exec::decide(args.exec, None)?;
    let path = recording_of(&args.run, "replay")?;
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
        return Err(CliError::new(ExitCode::Interrupted, "interrupted: not all was compared"));
    }

    let Outcome { checked, behind, failed, mut damage } = checker.finish();
    damage.extend(unchecked.iter().filter(|unchecked| unchecked.is_damage).map(|unchecked| unchecked.why.clone()));
    let unchecked = unchecked.into_iter().chain(behind).collect();
    let report = Report { recording: &recording, checked, unchecked, failed, damage };
    let verdict = report.verdict().map(|what| CliError::new(ExitCode::FrameFailures, what));
    if args.output.json {
        output::print(&Replay {
            run: args.run.to_string_lossy().into_owned(),
            asked: args.nodes.clone(),
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
    // What a damaged recording lost was not compared.
    let of_condition = depthloom_runs::end([&*recording]);
    Ok(verdict.map_or(of_condition, |stop| {
        say(&stop);
        stop.exit
    }))
}

/// What is to be said where a pattern names no node.
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

/// Refuses what would pass without a comparison: nothing at all to compare, or not what was asked for by name.
fn refuse(
    args: &ReplayArgs,
    recording: &Recording,
    replay: &depthloom_verify::Replay,
    unchecked: &[Unchecked],
) -> Result<(), CliError> {
    let is_named = |node: &Unchecked| {
        let run = &recording.plan().runs[node.node.run];
        let name = &run.nodes[node.node.node].name;
        args.nodes.iter().any(|of| of == name || *of == format!("{}.{name}", run.stage))
    };
    let compares = replay.nodes.iter().flatten().any(|node| node.expected.iter().any(Option::is_some));
    let described = |node: &Unchecked| format!("`{}`: {}", node_name(recording, node.node), node.why);
    let in_the_way = unchecked.iter().find(|node| is_named(node)).or_else(|| unchecked.first().filter(|_| !compares));
    match in_the_way {
        Some(node) if node.is_damage => {
            Err(CliError::new(ExitCode::FrameFailures, format!("the recording is damaged: {}", described(node))))
        }
        Some(node) => Err(CliError::usage(
            format!("cannot make again {}", described(node)),
            "`record:` of the experiment says what is recorded; without names, the nodes that can be are compared",
        )),
        None if !compares => Err(CliError::new(ExitCode::Usage, "nothing is recorded that could be compared")),
        None => Ok(()),
    }
}
