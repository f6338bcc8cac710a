//! `depthloom dora`: an experiment as a dataflow of dora's; and `depthloom dora-node`, a node of it.

use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use depthloom_dora::{
    Bridge, BridgeStart, Layout, Mailbox, Role, Wanted, channel, dataflow, message, prepare, print_of, run_part,
    too_large,
};
use depthloom_graphs::Registry;
use depthloom_graphs::contracts::Contract;
use depthloom_graphs::plan::Plan;
use depthloom_nodes::dora::{DoraParams, KIND};
use depthloom_runner::{Audit, Interrupt, Options};
use depthloom_terminal::{Exit, Stop, print_quoted};

use super::check::{is_file, load};
use super::run;
use crate::allow_exec;
use crate::args::{DoraArgs, DoraNodeArgs};
use crate::diagnostics::print_warning;
use crate::signals;

/// How many frames are on their way at most, unless it is said.
const WINDOW: u16 = 8;

/// Prints the dataflow.
pub fn dora(args: &DoraArgs, registry: &Registry) -> Result<Exit, Stop> {
    is_file(&args.run.experiment)?;
    let loaded = load(&args.run.experiment, registry, false)?;
    allow_exec::decide(args.run.exec, Some((&args.run.experiment.experiment, &loaded)))?;
    let plan = loaded.plan;
    may_start(&plan)?;
    let layout = Layout::of(&plan);
    let wanted = Wanted {
        program: text(std::env::current_exe().map_err(|error| before("failed to find this program", &error))?)?,
        arguments: arguments(&plan)?,
        // Of a frame comes one message at most, and of all frames one more.
        queue: usize::from(args.run.window.unwrap_or(WINDOW)) + 8,
        machines: args.machines.clone(),
    };
    let dataflow = dataflow(&plan, &layout, &wanted).map_err(|pattern| {
        let ids: Vec<&str> = layout.parts.iter().map(|part| part.id.as_str()).collect();
        Stop::new(Exit::Before, format!("--machine names `{pattern}`, which is no node of the dataflow"))
            .remedy(format!("its nodes are {}", ids.join(", ")))
    })?;
    if let Some(warning) = too_large(&dataflow) {
        print_warning(&warning);
    }
    print_quoted(&dataflow).map(|()| Exit::Whole)
}

fn before(intent: &str, error: &dyn std::error::Error) -> Stop {
    Stop::because(Exit::Before, intent, error)
}

fn text(words: impl Into<OsString>) -> Result<String, Stop> {
    words.into().into_string().map_err(|words| {
        Stop::new(Exit::Before, format!("{} is no UTF-8, which a dataflow is", Path::new(&words).display()))
    })
}

/// A dataflow starts programs: of a stranger's experiment none that the person did not allow.
fn may_start(plan: &Plan) -> Result<(), Stop> {
    for (run, node) in plan.runs.iter().flat_map(|run| run.nodes.iter().map(move |node| (run, node))) {
        if node.kind == KIND
            && let Ok(params) = serde_json::from_value::<DoraParams>(node.params.clone())
            && let Err(fault) = params.ask()
        {
            let stop =
                Stop::new(Exit::Before, format!("node `{}.{}` ({KIND}): {}", run.stage, node.name, fault.chain()));
            return Err(match fault.remedy_text() {
                Some(remedy) => stop.remedy(remedy),
                None => stop,
            });
        }
    }
    Ok(())
}

/// What every part is given besides its name: what this command was given.
fn arguments(plan: &Plan) -> Result<Vec<String>, Stop> {
    let folder = std::env::current_dir().map_err(|error| before("failed to find the current folder", &error))?;
    let mut words = vec!["--plan".to_owned(), print_of(plan).to_string(), "--folder".to_owned(), text(folder)?];
    // Options of the program stand before its command, and none of them has a value of that name.
    let mut given = std::env::args_os().skip_while(|word| word != "dora").skip(1);
    while let Some(word) = given.next() {
        let word = text(word)?;
        // Where a part runs is for dora to know.
        if word == "--machine" {
            given.next();
        } else if !word.starts_with("--machine=") {
            words.push(word);
        }
    }
    Ok(words)
}

/// Is a node of the dataflow.
pub fn dora_node(mut args: DoraNodeArgs, registry: &Registry) -> Result<Exit, Stop> {
    std::env::set_current_dir(&args.folder)
        .map_err(|error| before(&format!("failed to go to {}", args.folder.display()), &error))?;
    args.dora.run.fresh = true;
    let dora = &args.dora;
    let mut loaded = load(&dora.run.experiment, registry, true)?;
    if print_of(&loaded.plan).to_string() != args.plan {
        let what = format!(
            "{} is another experiment than the dataflow was written of",
            dora.run.experiment.experiment.display()
        );
        return Err(Stop::new(Exit::Before, what).remedy(
            "write the dataflow anew by `depthloom dora`, and have the same files and program on every machine",
        ));
    }
    allow_exec::decide(dora.run.exec, Some((&dora.run.experiment.experiment, &loaded)))?;
    let layout = Layout::of(&loaded.plan);
    let Some(part) = layout.part(&args.part) else {
        return Err(Stop::new(Exit::Before, format!("the experiment has no part `{}`", args.part)));
    };
    let window = usize::from(dora.run.window.unwrap_or(WINDOW));
    let limit = Duration::from_secs(dora.start_timeout);
    let wanted = BridgeStart { python: &dora.python, part: &args.part, limit };
    if part.role == Role::Recorder {
        let interrupt = signals::listen("stopping: frames in flight are finished, learning is put down")?;
        let bridge = Arc::new(Bridge::start(&wanted, Mailbox::new(interrupt.clone(), true))?);
        let prepared = prepare(loaded.plan.clone(), &layout, &bridge, &interrupt, limit);
        let recorded = prepared.and_then(|(ready, mut remote)| {
            remote.window = window;
            // Most of its threads wait for values.
            let workers = window + Options::default().workers;
            loaded.plan = ready.plan.clone();
            let elsewhere = run::Elsewhere { observer: &remote, workers, window };
            run::carry_out(&dora.run, loaded, ready, &interrupt, Some(&elsewhere))
        });
        // Whatever happened, nobody needs to wait. Who does not hear it hears that this ends.
        let _ = bridge.send(channel::END, None, &message::of_text("end"));
        return recorded;
    }
    let interrupt = Interrupt::default();
    let bridge = Arc::new(Bridge::start(&wanted, Mailbox::new(interrupt.clone(), false))?);
    // What fires once has nobody beside it who could work in the meantime.
    let is_once =
        matches!(part.role, Role::Node { run, node } if loaded.plan.runs[run].nodes[node].contract == Contract::Once);
    let usual = if is_once { Options::default().workers } else { 1 };
    let options = Options {
        workers: dora.run.workers.map_or(usual, usize::from),
        window: None,
        // The recorder decides what a failure ends.
        keep_going: true,
        checkpoints: None,
        audit: Audit::None,
    };
    run_part(part, &loaded.plan, registry, &bridge, &options, &interrupt)
}
