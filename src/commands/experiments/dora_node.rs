//! `depthloom dora-node`: a node of a dataflow; dora starts it.

use std::sync::Arc;
use std::time::Duration;

use depthloom_dora::{Bridge, BridgeStart, Layout, Mailbox, Role, channel, message, prepare, print_of, run_part};
use depthloom_graphs::Registry;
use depthloom_graphs::contracts::Contract;
use depthloom_runner::{Audit, Interrupt, Options, Unwatched};
use depthloom_terminal::{CliError, ExitCode};

use crate::allow_exec;
use crate::args::DoraNodeArgs;
use crate::execution::{RemoteNodes, carry_out};
use crate::experiment::load;
use crate::signals;

pub(crate) fn dora_node(mut args: DoraNodeArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    std::env::set_current_dir(&args.folder).map_err(|error| {
        CliError::because(ExitCode::Usage, format!("failed to go to {}", args.folder.display()), &error)
    })?;
    args.dora.run.fresh = true;
    let dora = &args.dora;
    let mut loaded = load(&dora.run.experiment, registry, true)?;
    if print_of(&loaded.plan).to_string() != args.plan {
        let what = format!(
            "{} differs from the experiment that the dataflow was written for",
            dora.run.experiment.experiment.display()
        );
        return Err(CliError::usage(
            what,
            "write the dataflow again with `depthloom dora`, and use the same files and program on every machine",
        ));
    }
    allow_exec::decide(dora.run.exec, Some((&dora.run.experiment.experiment, &loaded)))?;
    let layout = Layout::from_plan(&loaded.plan);
    let Some(part) = layout.part(&args.part) else {
        return Err(CliError::new(ExitCode::Usage, format!("the experiment has no part `{}`", args.part)));
    };
    let window = dora.window();
    let limit = Duration::from_secs(dora.start_timeout);
    let wanted = BridgeStart { python: &dora.python, part: &args.part, limit };
    if part.role == Role::Recorder {
        let interrupt = signals::listen("stopping: frames in flight are finished, training is checkpointed")?;
        let bridge = Arc::new(Bridge::start(&wanted, Mailbox::new(interrupt.clone(), true))?);
        let prepared = prepare(loaded.plan.clone(), &layout, &bridge, &interrupt, limit);
        let recorded = prepared.and_then(|(ready, mut remote)| {
            remote.window = window;
            // Most of its threads wait for values.
            let workers = window + Options::default().workers;
            loaded.plan = ready.plan.clone();
            let remote_nodes = RemoteNodes { observer: &remote, workers, window };
            carry_out(&dora.run, loaded, ready, &interrupt, Some(&remote_nodes), &Unwatched, &[]).map(|(exit, _)| exit)
        });
        // No part needs to wait any longer, also after an error. A part that does not receive this notices the end of
        // this process.
        let _ = bridge.send(channel::END, None, &message::of_text("end"));
        return recorded;
    }
    let interrupt = Interrupt::default();
    let bridge = Arc::new(Bridge::start(&wanted, Mailbox::new(interrupt.clone(), false))?);
    // While an aggregate node runs, no other part needs the cores.
    let is_once =
        matches!(part.role, Role::Node(node) if loaded.plan.runs[node.run].nodes[node.node].contract == Contract::Once);
    let usual = if is_once { Options::default().workers } else { 1 };
    let options = Options {
        workers: dora.run.workers.map_or(usual, usize::from),
        window: None,
        // The recorder decides what a failure ends.
        keep_going: true,
        checkpoints: None,
        audit: Audit::None,
        share: None,
    };
    run_part(part, &loaded.plan, registry, &bridge, &options, &interrupt)
}
