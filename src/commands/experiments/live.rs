//! `depthloom live`: one stage of an experiment at the rate of its source.

use std::collections::BTreeSet;

use depthloom_graphs::contracts::{Slot, StreamingSource};
use depthloom_graphs::language::nearest;
use depthloom_graphs::plan::{NodeId, Origin, Plan, PortId, RunId};
use depthloom_graphs::ready::{LiveInput, Ready};
use depthloom_graphs::{Fault, Rate, Registry, ValueType, counted};
use depthloom_runner::{Interrupt, Live, LiveOptions, Pace, Paced, Playback};
use depthloom_terminal::{CliError, ExitCode, say};

use crate::allow_exec;
use crate::args::LiveArgs;
use crate::execution::live::{RingTrigger, carry_out, is_silent};
use crate::experiment::{is_file, load};
use crate::process_limits;
use crate::signals;

/// Loads, plans, opens, runs live, records and prints.
pub(crate) fn live(args: &LiveArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let interrupt = signals::listen("stopping: the stream ends, frames in flight are finished")?;
    let trigger = args.keep.map(|_| RingTrigger::listen(args.on)).transpose()?;
    is_file(&args.experiment)?;
    process_limits::apply(&args.limits)?;
    let mut loaded = load(&args.experiment, registry, is_silent(args))?;
    let run = run_of(&loaded.plan, args.stage.as_deref())?;
    let hidden = record_only(&mut loaded.plan, run, args.scores);
    allow_exec::decide(args.exec, Some((&args.experiment.experiment, &loaded)))?;
    let (ready, input) =
        Ready::live(loaded.plan.clone(), registry, run).map_err(|missing| CliError::of_missing(&missing))?;
    let stream = stream(args, input, hidden, &loaded.plan.runs[run].source.name, &interrupt)?;
    let options = LiveOptions {
        duration: args.duration,
        no_drop: args.no_drop,
        deadline: args.deadline,
        window: args.window.map(usize::from),
    };
    carry_out(args, loaded, ready, Live { run, stream, options }, &interrupt, trigger.as_ref())
}

/// The stage to run live.
fn run_of(plan: &Plan, stage: Option<&str>) -> Result<RunId, CliError> {
    let names = || plan.runs.iter().map(|run| run.stage.as_str());
    let Some(last) = plan.runs.last() else {
        return Err(CliError::usage("the experiment has no stage", "add one under `stages`"));
    };
    let name = stage.unwrap_or(&last.stage);
    let runs: Vec<RunId> =
        RunId::enumerate(&plan.runs).filter(|(_, run)| run.stage == name).map(|(run, _)| run).collect();
    match runs.as_slice() {
        [run] => Ok(*run),
        [] => {
            let near = nearest(name, names()).map_or_else(
                || format!("its stages are {}", names().collect::<Vec<_>>().join(", ")),
                |near| format!("did you mean `{near}`?"),
            );
            Err(CliError::usage(format!("--stage `{name}`: the experiment has no such stage"), near))
        }
        several => {
            let count = counted(several.len() as u64, "source");
            Err(CliError::usage(
                format!("stage `{name}` has {count}, because its variants read different ones: one can run live"),
                "choose variants that read the same source with --variant",
            ))
        }
    }
}

/// Ends the plan with the live stage, and records the maps of that stage only. Returns the outputs of its source that
/// are hidden: what a camera does not measure and only scores read, unless the stage is scored.
fn record_only(plan: &mut Plan, live: RunId, has_scores: bool) -> Vec<&'static str> {
    plan.runs.truncate(live.0 + 1);
    for (run, stage) in RunId::enumerate(&mut plan.runs) {
        if run != live {
            let outputs = stage.nodes.iter_mut().flat_map(|node| &mut node.outputs).chain(&mut stage.source.outputs);
            outputs.filter(|output| output.port.rate == Rate::Frame).for_each(|output| output.recorded = false);
        }
    }
    let stage = &mut plan.runs[live];
    let score_nodes: BTreeSet<NodeId> = stage.estimates.iter().map(|estimate| estimate.score_node).collect();
    let nodes = NodeId::enumerate(&stage.nodes).filter(|(node, _)| !score_nodes.contains(node));
    let read: BTreeSet<PortId> = nodes
        .flat_map(|(_, node)| &node.inputs)
        .filter_map(|input| match input.from {
            Some(Origin::Here(Slot::Source { port })) => Some(port),
            _ => None,
        })
        .collect();
    let mut hidden = Vec::new();
    for (id, output) in PortId::enumerate(&mut stage.source.outputs) {
        let is_of_a_camera = matches!(output.port.value_type, ValueType::Image | ValueType::Calibration);
        if !has_scores && !is_of_a_camera && !read.contains(&id) {
            // Nodes that read it do not run.
            output.port.optional = true;
            hidden.push(output.port.name);
        }
    }
    hidden
}

/// The frames: a stream as it is, a data set at a rate.
fn stream(
    args: &LiveArgs,
    input: LiveInput,
    hidden: Vec<&'static str>,
    name: &str,
    interrupt: &Interrupt,
) -> Result<Box<dyn StreamingSource>, CliError> {
    let source = match input {
        LiveInput::Listed(source) => source,
        LiveInput::Stream(stream) => {
            let options = [("--rate", args.rate.is_some()), ("--preload", args.preload > 0), ("--repeat", args.repeat)];
            if let Some((option, _)) = options.iter().find(|(_, is_given)| *is_given) {
                let what = format!("{option} is for data sets, and source `{name}` streams");
                return Err(CliError::usage(what, "leave it out"));
            }
            return Ok(stream);
        }
    };
    let pace = args.rate.map_or(Pace::TimeStamps, Pace::Rate);
    let (preload, repeat, no_drop) = (args.preload, args.repeat, args.no_drop);
    if preload > 0 && !is_silent(args) {
        say(format_args!("reading {} into memory", counted(preload as u64, "frame")));
    }
    let paced = Paced::new(source, Playback { pace, preload, repeat, no_drop, hidden }, interrupt);
    let paced = paced.map_err(|fault| match fault {
        Fault::Cancelled => CliError::new(ExitCode::Interrupted, "interrupted before the first frame"),
        fault @ Fault::Failed(_) => CliError::remedied(ExitCode::Usage, format!("source `{name}`"), &fault),
    })?;
    Ok(Box::new(paced))
}
