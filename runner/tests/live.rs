//! A live stage: equal to a batch run, drops counted, bounded, ended in every way.

mod support;

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use depthloom_graphs::contracts::{
    Commit, Contract, Drops, ErrorMessage, LiveCommit, NextFrame, NodeWarning, Sink, Slot, StreamFrame, StreamingSource,
};
use depthloom_graphs::plan::{FrameIndex, PartId, RunId};
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Key, Outputs, PureNode, Value};
use depthloom_runner::{
    Audit, Interrupt, Live, LiveOptions, LiveReport, LiveStatus, Observer, Options, Pace, Paced, Playback, Report,
    RunError, Unwatched, run, run_live,
};
use support::{Bench, Notebook, Numbers, Toy, node, number, planned, source};

fn options(workers: usize) -> Options {
    Options { workers, window: None, keep_going: true, checkpoints: None, audit: Audit::None, share: None }
}

/// A pure node after an ordered one.
fn bench(frames: u64) -> Bench {
    let mut bench = Bench::new(&[""]);
    bench.stage("fly", Numbers::new(frames));
    bench.toy("a", Contract::Pure, [source(0), None, None], Toy { tiles: 5, ..Toy::salted(1) });
    bench.toy("b", Contract::Ordered, [node(0, 0), source(1), None], Toy::salted(2));
    bench.toy("c", Contract::Pure, [node(1, 0), node(0, 1), None], Toy::salted(3));
    bench
}

fn played(frames: u64, rate: f64, no_drop: bool) -> Box<dyn StreamingSource> {
    let playback = Playback { pace: Pace::Rate(rate), preload: 0, repeat: false, no_drop, hidden: Vec::new() };
    let paced = Paced::new(Box::new(Numbers::new(frames)), playback, &Interrupt::default());
    Box::new(paced.expect("it has frames"))
}

fn live(stream: Box<dyn StreamingSource>, options: LiveOptions) -> Live {
    Live { run: RunId(0), stream, options }
}

/// A notebook that takes its time, and collects what commits say of the live run.
#[derive(Default)]
struct Slow {
    notebook: Notebook,
    write: Duration,
    commits: Mutex<Vec<(u64, LiveCommit)>>,
}

impl Sink for Slow {
    type Part = String;

    fn parts(&self, run: RunId) -> usize {
        self.notebook.parts(run)
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        self.notebook.part(run, slot)
    }

    fn encode(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<String, ErrorMessage> {
        self.notebook.encode(run, frame, part, values)
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<String>) -> Result<(), ErrorMessage> {
        std::thread::sleep(self.write);
        let live = commit.live.ok_or_else(|| ErrorMessage::new("the frame was not live"))?;
        self.commits.lock().expect("the lock is not poisoned").push((commit.frame.index, live));
        self.notebook.write(commit, parts)
    }

    fn once(&self, run: RunId, slot: Slot, key: &Key, value: &Value, all: &[NodeWarning]) -> Result<(), ErrorMessage> {
        self.notebook.once(run, slot, key, value, all)
    }
}

/// A node that takes its time, and counts how many frames are in it.
struct Sleeper {
    time: Duration,
}

impl PureNode for Sleeper {
    fn process(&self, _: &Inputs<'_>, _: &mut Context<'_>) -> Result<Outputs, Fault> {
        std::thread::sleep(self.time);
        Ok(Outputs::one("x", number(0)))
    }
}

fn sleeping(frames: u64, time: Duration) -> Bench {
    let mut bench = Bench::new(&[""]);
    bench.stage("fly", Numbers::new(frames));
    let planned = planned("sleeper", Contract::Pure, [source(0), None, None]);
    bench.node(planned, Instance::Pure(Box::new(Sleeper { time })));
    bench
}

fn report_of(report: Report) -> LiveReport {
    report.live.expect("a stage was live")
}

#[test]
fn frames_processed_live_have_the_values_and_keys_of_a_batch_run() {
    let batch = Notebook::with_parts(2);
    run(bench(40).ready(), &batch, &options(2), &Unwatched, &Interrupt::default()).expect("it runs");
    for (workers, window) in [(1, None), (2, Some(1)), (3, None), (8, Some(3))] {
        let sink = Slow { notebook: Notebook::with_parts(2), ..Slow::default() };
        let live = live(played(40, 5000.0, true), LiveOptions { no_drop: true, window, ..LiveOptions::default() });
        let report = run_live(bench(0).ready(), live, &sink, &options(workers), &Unwatched, &Interrupt::default());
        let report = report.expect("it runs");
        assert_eq!(sink.notebook.lines(), batch.lines(), "{workers} workers, window {window:?}");
        assert!(!report.interrupted && report.stages[0].retired == 40);
        assert!(window.is_none_or(|window| report.stages[0].peak_in_flight <= window));
        let live = report_of(report);
        assert_eq!((live.offered, live.processed, live.drops), (40, 40, Drops::default()));
        assert_eq!((live.frames.count, live.bottleneck), (39, None));
        let names: Vec<&str> = live.steps.iter().map(|step| step.label.as_str()).collect();
        assert_eq!(names, ["source", "a", "b", "c", "encode", "encode", "write"]);
    }
}

#[test]
fn every_frame_is_processed_or_counted_as_dropped_and_the_newest_wins() {
    let sink = Slow { notebook: Notebook::with_parts(1), ..Slow::default() };
    let options = Options { window: Some(3), ..options(2) };
    let live_options = LiveOptions { deadline: Some(Duration::from_millis(1)), ..LiveOptions::default() };
    let ready = sleeping(0, Duration::from_millis(8)).ready();
    let report = run_live(
        ready,
        live(played(150, 1000.0, false), live_options),
        &sink,
        &options,
        &Unwatched,
        &Interrupt::default(),
    );
    let report = report.expect("it runs");
    assert!(report.stages[0].peak_in_flight <= 3);
    let live = report_of(report);
    let commits = sink.commits.into_inner().expect("the lock is not poisoned");
    assert_eq!(live.offered, live.processed + live.drops.total());
    assert_eq!(live.processed, commits.len() as u64);
    assert!(live.drops.graph > 0, "{live:?}");
    assert_eq!(live.bottleneck.as_ref().map(|(label, _)| label.as_str()), Some("sleeper"));
    let (_, misses) = live.deadline.expect("there is a deadline");
    assert_eq!(misses, live.processed - 1, "the first frame is not counted");
    // Indices count dropped frames, so that gaps and counts agree. The first frame's successors are not counted.
    for pair in commits.windows(2).skip(1) {
        assert_eq!(pair[1].0 - pair[0].0, 1 + pair[1].1.drops.total(), "{pair:?}");
        assert!(pair[1].1.latency_ns >= 8_000_000);
    }
}

#[test]
fn a_slow_disk_is_named_as_the_cause() {
    let write = Duration::from_millis(25);
    let sink = Slow { notebook: Notebook::with_parts(1), write, ..Slow::default() };
    let options = Options { window: Some(2), ..options(2) };
    let stream = live(played(200, 500.0, false), LiveOptions::default());
    let report = run_live(bench(0).ready(), stream, &sink, &options, &Unwatched, &Interrupt::default());
    let live = report_of(report.expect("it runs"));
    assert!(live.drops.recording > live.drops.graph, "{live:?}");
    assert_eq!(live.offered, live.processed + live.drops.total());
}

/// A stream without end, or with a failure at its end; it counts how many frames it gave.
struct Endless {
    given: u64,
    fails_after: Option<u64>,
}

impl StreamingSource for Endless {
    fn next(&mut self, _: Instant) -> Result<NextFrame, Fault> {
        std::thread::sleep(Duration::from_micros(200));
        if self.fails_after.is_some_and(|most| self.given == most) {
            return Err(Fault::new("the cable was pulled").remedy("plug it in"));
        }
        self.given += 1;
        let outputs = Outputs::one("x", number(self.given << 16 | self.given & 0xFFFF));
        let read = depthloom_graphs::SourceOutputs { outputs, key: Key::of_content(&self.given.to_le_bytes()) };
        let frame = Frame::at_10_hz(format!("f{}", self.given), self.given);
        Ok(NextFrame::Captured(Box::new(StreamFrame { frame, read, captured: Instant::now(), missed: 0 })))
    }

    fn take_warnings(&mut self) -> Vec<String> {
        if self.given == 3 { vec!["the camera was started again".to_owned()] } else { Vec::new() }
    }
}

#[test]
fn an_interrupt_ends_the_stream_and_the_run_is_complete() {
    let interrupt = Interrupt::default();
    let raised = AtomicBool::new(false);
    let sink = Notebook {
        parts: 1,
        on_write: Some(Box::new({
            let interrupt = interrupt.clone();
            move |_| {
                if !raised.swap(true, Ordering::SeqCst) {
                    interrupt.raise();
                }
            }
        })),
        ..Notebook::default()
    };
    let stream = live(Box::new(Endless { given: 0, fails_after: None }), LiveOptions::default());
    let report = run_live(bench(0).ready(), stream, &sink, &options(2), &Unwatched, &interrupt).expect("it runs");
    assert!(!report.interrupted && !interrupt.stops_admission());
    let lines = sink.lines();
    assert!(
        lines.last().expect("lines").contains("Node { node: 1, port: 2 }"),
        "the ordered node has finished: {lines:?}"
    );
}

#[test]
fn a_stream_ends_after_its_time() {
    let options_live = LiveOptions { duration: Some(Duration::from_millis(60)), ..LiveOptions::default() };
    let stream = live(Box::new(Endless { given: 0, fails_after: None }), options_live);
    let started = Instant::now();
    let report =
        run_live(bench(0).ready(), stream, &Notebook::with_parts(1), &options(2), &Unwatched, &Interrupt::default());
    assert!(report_of(report.expect("it runs")).processed > 1);
    assert!(started.elapsed() >= Duration::from_millis(60));
}

#[test]
fn what_was_captured_before_a_failure_of_the_source_is_written() {
    let sink = Notebook::with_parts(1);
    let stream = live(
        Box::new(Endless { given: 0, fails_after: Some(20) }),
        LiveOptions { no_drop: true, ..LiveOptions::default() },
    );
    #[derive(Default)]
    struct Counter(AtomicU64);
    impl Observer for Counter {
        fn warned(&self, _: RunId, node: Option<depthloom_graphs::plan::NodeId>, what: &str) {
            assert!(node.is_none() && what == "the camera was started again");
            self.0.fetch_add(1, Ordering::SeqCst);
        }
        fn live(&self, _: RunId, status: &LiveStatus) {
            assert!(status.window >= 1);
        }
    }
    let counter = Counter::default();
    let error = run_live(bench(0).ready(), stream, &sink, &options(2), &counter, &Interrupt::default());
    let error = error.expect_err("the cable was pulled");
    assert_eq!(error.to_string(), "source `numbers` of stage `fly` failed after 20 frames");
    assert!(matches!(&error, RunError::StreamFailed { .. }) && error.is_of_a_frame());
    assert_eq!((sink.lines().len(), counter.0.into_inner()), (20, 1));
}

/// A stream whose clock jumps back once.
struct Jumping(Vec<u64>);

impl StreamingSource for Jumping {
    fn next(&mut self, _: Instant) -> Result<NextFrame, Fault> {
        let Some(time_ns) = self.0.pop() else { return Ok(NextFrame::Ended) };
        let index = self.0.len() as u64;
        let outputs = Outputs::one("x", number(index << 16 | index));
        let read = depthloom_graphs::SourceOutputs { outputs, key: Key::of_content(&index.to_le_bytes()) };
        let frame = Frame { id: format!("f{index}").into(), index, time_ns };
        Ok(NextFrame::Captured(Box::new(StreamFrame { frame, read, captured: Instant::now(), missed: 0 })))
    }
}

#[test]
fn a_clock_that_jumps_back_is_reported_and_the_frames_keep_their_time_stamps() {
    let ready = sleeping(0, Duration::ZERO).ready();
    let plan = ready.plan.clone();
    let no_drop = LiveOptions { no_drop: true, ..LiveOptions::default() };
    let stream = live(Box::new(Jumping(vec![40, 20, 10, 30, 20])), no_drop);
    let sink = Notebook::with_parts(1);
    let report = run_live(ready, stream, &sink, &options(2), &Unwatched, &Interrupt::default()).expect("it runs");
    let warnings: Vec<String> = report.warnings.iter().map(|warning| warning.text(&plan)).collect();
    assert_eq!(warnings, ["fly.numbers: the time stamp precedes that of the frame before, on 1 frame"]);
    assert_eq!(report.live.expect("a stage was live").processed, 5);
}

/// A node whose values depend on more than its inputs, on the third frame.
struct Disturbed;

impl PureNode for Disturbed {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let input = inputs.get::<depthloom_graphs::values::Calibration>("a")?;
        if ctx.host.is_live() && support::read(input) & 0xFFFF == 3 {
            ctx.host.observe(Key::of_content(b"late"));
        }
        Ok(Outputs::one("x", number(0)))
    }
}

#[test]
fn what_a_node_observed_enters_the_key_of_that_frame() {
    let lines = |is_live: bool| {
        let sink = Notebook::with_parts(1);
        let mut bench = Bench::new(&[""]);
        bench.stage("fly", Numbers::new(5));
        let planned = planned("n", Contract::Pure, [source(0), None, None]);
        bench.node(planned, Instance::Pure(Box::new(Disturbed)));
        let (options, interrupt) = (options(2), Interrupt::default());
        if is_live {
            let stream = live(played(5, 5000.0, true), LiveOptions { no_drop: true, ..LiveOptions::default() });
            run_live(bench.ready(), stream, &sink, &options, &Unwatched, &interrupt).expect("it runs");
        } else {
            run(bench.ready(), &sink, &options, &Unwatched, &interrupt).expect("it runs");
        }
        sink.lines()
    };
    let (live, batch) = (lines(true), lines(false));
    let differing: Vec<usize> = (0..5).filter(|&k| live[k] != batch[k]).collect();
    assert_eq!(differing, [2]);
}
