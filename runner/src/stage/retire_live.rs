//! Admission and retirement of a live stage: takes the newest frame when there is room, and writes frames in order.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, after, never, select};
use depthloom_graphs::contracts::{Drops, LiveCommit, Sink, Slot};
use depthloom_graphs::plan::FrameIndex;

use super::retire::{Completion, Ledger, write};
use crate::error::RunError;
use crate::live::latency::Meters;
use crate::live::mailbox::{Arrival, Mailbox};
use crate::live::{LiveOptions, LiveReport, LiveStatus, WindowControl};
use crate::stage::Stage;
use crate::stage::frame_graph::StepId;
use crate::stage::in_flight::{InFlight, LiveArrival};
use crate::timing::Phase;

/// The time between two reports to the observer, which is also the period of the window's trials.
const PERIOD: Duration = Duration::from_millis(500);

/// A live stage while its frames run.
struct LiveStage<'s, 'a, T: Sink> {
    stage: &'s Stage<'a, T>,
    mailbox: &'s Mailbox,
    deadline: Option<Duration>,
    window: WindowControl,
    meters: Meters,
    /// The steps of the estimates, or all nodes.
    estimates: Vec<StepId>,
    admitted: usize,
    written: usize,
    drops: Drops,
    misses: u64,
    first_frame_ns: u64,
    /// The time stamp of the last frame.
    last_time_ns: Option<u64>,
    started: Instant,
    period: Period,
}

/// What happened since the last report to the observer.
struct Period {
    started: Instant,
    offered: u64,
    written: usize,
    drops: Drops,
}

/// Admits frames as they arrive and writes them in order, until no more arrive.
pub(crate) fn retire_live<T: Sink>(
    stage: &Stage<'_, T>,
    done: &Receiver<Arc<InFlight<T::Part>>>,
    mailbox: &Mailbox,
    options: &LiveOptions,
    ledger: &mut Ledger<'_>,
) -> Result<(Completion, LiveReport), RunError> {
    let mut live = LiveStage::new(stage, mailbox, options, ledger);
    let mut complete: BTreeMap<FrameIndex, Arc<InFlight<T::Part>>> = BTreeMap::new();
    let mut has_ended = false;
    loop {
        while !has_ended && live.admitted < live.written + live.window.window() {
            match mailbox.take() {
                Arrival::Frame(frame, drops) => live.admit(*frame, drops),
                Arrival::Nothing => break,
                Arrival::Ended(drops) => {
                    live.drops += drops;
                    has_ended = true;
                }
            }
        }
        ledger.stage.peak_in_flight = ledger.stage.peak_in_flight.max(live.admitted - live.written);
        mailbox.take_warnings().iter().for_each(|warning| live.warn(warning));
        live.end_period_if_due();
        if stage.context.interrupt.aborts() {
            return Err(RunError::Aborted);
        }
        if let Some(frame) = complete.remove(&FrameIndex(live.written)) {
            live.write(&frame, ledger)?;
            continue;
        }
        let is_idle = live.admitted == live.written;
        if has_ended && is_idle {
            break;
        }
        // The end of the stream may only be seen once there is room for its last frame.
        let has_room = live.admitted < live.written + live.window.window();
        let arrivals = if has_room && !has_ended { mailbox.arrivals() } else { &never() };
        select! {
            recv(done) -> frame => {
                // Workers end early only when the run is abandoned.
                let Ok(frame) = frame else { return Err(RunError::Aborted) };
                complete.insert(frame.position, frame);
            }
            recv(arrivals) -> _ => {}
            recv(after(PERIOD / 4)) -> _ => {}
        }
    }
    stage.context.interrupt.take_back();
    ledger.stage.admitted = live.admitted as u64;
    ledger.stage.frames = live.admitted as u64;
    let report = live.report();
    match mailbox.take_fault() {
        Some(fault) => Err(RunError::StreamFailed {
            stage: stage.plan.stage.clone(),
            source_name: stage.plan.source.name.clone(),
            frames: report.processed,
            fault: Box::new(fault),
        }),
        None => Ok((Completion::Complete, report)),
    }
}

impl<'s, 'a, T: Sink> LiveStage<'s, 'a, T> {
    fn new(stage: &'s Stage<'a, T>, mailbox: &'s Mailbox, options: &LiveOptions, ledger: &Ledger<'_>) -> Self {
        let estimates = stage.plan.estimates.iter().map(|estimate| estimate.estimate);
        let mut steps: Vec<StepId> =
            estimates.filter(|slot| matches!(slot, Slot::Node { .. })).map(StepId::of_slot).collect();
        if steps.is_empty() {
            steps = (1..stage.graph.producers.len()).map(StepId).collect();
        }
        let most = stage.context.window;
        let window = match options.window {
            Some(window) => WindowControl::fixed(window.clamp(1, most)),
            None => WindowControl::new(most),
        };
        let now = Instant::now();
        Self {
            stage,
            mailbox,
            deadline: options.deadline,
            window,
            meters: Meters::new(ledger.timings.iter().map(|timing| (timing.label.clone(), timing.phase))),
            estimates: steps,
            admitted: 0,
            written: 0,
            drops: Drops::default(),
            misses: 0,
            first_frame_ns: 0,
            last_time_ns: None,
            started: now,
            period: Period { started: now, offered: 0, written: 0, drops: Drops::default() },
        }
    }

    fn admit(&mut self, frame: depthloom_graphs::contracts::StreamFrame, drops: Drops) {
        if self.last_time_ns.replace(frame.frame.time_ns).is_some_and(|last| frame.frame.time_ns < last) {
            self.warn("the time stamp precedes that of the frame before");
        }
        let read = std::sync::Mutex::new(Some(frame.read));
        let arrival = LiveArrival { read, captured: frame.captured, drops };
        self.stage.admit(FrameIndex(self.admitted), frame.frame, Some(arrival));
        self.admitted += 1;
        self.drops += drops;
    }

    /// Warns of the source.
    fn warn(&self, what: &str) {
        let Stage { context, run, .. } = self.stage;
        if context.warnings.add(*run, None, what, 0, true) {
            context.observer.warned(*run, None, what);
        }
    }

    fn write(&mut self, frame: &InFlight<T::Part>, ledger: &mut Ledger<'_>) -> Result<(), RunError> {
        let Some(LiveArrival { captured, drops, .. }) = &frame.arrival else { return Ok(()) };
        let since =
            |ended: Instant| u64::try_from(ended.saturating_duration_since(*captured).as_nanos()).unwrap_or(u64::MAX);
        let ended = |step: StepId| frame.settled(step).and_then(|settled| settled.spent.ended);
        let latest = self.estimates.iter().filter_map(|step| ended(*step)).max();
        let latency_ns = latest.map_or(0, since);
        let commit = LiveCommit { drops: *drops, latency_ns };
        let writing = Instant::now();
        write(self.stage, frame, Some(commit), ledger)?;
        self.written += 1;
        self.stage.set_oldest(FrameIndex(self.written));
        if self.written == 1 {
            self.first_frame_ns = latency_ns;
            self.mailbox.set_warm();
            let now = Instant::now();
            (self.period.started, self.period.written, self.period.offered) = (now, 1, self.mailbox.offered());
            return Ok(());
        }
        if latest.is_some() {
            self.meters.frames.add(latency_ns);
            self.misses +=
                u64::from(self.deadline.is_some_and(|deadline| u128::from(latency_ns) > deadline.as_nanos()));
        }
        for (step, timing) in StepId::enumerate(&ledger.timings) {
            if timing.phase == Phase::Write {
                let now = Instant::now();
                let wall = now.saturating_duration_since(writing).as_nanos();
                self.meters.add_step(step.0, since(now), u64::try_from(wall).unwrap_or(u64::MAX));
            } else if let Some(settled) = frame.settled(step)
                && let Some(ended) = settled.spent.ended
            {
                self.meters.add_step(step.0, since(ended), settled.spent.wall_ns);
            }
        }
        Ok(())
    }

    /// Reports to the observer, and lets the window follow the rate.
    fn end_period_if_due(&mut self) {
        let now = Instant::now();
        let elapsed = now.saturating_duration_since(self.period.started);
        if elapsed < PERIOD {
            return;
        }
        let offered = self.mailbox.offered();
        let hz = |frames: u64| frames as f64 / elapsed.as_secs_f64();
        let processed_hz = hz((self.written - self.period.written) as u64);
        let offered_hz = hz(offered - self.period.offered);
        let dropped = (self.drops.graph - self.period.drops.graph) as f64;
        self.window.end_period(processed_hz, dropped / (offered - self.period.offered).max(1) as f64);
        let (frames, steps) = self.meters.take_lately();
        let status = LiveStatus {
            elapsed: now.saturating_duration_since(self.started),
            offered,
            processed: self.written as u64,
            drops: self.drops,
            offered_hz,
            processed_hz,
            window: self.window.window(),
            frames,
            steps,
        };
        self.period = Period { started: now, offered, written: self.written, drops: self.drops };
        self.stage.context.observer.live(self.stage.run, &status);
    }

    fn report(&self) -> LiveReport {
        LiveReport {
            run: self.stage.run,
            elapsed: self.started.elapsed(),
            offered: self.mailbox.offered(),
            processed: self.written as u64,
            drops: self.drops,
            deadline: self.deadline.map(|deadline| (deadline, self.misses)),
            window: self.window.window(),
            first_frame_ns: self.first_frame_ns,
            frames: self.meters.frames.all.latency(),
            steps: self.meters.steps(),
            bottleneck: self.meters.bottleneck().filter(|_| self.drops.graph > 0),
        }
    }
}
