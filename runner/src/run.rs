//! A run: its stage runs, one after the other.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::thread::{Builder, scope};

use crossbeam::channel::bounded;
use depthloom_graphs::contracts::{Contract, Sink};
use depthloom_graphs::plan::{NodeId, NodeRef, Plan, RunId};
use depthloom_graphs::ready::{NodeBuilder, Ready, ReadyRun};
use depthloom_graphs::{Instance, Source};

use crate::aggregate::{AggregateWork, Job};
use crate::aggregate_values::AggregateValues;
use crate::audit::Auditor;
use crate::checkpoints::Checkpoints;
use crate::error::RunError;
use crate::interrupt::Interrupt;
use crate::live::capture::capture;
use crate::live::mailbox::{CloseOnDrop, Mailbox};
use crate::live::{Live, LiveReport};
use crate::observer::Observer;
use crate::options::{Audit, Options};
use crate::report::Report;
use crate::run_context::RunContext;
use crate::share::Share;
use crate::stage::frame_graph::FrameGraph;
use crate::stage::ordered::Ordered;
use crate::stage::retire::{Completion, Ledger, retire_all};
use crate::stage::retire_live::retire_live;
use crate::stage::{EndAll, FrameNode, Stage};
use crate::warnings::Warnings;
use depthloom_threads::{Budget, look_for_room};

/// Runs a plan: every frame of every stage run, and its aggregate values, into the sink.
///
/// The calling thread admits frames and writes them. It returns when all threads that it started have ended.
///
/// # Errors
/// Why the run ended early. An interrupted run is not an error: see the report.
pub fn run<T: Sink>(
    ready: Ready,
    sink: &T,
    options: &Options,
    observer: &dyn Observer,
    interrupt: &Interrupt,
) -> Result<Report, RunError> {
    run_all((ready, None), sink, options, observer, interrupt)
}

/// As [`run`], with one stage whose frames arrive by themselves. Its source in `ready` is not read, and nothing of it
/// is reused.
///
/// The first interrupt ends the stream; the run is then complete.
///
/// # Errors
/// As [`run`], and if the stream fails.
pub fn run_live<T: Sink>(
    ready: Ready,
    live: Live,
    sink: &T,
    options: &Options,
    observer: &dyn Observer,
    interrupt: &Interrupt,
) -> Result<Report, RunError> {
    run_all((ready, Some(live)), sink, options, observer, interrupt)
}

fn run_all<T: Sink>(
    (ready, mut live): (Ready, Option<Live>),
    sink: &T,
    options: &Options,
    observer: &dyn Observer,
    interrupt: &Interrupt,
) -> Result<Report, RunError> {
    let Ready { plan, runs, files, builders, .. } = ready;
    let budget = Budget::new(options.workers());
    let checkpoints = Checkpoints::new(options.checkpoints.clone());
    let warnings = Warnings::default();
    let context = RunContext {
        sink,
        budget: &budget,
        observer,
        interrupt,
        warnings: &warnings,
        window: options.window(),
        keep_going: options.keep_going,
        checkpoints: &checkpoints,
        audit: if options.share.is_some() { Audit::None } else { options.audit },
        share: options.share.as_ref(),
    };
    let mut values = AggregateValues::new(files);
    let mut report = Report::default();
    for (run, ready) in RunId::enumerate(runs) {
        if interrupt.stops_admission() {
            report.interrupted = true;
            break;
        }
        observer.stage_started(run, Share::frames(context.share, run, ready.source.as_ref()).len() as u64);
        let stream = live.take_if(|live| live.run == run);
        let completion = run_stage((run, &plan), (ready, &builders), stream, &context, &mut values, &mut report);
        observer.stage_finished(run);
        if completion? == Completion::Interrupted {
            report.interrupted = true;
            break;
        }
    }
    report.warnings = warnings.into_list();
    report.checkpoints = checkpoints;
    Ok(report)
}

fn run_stage<T: Sink>(
    (run, plan): (RunId, &Plan),
    (ready, builders): (ReadyRun, &NodeBuilders),
    live: Option<Live>,
    context: &RunContext<'_, T>,
    values: &mut AggregateValues,
    report: &mut Report,
) -> Result<Completion, RunError> {
    let stage = &plan.runs[run];
    let unrunnable = |what| RunError::Unrunnable { stage: stage.stage.clone(), what };
    let ReadyRun { source, nodes } = ready;
    if nodes.len() != stage.nodes.len() {
        return Err(unrunnable(format!("{} nodes are planned and {} built", stage.nodes.len(), nodes.len())));
    }
    let mut waiting = BTreeMap::new();
    let mut frame_nodes = Vec::with_capacity(nodes.len());
    for (id, (instance, planned)) in NodeId::enumerate(nodes.into_iter().zip(&stage.nodes)) {
        let built = match &instance {
            Instance::Pure(_) => Contract::Pure,
            Instance::Ordered(_) => Contract::Ordered,
            Instance::Once(_) => Contract::Once,
        };
        if built != planned.contract {
            let (contract, built) = (planned.contract.name(), built.name());
            return Err(unrunnable(format!("node `{}` is planned {contract} and built {built}", planned.name)));
        }
        frame_nodes.push(match instance {
            Instance::Pure(node) => FrameNode::Pure(node),
            Instance::Ordered(node) => FrameNode::Ordered(Ordered::new(node, context.window)),
            Instance::Once(node) => {
                waiting.insert(id, node);
                FrameNode::Once
            }
        });
    }

    let mut once = AggregateWork {
        run,
        plan,
        context,
        waiting,
        keys: BTreeMap::new(),
        ran: BTreeSet::new(),
        reused: BTreeSet::new(),
        reported: BTreeMap::new(),
        timings: Vec::new(),
    };
    let frame_count = Share::frames(context.share, run, source.as_ref()).len();
    let mut ledger = Ledger::new(plan, run, frame_count, context.sink.parts(run));
    let mut frames = match live {
        None => Frames::Listed,
        Some(live) => Frames::Live { live, report: &mut report.live },
    };
    let completion = pass(&mut once, source.as_ref(), &mut frames, (frame_nodes, builders), &mut ledger, values);
    for &node in &once.ran {
        ledger.stage.firings[node] = 1;
    }
    for &node in &once.reused {
        ledger.stage.reused[node] = ledger.stage.reused[node].max(1);
    }
    ledger.close(report);
    report.timings.append(&mut once.timings);
    completion
}

type NodeBuilders = BTreeMap<NodeRef, NodeBuilder>;

/// Where the frames of a stage run come from.
enum Frames<'r> {
    /// From its source.
    Listed,
    /// From a stream.
    Live { live: Live, report: &'r mut Option<LiveReport> },
}

/// A stage run from its first frame to its last aggregate value.
fn pass<T: Sink>(
    once: &mut AggregateWork<'_, T>,
    source: &dyn Source,
    frames: &mut Frames<'_>,
    (mut nodes, builders): (Vec<FrameNode<T::Part>>, &NodeBuilders),
    ledger: &mut Ledger<'_>,
    values: &mut AggregateValues,
) -> Result<Completion, RunError> {
    let (run, plan) = (once.run, &once.plan.runs[once.run]);
    let unrunnable = |what| RunError::Unrunnable { stage: plan.stage.clone(), what };
    once.leave_to_others(values);
    // Aggregate nodes that do not depend on this stage's frames come first: nodes of the stage may need their values.
    if once.run_all(values)? == Completion::Interrupted {
        return Ok(Completion::Interrupted);
    }
    let range = Share::frames(once.context.share, run, source);
    let omitted = once.context.share.map(|share| share.omitted(run, plan, &range, values)).unwrap_or_default();
    omitted.iter().for_each(|node| nodes[*node] = FrameNode::Omitted);
    let graph = FrameGraph::new(run, plan, once.context.sink, &omitted, |from| values.find(from))
        .map_err(|error| unrunnable(error.what))?;
    let is_live = matches!(frames, Frames::Live { .. });
    let reuse = if is_live { None } else { once.reuse(&graph, source, range.start) };
    let mut stage = Stage::new(once.context, run, plan, graph, (source, range), nodes, reuse);
    if is_live {
        stage = stage.live();
    }
    if let Some(auditor) = Auditor::new(&stage) {
        let permit = stage.context.budget.permit();
        ledger.stage.audited += auditor.before_frames(builders)?;
        drop(permit);
    }
    if run_frames(&stage, frames, ledger)? == Completion::Interrupted {
        return Ok(Completion::Interrupted);
    }
    if let Some(auditor) = Auditor::new(&stage) {
        let permit = stage.context.budget.permit();
        ledger.stage.audited += auditor.after_frames()?;
        drop(permit);
    }
    let mut jobs = Vec::new();
    let mut reuse = stage.reuse.take();
    for (id, node) in NodeId::enumerate(stage.nodes) {
        let FrameNode::Ordered(ordered) = node else { continue };
        if let Some(finished) = reuse.as_mut().and_then(|reuse| reuse.finished[id].take()) {
            jobs.push((id, Job::Known(finished)));
        } else if let (Some(node), last_key) = ordered.into_state() {
            jobs.push((id, Job::Finish(node, last_key)));
        }
    }
    if once.do_all(jobs, values)? == Completion::Interrupted || once.run_all(values)? == Completion::Interrupted {
        return Ok(Completion::Interrupted);
    }
    if let Some(node) = once.waiting.keys().next() {
        let name = &plan.nodes[*node].name;
        return Err(unrunnable(match once.context.share {
            None => format!("no node before `{name}` computes an aggregate value that it reads"),
            Some(_) => format!("node `{name}` reads an aggregate value that no other process has computed yet"),
        }));
    }
    once.write(values)?;
    ledger.stage.audited += once.audit(builders, values)?;
    Ok(Completion::Complete)
}

/// Runs the frames on workers; this thread admits and writes.
fn run_frames<T: Sink>(
    stage: &Stage<'_, T>,
    frames: &mut Frames<'_>,
    ledger: &mut Ledger<'_>,
) -> Result<Completion, RunError> {
    // Never full: it has room for all frames in flight.
    let (send, done) = bounded(stage.context.window);
    let mailbox = Mailbox::new(Arc::clone(&stage.processing));
    scope(|scope| {
        // Stops the workers on every exit path; otherwise the scope would wait for them.
        let _end_all = EndAll(stage);
        for worker in 0..stage.context.budget.width() {
            let send = send.clone();
            let builder = Builder::new().name(format!("depthloom-{worker}"));
            let started = look_for_room().and_then(|()| builder.spawn_scoped(scope, move || stage.work(&send)));
            started.map_err(RunError::NoThread)?;
        }
        drop(send);
        let Frames::Live { live: Live { stream, options, .. }, report } = frames else {
            return retire_all(stage, &done, ledger);
        };
        // Ends the capturing thread on every exit path.
        let _close = CloseOnDrop(&mailbox);
        let (mailbox, options, interrupt) = (&mailbox, &*options, stage.context.interrupt);
        let capture = move || capture(stream.as_mut(), mailbox, options, interrupt);
        let builder = Builder::new().name("depthloom-capture".to_owned());
        look_for_room().and_then(|()| builder.spawn_scoped(scope, capture)).map_err(RunError::NoThread)?;
        let (completion, live) = retire_live(stage, &done, mailbox, options, ledger)?;
        **report = Some(live);
        Ok(completion)
    })
}
