//! Admission and retirement: the one thread that admits frames, and writes them in order.

use std::collections::BTreeMap;
use std::sync::Arc;

use crossbeam::channel::Receiver;
use depthloom_graphs::contracts::{Commit, Failure, LiveCommit, Sink, Slot, SlotKey};
use depthloom_graphs::plan::{FrameIndex, NodeId, PartId, Plan, RunId};
use depthloom_graphs::{Fault, Frame, Key};

use crate::error::RunError;
use crate::panics::guarded_sink;
use crate::report::{FrameFailure, Report, StageReport};
use crate::reuse::{Reuse, slot_of};
use crate::stage::Stage;
use crate::stage::frame_graph::{Step, StepId};
use crate::stage::in_flight::{InFlight, Outcome};
use crate::timing::{Phase, Stopwatch, Timing};

/// The report of a stage run, while its frames retire.
pub(crate) struct Ledger<'a> {
    plan: &'a Plan,
    run: RunId,
    pub(crate) stage: StageReport,
    failures: Vec<FrameFailure>,
    /// By step, then the writer's.
    pub(super) timings: Vec<Timing>,
}

impl<'a> Ledger<'a> {
    pub(crate) fn new(plan: &'a Plan, run: RunId, frames: usize, parts: usize) -> Self {
        let nodes = &plan.runs[run].nodes;
        let mut timings = vec![Timing::new(run, "source".to_owned(), Phase::Source)];
        timings.extend(NodeId::enumerate(nodes).map(|(id, node)| Timing::new(run, node.name.clone(), Phase::Node(id))));
        timings.extend(PartId::all(parts).map(|part| Timing::new(run, "encode".to_owned(), Phase::Encode(part))));
        timings.push(Timing::new(run, "write".to_owned(), Phase::Write));
        let stage = StageReport {
            frames: frames as u64,
            firings: vec![0; nodes.len()],
            reused: vec![0; nodes.len()],
            ..StageReport::default()
        };
        Self { plan, run, stage, failures: Vec::new(), timings }
    }

    pub(crate) fn close(self, report: &mut Report) {
        report.stages.push(self.stage);
        let room = Report::FAILURES - report.failures.len().min(Report::FAILURES);
        report.failures.extend(self.failures.into_iter().take(room));
        report.timings.extend(self.timings.into_iter().filter(|t| t.count > 0));
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Completion {
    Complete,
    Interrupted,
}

/// Admits the frames of a stage and writes them in order, until none is left or one ends the stage.
pub(crate) fn retire_all<T: Sink>(
    stage: &Stage<'_, T>,
    done: &Receiver<Arc<InFlight<T::Part>>>,
    ledger: &mut Ledger<'_>,
) -> Result<Completion, RunError> {
    let frames = stage.source.frames();
    let (start, end) = (stage.range.start, stage.range.end);
    let first = stage.reuse.as_ref().map_or(start, Reuse::first).clamp(start, end);
    for frame in &frames[start..first] {
        stage.context.observer.frame_retired(stage.run, frame, &[]);
    }
    stage.start_at(FrameIndex(first));
    stage.repeat_warnings();
    ledger.stage.resumed = (stage.written() - start) as u64;
    ledger.stage.retired = (first - start) as u64;
    let (mut admitted, mut retired) = (first, first);
    let mut complete = BTreeMap::new();
    loop {
        while admitted < end
            && admitted < retired + stage.context.window
            && !stage.context.interrupt.stops_admission()
            && !stage.is_past_the_last(FrameIndex(admitted))
        {
            stage.admit(FrameIndex(admitted), frames[admitted].clone(), None);
            admitted += 1;
            ledger.stage.admitted += 1;
            ledger.stage.peak_in_flight = ledger.stage.peak_in_flight.max(admitted - retired);
        }
        if retired == admitted {
            break;
        }
        let Some(frame) = complete.remove(&FrameIndex(retired)) else {
            // Workers end early only when the run is abandoned.
            let Ok(frame) = done.recv() else { return Err(RunError::Aborted) };
            complete.insert(frame.position, frame);
            continue;
        };
        if stage.context.interrupt.aborts() {
            return Err(RunError::Aborted);
        }
        write(stage, &frame, None, ledger)?;
        retired += 1;
        stage.set_oldest(FrameIndex(retired));
    }
    Ok(if retired == end { Completion::Complete } else { Completion::Interrupted })
}

/// Writes a frame whose steps have all ended.
pub(super) fn write<T: Sink>(
    stage: &Stage<'_, T>,
    in_flight: &InFlight<T::Part>,
    live: Option<LiveCommit>,
    ledger: &mut Ledger<'_>,
) -> Result<(), RunError> {
    let frame = &in_flight.frame;
    let sink_failed =
        |error| RunError::Sink { stage: stage.plan.stage.clone(), what: format!("frame {}", frame.id), error };
    let mut faults = in_flight.take_faults();
    if let Some(fatal) = faults.iter().position(|(step, _)| stage.is_fatal(*step)) {
        let (step, fault) = faults.swap_remove(fatal);
        return Err(frame_failed(stage, step, frame, fault, ledger.plan));
    }
    if let Some(failure) = in_flight.take_audit_failure() {
        return Err(RunError::Audit(failure));
    }
    if let Some(error) = in_flight.take_sink_error() {
        return Err(sink_failed(error));
    }
    let Outcomes { source_key, keys, failures } = outcomes(stage, in_flight, frame, &faults, ledger);
    if in_flight.position.0 >= stage.written() {
        let watch = Stopwatch::start();
        let warnings = in_flight.take_warnings();
        let absent = in_flight.take_absent().into_iter();
        let absent: Vec<Slot> = absent.filter_map(|absent| slot_of(stage.plan, absent)).collect();
        let (keys, failures, absent, warnings) = (&keys, &failures, &absent, &warnings);
        let commit = Commit { run: stage.run, frame, source_key, keys, failures, absent, warnings, live };
        guarded_sink(|| stage.context.sink.write(&commit, in_flight.take_parts())).map_err(sink_failed)?;
        if let Some(timing) = ledger.timings.last_mut() {
            timing.add(frame.index, watch.stop(0));
        }
    }

    ledger.stage.retired += 1;
    ledger.stage.failed += u64::from(!failures.is_empty());
    for (step, fault) in faults {
        if ledger.failures.len() < Report::FAILURES {
            let (node, what) = (step.node(), fault.chain());
            ledger.failures.push(FrameFailure {
                run: ledger.run,
                frame: frame.clone(),
                node,
                what,
                remedy: fault.remedy_text().map(str::to_owned),
            });
        }
    }
    stage.context.observer.frame_retired(stage.run, frame, &failures);
    Ok(())
}

/// The error of a run that ends because a step failed on a frame.
fn frame_failed<T: Sink>(stage: &Stage<'_, T>, step: StepId, frame: &Frame, fault: Fault, plan: &Plan) -> RunError {
    let (run, frame) = (stage.plan, frame.id.to_string());
    match stage.graph.step(step) {
        Step::Node(node) => RunError::of_node(plan, stage.run, &run.nodes[node], Some(frame), fault),
        Step::Source | Step::Encode(_) => {
            let (stage, source_name) = (run.stage.clone(), run.source.name.clone());
            RunError::SourceFailed { stage, source_name, frame, fault: Box::new(fault) }
        }
    }
}

struct Outcomes {
    source_key: Option<Key>,
    keys: Vec<SlotKey>,
    failures: Vec<Failure>,
}

/// How the steps of a frame ended. Counts them, and adds their times.
fn outcomes<T: Sink>(
    stage: &Stage<'_, T>,
    in_flight: &InFlight<T::Part>,
    frame: &Frame,
    faults: &[(StepId, Fault)],
    ledger: &mut Ledger<'_>,
) -> Outcomes {
    let (mut source_key, mut keys, mut failures) = (None, Vec::new(), Vec::new());
    for (step, timing) in StepId::enumerate(&mut ledger.timings) {
        let Some(settled) = (timing.phase != Phase::Write).then(|| in_flight.settled(step)).flatten() else { continue };
        let node = step.node();
        match settled.outcome {
            Outcome::Absent => continue,
            Outcome::Ran(key) => {
                timing.add(frame.index, settled.spent);
                match (stage.graph.step(step), key) {
                    (Step::Source, key) => source_key = key,
                    (Step::Node(node), Some(key)) => {
                        keys.push(SlotKey { node, key });
                        ledger.stage.firings[node] += 1;
                    }
                    (Step::Node(_) | Step::Encode(_), _) => {}
                }
            }
            Outcome::Reused(key) => match node {
                None => source_key = Some(key),
                Some(node) => {
                    keys.push(SlotKey { node, key });
                    ledger.stage.reused[node] += 1;
                }
            },
            Outcome::Failed => {
                timing.add(frame.index, settled.spent);
                let fault = faults.iter().find(|(failed, _)| *failed == step).map(|(_, fault)| fault);
                failures.push(Failure { node, what: fault.map(Fault::chain).unwrap_or_default() });
            }
            Outcome::Skipped(before) => {
                failures.push(Failure { node, what: format!("not run: {} failed", origin(stage, in_flight, before)) });
            }
        }
    }
    Outcomes { source_key, keys, failures }
}

/// The failed step because of which others did not run.
fn origin<T: Sink>(stage: &Stage<'_, T>, frame: &InFlight<T::Part>, mut step: StepId) -> String {
    while let Some(Outcome::Skipped(before)) = frame.settled(step).map(|s| s.outcome) {
        step = before;
    }
    match stage.graph.step(step) {
        Step::Node(node) => format!("`{}`", stage.plan.nodes[node].name),
        Step::Source | Step::Encode(_) => format!("source `{}`", stage.plan.source.name),
    }
}
