//! A part that reads frames or is a node: runs its piece of the plan, with messages as source and sink.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use depthloom_graphs::plan::{NodeId, Plan, RunId};
use depthloom_graphs::ready::{NotReady, Ready, ReadyRun};
use depthloom_graphs::{Fault, Registry, Source, chain};
use depthloom_runner::{Interrupt, Observer, Options, RunError};
use depthloom_terminal::{CliError, ExitCode, say};

use crate::bridge::Bridge;
use crate::channel;
use crate::incoming::{Admitted, Incoming};
use crate::layout::{Part, Role};
use crate::message::of_text;
use crate::outgoing::Outgoing;
use crate::piece::{FrameInput, Piece, node_piece, source_piece};
use crate::report::{Readiness, engines, frames, frames_text};

/// Runs a part until the run ends. Failures are reported to the recorder.
///
/// # Errors
/// If dora is gone, or the part is the recorder or a third-party node.
pub fn run(
    part: &Part,
    plan: &Plan,
    registry: &Registry,
    bridge: &Arc<Bridge>,
    options: &Options,
    interrupt: &Interrupt,
) -> Result<ExitCode, CliError> {
    let gone = |fault: Fault| CliError::new(ExitCode::Engine, fault.chain());
    let made = match part.role {
        Role::Source { run } => source_piece(plan, run, registry),
        Role::Node(node) => node_piece(plan, node, part, registry, bridge, interrupt),
        Role::Foreign(_) | Role::Recorder => {
            return Err(CliError::new(ExitCode::Usage, "this is not a part of the plan"));
        }
    };
    let piece = match made {
        Ok(piece) => piece,
        Err(missing) => {
            let message = |error: &NotReady| (chain(error), error.fault().remedy_text().map(str::to_owned));
            let readiness = Readiness { missing: missing.iter().map(message).collect(), ..Readiness::default() };
            bridge.send(channel::READY, None, &of_text(&readiness.text())).map_err(gone)?;
            bridge.mailbox.wait_for_the_end();
            return Ok(ExitCode::Usage);
        }
    };
    let whole = plan;
    let Piece { mut plan, source, nodes, files, readiness, remedies } = piece;
    bridge.send(channel::READY, None, &of_text(&readiness.text())).map_err(gone)?;
    let source: Box<dyn Source> = match source {
        FrameInput::Read(source) => {
            bridge.send(channel::FRAMES, None, &of_text(&frames_text(source.frames()))).map_err(gone)?;
            let (bridge, interrupt, remedies) = (Arc::clone(bridge), interrupt.clone(), Arc::clone(&remedies));
            Box::new(Admitted { source, bridge, so_far: AtomicUsize::new(0), interrupt, remedies })
        }
        FrameInput::Sent(ports) => {
            let arrived = bridge.mailbox.take(channel::FRAMES, None, &|| interrupt.aborts());
            let frames = match arrived {
                Ok(arrived) => frames(&arrived).map_err(gone)?,
                // The run ended before it began.
                Err(_) => return Ok(ExitCode::Success),
            };
            let _ = bridge.frames.set(frames.clone());
            Box::new(Incoming { bridge: Arc::clone(bridge), frames, ports, interrupt: interrupt.clone() })
        }
        FrameInput::None => {
            if let (Role::Node(node), Some(own)) = (part.role, plan.runs[0].nodes.last_mut()) {
                let Ok(arrived) = bridge.mailbox.take(channel::ENGINES, None, &|| interrupt.aborts()) else {
                    return Ok(ExitCode::Success);
                };
                let engines = engines(&arrived).map_err(gone)?;
                let whole = Ready::from_parts(whole.clone(), Vec::new(), BTreeMap::new(), &engines).plan;
                // Its values then have the keys of a run in one process.
                own.node_hash = whole.runs[node.run].nodes[node.node].node_hash;
            }
            let (frames, ports) = Default::default();
            Box::new(Incoming { bridge: Arc::clone(bridge), frames, ports, interrupt: interrupt.clone() })
        }
    };
    let sink = Outgoing::new(bridge, &plan.runs[0], remedies);
    let ready = Ready {
        plan: plan.clone(),
        runs: vec![ReadyRun { source, nodes }],
        files,
        warnings: Vec::new(),
        builders: BTreeMap::new(),
    };
    let ran = depthloom_runner::run(ready, &sink, options, &ProgressLog { plan: &plan }, interrupt);
    for program in depthloom_nodes::process::take_ended() {
        if let Some(failure) = program.failure {
            say(format_args!("warning: `{}` {failure}", program.command));
        }
    }
    sink.close(&ran).map_err(gone)?;
    bridge.mailbox.wait_for_the_end();
    Ok(match ran {
        Ok(_) | Err(RunError::Aborted) => ExitCode::Success,
        Err(error) if error.is_of_a_frame() => ExitCode::FrameFailures,
        Err(_) => ExitCode::Engine,
    })
}

struct ProgressLog<'a> {
    plan: &'a Plan,
}

impl ProgressLog<'_> {
    fn name(&self, node: NodeId) -> &str {
        self.plan.runs[0].nodes.get(node.0).map_or("", |node| &node.name)
    }
}

impl Observer for ProgressLog<'_> {
    fn progress(&self, _: RunId, node: NodeId, done: u64, total: u64, message: &str) {
        // About twenty lines.
        if done == total || done.is_multiple_of((total / 20).max(1)) {
            say(format_args!("{}: {done}/{total} {message}", self.name(node)));
        }
    }

    fn info(&self, _: RunId, node: NodeId, what: &str) {
        say(format_args!("{}: {what}", self.name(node)));
    }
}
