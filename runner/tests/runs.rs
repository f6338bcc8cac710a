//! What a run does: sharing, order, aggregate values, failures, interrupts, bounds.

mod support;

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, Weak};

use depthloom_graphs::contracts::{Commit, Contract, ErrorMessage, Failure, NodeWarning, Observation, Sink, Slot};
use depthloom_graphs::plan::{FrameIndex, NodeId, PartId, PlannedNode, RunId, VariantId};
use depthloom_graphs::values::{Curve, CurvePoint, Mask, Raster};
use depthloom_graphs::{
    AggregateNode, Context, Fault, Frame, Inputs, Instance, Key, Outputs, Port, PureNode, Remedied, Source,
    SourceOutputs, Value, ValueType, value_keys,
};
use depthloom_runner::{Audit, Interrupt, Observer, Options, Phase, RunError, Unwatched, run};
use support::{Bench, Notebook, Numbers, Toy, build, node, node_slot, once, output, planned, source};

fn options(workers: usize) -> Options {
    Options { workers, window: None, keep_going: false, checkpoints: None, audit: Audit::None, share: None }
}

fn frames(lines: &[String]) -> Vec<&str> {
    lines.iter().filter_map(|line| line.split(' ').nth(1)).filter(|id| id.starts_with('f')).collect()
}

/// A chain a -> b -> c, and d beside it.
fn chain(frames: u64, toys: [Toy; 4]) -> Bench {
    let mut bench = Bench::new(&["full", "mean"]);
    bench.stage("compare", Numbers::new(frames));
    let [a, b, c, d] = toys;
    bench.toy("a", Contract::Pure, [source(0), None, None], a);
    bench.toy("b", Contract::Pure, [node(0, 0), None, None], b);
    bench.toy("c", Contract::Pure, [node(1, 0), source(1), None], c);
    bench.toy("d", Contract::Pure, [source(0), None, None], d);
    bench
}

fn toys() -> [Toy; 4] {
    [10, 11, 12, 13].map(Toy::salted)
}

#[test]
fn a_shared_node_fires_once_a_frame() {
    // One stereo, three variants that read it.
    let stereo = Toy { tiles: 9, ..Toy::salted(5) };
    let calls = Arc::clone(&stereo.calls);
    let mut bench = Bench::new(&["full", "mean", "none"]);
    bench.stage("compare", Numbers::new(40));
    bench.toy("stereo", Contract::Pure, [source(0), source(1), None], stereo);
    for variant in 0..3 {
        bench.toy(&format!("merged{variant}"), Contract::Pure, [node(0, 0), None, None], Toy::salted(variant));
    }
    let report = run(bench.ready(), &Notebook::with_parts(2), &options(4), &Unwatched, &Interrupt::default()).unwrap();
    assert_eq!(calls.load(Ordering::Relaxed), 40);
    assert_eq!(report.stages[0].firings, [40; 4]);
    assert_eq!((report.stages[0].admitted, report.stages[0].retired, report.stages[0].failed), (40, 40, 0));
    let stereo = report.timings.iter().find(|t| t.phase == Phase::Node(NodeId(0))).unwrap();
    assert_eq!((stereo.label.as_str(), stereo.count, stereo.samples.len()), ("stereo", 40, 40));
    assert_eq!(stereo.samples[3].frame_index, 4);
    let classes: BTreeSet<_> = report.timings.iter().map(|t| t.label.as_str()).collect();
    assert_eq!(classes, BTreeSet::from(["source", "stereo", "merged0", "merged1", "merged2", "encode", "write"]));
}

#[test]
fn the_lowest_failing_frame_ends_the_run_and_those_before_it_are_kept() {
    for workers in [1, 2, 8] {
        let [a, b, mut c, mut d] = toys();
        d.fails_at = BTreeSet::from([9, 30]);
        c.panics_at = BTreeSet::from([21, 9]);
        let notebook = Notebook::with_parts(2);
        let mut bench = chain(60, [a, b, c, d]);
        bench.plan.runs[0].nodes[2].variants = vec![VariantId(1)];
        let error = run(bench.ready(), &notebook, &options(workers), &Unwatched, &Interrupt::default()).unwrap_err();
        // Both fail on frame 9: `c` is first in plan order, and serves one variant only.
        assert_eq!(error.to_string(), "node `compare.c` (variant mean) failed on frame f9");
        let RunError::NodeFailed { fault, .. } = &error else { panic!("{error:?}") };
        assert!(fault.to_string().contains("requested panic") && fault.to_string().contains("support"), "{fault}");
        assert!(error.remedy().is_some() && error.is_of_a_frame());
        assert_eq!(frames(&notebook.lines()), ["f1", "f2", "f3", "f4", "f5", "f6", "f7", "f8"]);
    }
}

#[test]
fn keep_going_leaves_tombstones_and_siblings_go_on() {
    let [a, mut b, c, d] = toys();
    b.fails_at = BTreeSet::from([3]);
    let (notebook, options) = (Notebook::with_parts(1), Options { keep_going: true, ..options(3) });
    let report = run(chain(6, [a, b, c, d]).ready(), &notebook, &options, &Unwatched, &Interrupt::default()).unwrap();
    let lines = notebook.lines();
    assert_eq!(frames(&lines), ["f1", "f2", "f3", "f4", "f5", "f6"]);
    assert!(lines[2].contains(r#"["Some(1) requested failure", "Some(2) not run: `b` failed"]"#), "{}", lines[2]);
    assert_eq!(report.stages[0].firings, [6, 5, 5, 6]);
    assert_eq!(report.stages[0].failed, 1);
    assert_eq!(report.failures.len(), 1, "what was not run is not listed: {:?}", report.failures);
    assert_eq!(
        (report.failures[0].node, report.failures[0].remedy.as_deref()),
        (Some(NodeId(1)), Some("do not request it"))
    );
}

#[test]
fn a_frame_the_source_cannot_read_is_a_tombstone_for_all() {
    let mut numbers = Numbers::new(4);
    numbers.toy.fails_at = BTreeSet::from([2]);
    let mut bench = Bench::new(&[""]);
    bench.stage("compare", numbers);
    bench.toy("a", Contract::Pure, [source(0), None, None], Toy::salted(3));
    bench.toy("sum", Contract::Ordered, [node(0, 0), None, None], Toy::salted(4));
    let (notebook, options) = (Notebook::with_parts(1), Options { keep_going: true, ..options(2) });
    let report = run(bench.ready(), &notebook, &options, &Unwatched, &Interrupt::default()).unwrap();
    assert!(notebook.lines()[1].starts_with("0 f2 None []"), "{}", notebook.lines()[1]);
    assert!(notebook.lines()[1].contains("Some(1) not run: source `numbers` failed"), "{}", notebook.lines()[1]);
    assert_eq!((report.stages[0].firings.as_slice(), report.failures[0].node), ([3, 3].as_slice(), None));
}

#[test]
fn an_ordered_node_that_fails_leaves_failure_records_to_the_end_of_its_stage() {
    for workers in [1, 4] {
        let sum = Toy { fails_at: BTreeSet::from([4]), ..Toy::salted(1) };
        let calls = Arc::clone(&sum.calls);
        let mut bench = Bench::new(&[""]);
        bench.stage("look", Numbers::new(6));
        let mut ordered = planned("sum", Contract::Ordered, [source(0), None, None]);
        ordered.outputs.retain(|output| output.port.name != "sum");
        bench.node(ordered, build(Contract::Ordered, sum));
        bench.toy("after", Contract::Pure, [node(0, 0), None, None], Toy::salted(2));
        bench.toy("beside", Contract::Pure, [source(0), None, None], Toy::salted(3));
        let (notebook, options) = (Notebook::with_parts(1), Options { keep_going: true, ..options(workers) });
        let report = run(bench.ready(), &notebook, &options, &Unwatched, &Interrupt::default()).unwrap();
        let lines = notebook.lines();
        assert_eq!(frames(&lines), ["f1", "f2", "f3", "f4", "f5", "f6"]);
        assert!(lines[3].contains(r#"["Some(0) requested failure", "Some(1) not run: `sum` failed"]"#), "{}", lines[3]);
        for line in &lines[4..] {
            let failures = r#"["Some(0) not run: failed on an earlier frame", "Some(1) not run: `sum` failed"]"#;
            assert!(line.contains(failures), "{line}");
        }
        assert_eq!(report.stages[0].firings, [3, 3, 6]);
        assert_eq!((report.stages[0].retired, report.stages[0].failed), (6, 3));
        assert_eq!(calls.load(Ordering::Relaxed), 4, "it is not called again");
    }
}

#[test]
fn an_ordered_node_with_aggregate_outputs_that_panicked_ends_its_stage_even_if_told_to_keep_going() {
    let sum = Toy { panics_at: BTreeSet::from([5]), ..Toy::salted(1) };
    let calls = Arc::clone(&sum.calls);
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(50));
    bench.toy("sum", Contract::Ordered, [source(0), None, None], sum);
    let (notebook, options) = (Notebook::with_parts(1), Options { keep_going: true, ..options(4) });
    let error = run(bench.ready(), &notebook, &options, &Unwatched, &Interrupt::default()).unwrap_err();
    assert_eq!(error.to_string(), "node `learn.sum` failed on frame f5");
    assert_eq!(frames(&notebook.lines()), ["f1", "f2", "f3", "f4"]);
    assert_eq!(calls.load(Ordering::Relaxed), 5, "it is not called again");
}

#[test]
fn aggregate_values_reach_later_stages_and_nodes_of_their_own_stage() {
    // learn: sum (ordered) -> train (once). compare: tuned (once, from the train) -> a (pure, from tuned).
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(7));
    bench.toy("sum", Contract::Ordered, [source(0), None, None], Toy::salted(1));
    bench.toy("train", Contract::Once, [once(0, 0, 2), None, None], Toy::salted(2));
    bench.stage("compare", Numbers::new(3));
    bench.toy("tuned", Contract::Once, [once(0, 1, 0), once(0, 0, 2), None], Toy::salted(3));
    bench.toy("a", Contract::Pure, [source(0), None, once(1, 0, 0)], Toy::salted(4));
    let (notebook, watcher) = (Notebook::with_parts(1), Watcher::default());
    let report = run(bench.ready(), &notebook, &options(3), &watcher, &Interrupt::default()).unwrap();
    let lines = notebook.lines();
    assert_eq!(lines.len(), 7 + 2 + 3 + 1);
    assert!(lines[7].starts_with("0 Node { node: 0, port: 2 }") && lines[8].starts_with("0 Node { node: 1, port: 0 }"));
    assert!(lines[12].starts_with("1 Node { node: 0, port: 0 }"), "after the frames of its stage: {}", lines[12]);
    assert_eq!(report.stages[1].firings, [1, 3]);
    assert!(report.timings.iter().any(|t| t.phase == Phase::Once(NodeId(1)) && t.label == "train"));
    let events = watcher.0.into_inner().unwrap();
    assert_eq!(
        events.iter().filter(|e| e.starts_with("progress")).collect::<Vec<_>>(),
        ["progress 0 1 1/1 mixed", "progress 1 0 1/1 mixed"]
    );
    assert_eq!((events[0].as_str(), events[1].as_str()), ("started 0 7", "retired 0 f1 0"));
    assert_eq!(events.last().map(String::as_str), Some("finished 1"));
}

/// Outputs a learning curve: one point per frame.
struct Teacher;

impl AggregateNode for Teacher {
    fn run(&self, _: &Inputs<'_>, _: &mut Context<'_>) -> Result<Outputs, Fault> {
        let point = |step| CurvePoint { step, loss: 0.5, validation: None, learning_rate: 1e-3 };
        let curve = Curve { points: (0..3).map(point).collect() };
        Ok(Outputs::one("model", support::artifact(7)).with("curve", curve))
    }
}

/// Counts the points of a curve.
struct Pupil;

impl AggregateNode for Pupil {
    fn run(&self, inputs: &Inputs<'_>, _: &mut Context<'_>) -> Result<Outputs, Fault> {
        Ok(Outputs::one("model", support::artifact(inputs.get::<Curve>("curve")?.points.len() as u64)))
    }
}

#[test]
fn a_learning_curve_is_an_aggregate_value_beside_the_model() {
    let curve = || Port::once("curve", ValueType::Curve, "how it learned");
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(2));
    let mut train = planned("train", Contract::Once, [None, None, None]);
    train.inputs.clear();
    train.outputs.push(output(curve()));
    bench.node(train, Instance::Once(Box::new(Teacher)));
    let mut pupil = planned("pupil", Contract::Once, [once(0, 0, 1), None, None]);
    pupil.inputs.truncate(1);
    pupil.inputs[0].port = curve();
    bench.node(pupil.clone(), Instance::Once(Box::new(Pupil)));
    let notebook = Notebook::with_parts(1);
    run(bench.ready(), &notebook, &options(2), &Unwatched, &Interrupt::default()).unwrap();
    let lines = notebook.lines();
    let key = value_keys::once(&Key::of_content(b"train"), &[]);
    assert!(lines[2].starts_with(&format!("0 Node {{ node: 0, port: 0 }} {key} 7")), "{}", lines[2]);
    assert!(
        lines[3].starts_with(&format!("0 Node {{ node: 0, port: 1 }} {key} Curve(Curve {{ points: [")),
        "{}",
        lines[3]
    );
    // No artefact, so it enters keys by its port.
    let key = value_keys::once(&pupil.node_hash, &[Some(value_keys::port(&key, "curve"))]);
    assert_eq!(lines[4..], [format!("0 Node {{ node: 1, port: 0 }} {key} 3")]);
}

/// The keys of a pure and of an ordered node on two frames of equal content.
fn keys_at(change: impl Fn(&mut Frame), observes: Option<Observation>) -> [Vec<String>; 2] {
    let mut numbers = Numbers::new(2);
    numbers.frames.iter_mut().for_each(change);
    let mut bench = Bench::new(&[""]);
    bench.stage("look", numbers);
    let pure = PlannedNode { observes, ..planned("pure", Contract::Pure, [source(0), None, None]) };
    bench.node(pure, build(Contract::Pure, Toy::salted(1)));
    bench.toy("ordered", Contract::Ordered, [source(0), None, None], Toy::salted(1));
    let notebook = Notebook::with_parts(1);
    run(bench.ready(), &notebook, &options(2), &Unwatched, &Interrupt::default()).expect("it runs");
    let lines = notebook.lines();
    [0, 1].map(|node| {
        let of_node = format!("\"{node}:");
        let keys = lines[..2].iter().filter_map(|line| line.split_once(&of_node));
        keys.map(|(_, rest)| rest[..32].to_owned()).collect()
    })
}

#[test]
fn the_keys_of_an_ordered_node_contain_id_and_time_of_the_frame_and_those_of_a_pure_one_if_it_observes_them() {
    let [pure, ordered] = keys_at(|_| {}, None);
    assert_eq!((pure.len(), ordered.len()), (2, 2));
    let changes: [&dyn Fn(&mut Frame); 2] =
        [&|frame| frame.id = format!("other{}", frame.id).into(), &|frame| frame.time_ns += 1];
    let [observing, _] = keys_at(|_| {}, Some(Observation::default()));
    for change in changes {
        let [pure_then, ordered_then] = keys_at(change, None);
        assert_eq!(pure, pure_then, "a pure node does not receive the frame");
        assert!(ordered.iter().zip(&ordered_then).all(|(now, then)| now != then));
        let [observing_then, _] = keys_at(change, Some(Observation::default()));
        assert!(observing.iter().zip(&observing_then).all(|(now, then)| now != then));
    }
}

#[test]
fn a_file_that_changes_while_a_node_reads_it_fails_the_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f1.txt");
    std::fs::write(&path, "before").unwrap();
    let mut bench = Bench::new(&[""]);
    bench.stage("look", Numbers::new(1));
    let observes = Some(Observation { files: vec![folder.path().join("{frame}.txt")], ..Observation::default() });
    let planned = PlannedNode { observes, ..planned("writer", Contract::Pure, [source(0), None, None]) };
    bench.node(planned, Instance::Pure(Box::new(Writer(path))));
    let notebook = Notebook::with_parts(1);
    let error = run(bench.ready(), &notebook, &options(1), &Unwatched, &Interrupt::default()).unwrap_err();
    let beneath = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
    assert!(beneath.contains("`reads` names changed"), "{error}: {beneath}");
}

/// Changes a file.
struct Writer(std::path::PathBuf);

impl PureNode for Writer {
    fn process(&self, _: &Inputs<'_>, _: &mut Context<'_>) -> Result<Outputs, Fault> {
        std::fs::write(&self.0, "after").map_err(|error| Fault::new(error.to_string()))?;
        Ok(Outputs::one("x", support::number(1)))
    }
}

/// The node with a hash, in whatever stage.
#[test]
fn equal_aggregate_nodes_run_once_in_whichever_stages() {
    for workers in [1, 4] {
        let mut bench = Bench::new(&[""]);
        let (toy, other) = (Toy::salted(5), Toy::salted(6));
        let (calls, other_calls) = (Arc::clone(&toy.calls), Arc::clone(&other.calls));
        let train = |bench: &mut Bench, name: &str, toy: &Toy| {
            let toy = Toy { calls: Arc::clone(&toy.calls), ..Toy::salted(toy.salt) };
            bench.toy(name, Contract::Once, [once(0, 0, 2), None, None], toy);
        };
        bench.stage("learn", Numbers::new(2));
        bench.toy("sum", Contract::Ordered, [source(0), None, None], Toy::salted(1));
        train(&mut bench, "train", &toy);
        train(&mut bench, "train", &toy);
        bench.stage("compare", Numbers::new(2));
        train(&mut bench, "train", &toy);
        train(&mut bench, "another", &other);
        bench.toy("pupil", Contract::Pure, [source(0), None, once(0, 2, 0)], Toy::salted(3));
        let notebook = Notebook::with_parts(1);
        let report = run(bench.ready(), &notebook, &options(workers), &Unwatched, &Interrupt::default()).unwrap();
        assert_eq!((calls.load(Ordering::Relaxed), other_calls.load(Ordering::Relaxed)), (1, 1));
        let firings: Vec<_> = report.stages.iter().map(|stage| stage.firings.clone()).collect();
        assert_eq!(firings, [vec![2, 1, 0], vec![0, 1, 2]]);
        let lines = notebook.lines();
        let stored_key = |node: usize, run: usize| {
            let start = format!("{run} {:?} ", node_slot(node, 0));
            lines.iter().find_map(|line| line.strip_prefix(&start)).expect("the value is written").to_owned()
        };
        assert!(
            stored_key(1, 0) == stored_key(2, 0) && stored_key(1, 0) == stored_key(0, 1),
            "each has the value under the key of all"
        );
        assert_ne!(stored_key(1, 0), stored_key(1, 1));
    }
}

/// A source whose files are others when they are read than when they were named.
struct Changing(Numbers);

impl Source for Changing {
    fn frames(&self) -> &[Frame] {
        self.0.frames()
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        if position.0 == 1 { Ok(Key::of_content(b"before")) } else { self.0.key(position) }
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        self.0.read(position, ctx)
    }
}

#[test]
fn a_frame_that_is_not_the_one_its_key_names_fails() {
    let mut bench = Bench::new(&[""]);
    bench.stage("compare", Changing(Numbers::new(3)));
    let notebook = Notebook::with_parts(1);
    let error = run(bench.ready(), &notebook, &options(2), &Unwatched, &Interrupt::default()).unwrap_err();
    let RunError::SourceFailed { frame, fault, .. } = error else { panic!("{error}") };
    assert_eq!((frame.as_str(), fault.to_string().as_str()), ("f2", "the frame's files changed while they were read"));
    assert_eq!(frames(&notebook.lines()), ["f1"]);
}

#[test]
fn a_failing_aggregate_node_is_named() {
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(2));
    bench.toy("sum", Contract::Ordered, [source(0), None, None], Toy::salted(1));
    let train = Toy { fails_at: BTreeSet::from([0]), ..Toy::salted(2) };
    bench.toy("train", Contract::Once, [once(0, 0, 2), None, None], train);
    let error = run(bench.ready(), &Notebook::default(), &options(2), &Unwatched, &Interrupt::default()).unwrap_err();
    assert_eq!(error.to_string(), "node `learn.train` failed");
    assert!(
        matches!(&error, RunError::NodeFailed { frame: None, fault, .. } if fault.to_string() == "requested failure")
    );
}

#[test]
fn an_aggregate_value_that_comes_too_late_for_the_frames_is_refused() {
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(2));
    bench.toy("sum", Contract::Ordered, [source(0), None, None], Toy::salted(1));
    bench.toy("a", Contract::Pure, [source(0), None, once(0, 0, 2)], Toy::salted(1));
    let error = run(bench.ready(), &Notebook::default(), &options(2), &Unwatched, &Interrupt::default()).unwrap_err();
    assert!(error.to_string().contains("input `c` of node `a` is not known before the stage's frames"), "{error}");
}

#[test]
fn a_sink_that_refuses_ends_the_run_at_its_frame() {
    for workers in [1, 4] {
        let refuses_to_encode = BTreeSet::from([5]);
        let notebook = Notebook { refuses_to_encode, ..Notebook::with_parts(2) };
        let ready = chain(9, toys()).ready();
        let error = run(ready, &notebook, &options(workers), &Unwatched, &Interrupt::default()).unwrap_err();
        assert_eq!(error.to_string(), "failed to record frame f5 of stage `compare`");
        assert_eq!(frames(&notebook.lines()), ["f1", "f2", "f3", "f4"]);
        let notebook = Notebook { refuses_to_write: BTreeSet::from([3]), ..Notebook::with_parts(2) };
        let ready = chain(9, toys()).ready();
        let error = run(ready, &notebook, &options(workers), &Unwatched, &Interrupt::default()).unwrap_err();
        assert_eq!(error.to_string(), "failed to record frame f3 of stage `compare`");
        assert_eq!(frames(&notebook.lines()), ["f1", "f2"]);
    }
}

#[test]
fn the_first_interrupt_lets_admitted_frames_retire() {
    for workers in [1, 4] {
        let interrupt = Interrupt::default();
        let raised = interrupt.clone();
        let on_write = move |index| {
            if index == 10 {
                raised.raise();
            }
        };
        let notebook = Notebook { on_write: Some(Box::new(on_write)), ..Notebook::with_parts(1) };
        let options = Options { window: Some(5), ..options(workers) };
        let report = run(chain(1000, toys()).ready(), &notebook, &options, &Unwatched, &interrupt).unwrap();
        assert!(report.interrupted);
        // Frame 10 was written while frames up to 14 were in flight: those are kept, and no more.
        assert_eq!((report.stages[0].admitted, report.stages[0].retired), (14, 14));
        assert_eq!(frames(&notebook.lines()).len(), 14);
    }
}

#[test]
fn an_interrupted_stage_has_no_aggregate_values_and_no_later_stage_starts() {
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(100));
    bench.toy("sum", Contract::Ordered, [source(0), None, None], Toy::salted(1));
    bench.stage("compare", Numbers::new(3));
    let interrupt = Interrupt::default();
    let raised = interrupt.clone();
    let on_write = move |index| {
        if index == 4 {
            raised.raise();
        }
    };
    let notebook = Notebook { on_write: Some(Box::new(on_write)), ..Notebook::with_parts(1) };
    let report = run(bench.ready(), &notebook, &options(2), &Unwatched, &interrupt).unwrap();
    assert!(report.interrupted && report.stages.len() == 1);
    assert!(notebook.lines().iter().all(|line| line.starts_with("0 f")));
}

/// Learns until the run is abandoned.
struct Endless(Interrupt);

impl AggregateNode for Endless {
    fn run(&self, _: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.0.raise();
        assert!(!ctx.host.cancelled(), "the first interrupt abandons nothing");
        self.0.raise();
        while !ctx.host.cancelled() {
            std::thread::yield_now();
        }
        Err(Fault::Cancelled)
    }
}

impl PureNode for Endless {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.run(inputs, ctx)
    }
}

/// Learns until the run is interrupted, and then writes a checkpoint.
struct Patient(Interrupt);

impl AggregateNode for Patient {
    fn run(&self, _: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        assert!(!ctx.host.stopping());
        self.0.raise();
        assert!(ctx.host.stopping() && !ctx.host.cancelled(), "it has the time to write a checkpoint");
        Err(Fault::Cancelled)
    }
}

#[test]
fn fault_27_an_aggregate_node_stopped_at_the_first_interrupt_interrupts_its_run_and_fails_nothing() {
    let interrupt = Interrupt::default();
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(2));
    bench.toy("sum", Contract::Ordered, [source(0), None, None], Toy::salted(1));
    let patient = Instance::Once(Box::new(Patient(interrupt.clone())));
    bench.node(planned("patient", Contract::Once, [once(0, 0, 2), None, None]), patient);
    bench.stage("compare", Numbers::new(3));
    let notebook = Notebook::with_parts(1);
    let report = run(bench.ready(), &notebook, &options(2), &Unwatched, &interrupt).unwrap();
    assert!(report.interrupted && report.stages.len() == 1);
    assert_eq!(frames(&notebook.lines()), ["f1", "f2"]);

    // Who gives up unasked has failed.
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(2));
    bench.toy("sum", Contract::Ordered, [source(0), None, None], Toy::salted(1));
    let quitter = Instance::Once(Box::new(Quitter));
    bench.node(planned("quitter", Contract::Once, [once(0, 0, 2), None, None]), quitter);
    let ended = run(bench.ready(), &Notebook::default(), &options(2), &Unwatched, &Interrupt::default());
    assert!(matches!(ended, Err(RunError::NodeFailed { frame: None, .. })), "{ended:?}");
}

/// Gives up unasked.
struct Quitter;

impl AggregateNode for Quitter {
    fn run(&self, _: &Inputs<'_>, _: &mut Context<'_>) -> Result<Outputs, Fault> {
        Err(Fault::Cancelled)
    }
}

#[test]
fn the_second_interrupt_aborts() {
    let interrupt = Interrupt::default();
    let mut bench = chain(5, toys());
    bench.node(
        planned("endless", Contract::Pure, [node(2, 0), None, None]),
        Instance::Pure(Box::new(Endless(interrupt.clone()))),
    );
    let (notebook, options) = (Notebook::with_parts(1), Options { window: Some(1), ..options(3) });
    let error = run(bench.ready(), &notebook, &options, &Unwatched, &interrupt).unwrap_err();
    assert!(matches!(error, RunError::Aborted), "{error:?}");
    assert!(notebook.lines().is_empty());

    let interrupt = Interrupt::default();
    let mut bench = Bench::new(&[""]);
    bench.stage("learn", Numbers::new(2));
    bench.toy("sum", Contract::Ordered, [source(0), None, None], Toy::salted(1));
    let endless = Instance::Once(Box::new(Endless(interrupt.clone())));
    bench.node(planned("endless", Contract::Once, [once(0, 0, 2), None, None]), endless);
    let error = run(bench.ready(), &Notebook::default(), &options, &Unwatched, &interrupt).unwrap_err();
    assert!(matches!(error, RunError::Aborted), "{error:?}");
}

#[derive(Default)]
struct Watcher(Mutex<Vec<String>>);

impl Watcher {
    fn note(&self, event: String) {
        self.0.lock().expect("the lock is not poisoned").push(event);
    }
}

impl Observer for Watcher {
    fn stage_started(&self, run: RunId, frames: u64) {
        self.note(format!("started {run} {frames}"));
    }

    fn frame_retired(&self, run: RunId, frame: &Frame, failures: &[Failure]) {
        self.note(format!("retired {run} {} {}", frame.id, failures.len()));
    }

    fn progress(&self, run: RunId, node: NodeId, done: u64, total: u64, message: &str) {
        self.note(format!("progress {run} {node} {done}/{total} {message}"));
    }

    fn stage_finished(&self, run: RunId) {
        self.note(format!("finished {run}"));
    }
}

/// A mask of a frame.
type Born = (u8, Weak<Mask>);

/// Masks whose life is watched.
#[derive(Clone, Default)]
struct Nursery {
    born: Arc<Mutex<Vec<Born>>>,
    peak_frames: Arc<AtomicUsize>,
    peak_values: Arc<AtomicUsize>,
}

impl Nursery {
    fn bear(&self, frame: u8) -> Value {
        let mask = Arc::new(Mask { set: Raster::from_raw(1, 1, vec![frame]).expect("one pixel") });
        let mut born = self.born.lock().expect("the lock is not poisoned");
        born.retain(|(_, mask)| mask.strong_count() > 0);
        born.push((frame, Arc::downgrade(&mask)));
        let frames: BTreeSet<u8> = born.iter().map(|(frame, _)| *frame).collect();
        self.peak_frames.fetch_max(frames.len(), Ordering::Relaxed);
        self.peak_values.fetch_max(born.len(), Ordering::Relaxed);
        Value::Mask(mask)
    }
}

struct Cradle(Nursery, Vec<Frame>);

impl Source for Cradle {
    fn frames(&self) -> &[Frame] {
        &self.1
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        Ok(Key::of_content(&position.0.to_le_bytes()))
    }

    fn read(&self, position: FrameIndex, _: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let outputs = Outputs::one("m", self.0.bear(u8::try_from(position.0).expect("few frames")));
        Ok(SourceOutputs { outputs, key: self.key(position)? })
    }
}

impl PureNode for Nursery {
    fn process(&self, inputs: &Inputs<'_>, _: &mut Context<'_>) -> Result<Outputs, Fault> {
        std::thread::yield_now();
        Ok(Outputs::one("m", self.bear(inputs.get::<Mask>("a")?.set.as_raw()[0])))
    }
}

/// A chain of ten nodes whose masks are watched; the sink takes the last one's only, if any.
fn watched_chain(nursery: &Nursery) -> Bench {
    let mut bench = Bench::new(&[""]);
    bench.stage("watched", Cradle(nursery.clone(), (0..200).map(|k| Frame::at_10_hz("f", k)).collect()));
    let mask = |name| Port::frame(name, ValueType::Mask, "watched");
    bench.plan.runs[0].source.outputs = vec![output(mask("m"))];
    for index in 0..10 {
        let from = if index == 0 { source(0) } else { node(index - 1, 0) };
        let mut planned = planned(&format!("n{index}"), Contract::Pure, [from, None, None]);
        planned.inputs[0].port = mask("a");
        planned.outputs = vec![output(mask("m"))];
        bench.node(planned, Instance::Pure(Box::new(nursery.clone())));
    }
    bench
}

struct Last(bool);

impl Sink for Last {
    type Part = Vec<Value>;

    fn parts(&self, _: RunId) -> usize {
        1
    }

    fn part(&self, _: RunId, slot: Slot) -> Option<PartId> {
        (self.0 || slot == node_slot(9, 0)).then_some(PartId(0))
    }

    fn encode(
        &self,
        _: RunId,
        _: (FrameIndex, &Frame),
        _: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Vec<Value>, ErrorMessage> {
        Ok(values.iter().map(|(_, value)| value.clone()).collect())
    }

    fn write(&self, _: &Commit<'_>, parts: Vec<Vec<Value>>) -> Result<(), ErrorMessage> {
        assert_eq!(parts[0].len(), if self.0 { 11 } else { 1 });
        Ok(())
    }

    fn once(&self, _: RunId, _: Slot, _: &Key, _: &Value, _: &[NodeWarning]) -> Result<(), ErrorMessage> {
        Ok(())
    }
}

#[test]
fn no_more_frames_are_alive_than_the_window() {
    for (workers, window) in [(1, 3), (2, 1), (4, 4), (8, 6)] {
        // The sink holds on to every value until the frame is written: the worst there is.
        let (nursery, options) = (Nursery::default(), Options { window: Some(window), ..options(workers) });
        let ready = watched_chain(&nursery).ready();
        let report = run(ready, &Last(true), &options, &Unwatched, &Interrupt::default()).unwrap();
        assert!(nursery.peak_frames.load(Ordering::Relaxed) <= window, "workers {workers}, window {window}");
        assert!(nursery.peak_values.load(Ordering::Relaxed) <= 11 * window, "workers {workers}, window {window}");
        assert_eq!((report.stages[0].peak_in_flight, report.stages[0].retired), (window, 200));
    }
}

#[test]
fn a_value_is_dropped_with_its_last_reader() {
    for workers in [1, 4] {
        let (nursery, options) = (Nursery::default(), Options { window: Some(1), ..options(workers) });
        run(watched_chain(&nursery).ready(), &Last(false), &options, &Unwatched, &Interrupt::default()).unwrap();
        // What a node reads and what it gives: of eleven values in the chain, two.
        assert_eq!(nursery.peak_values.load(Ordering::Relaxed), 2);
    }
}

/// Works in tiles, and counts who works at once.
#[derive(Clone, Default)]
struct Tiled {
    now: Arc<AtomicUsize>,
    peak: Arc<AtomicUsize>,
    burn_ns: i64,
}

impl PureNode for Tiled {
    fn process(&self, _: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        ctx.host.tiles(8, &|_| {
            self.peak.fetch_max(self.now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            let start = thread_cpu_ns();
            while thread_cpu_ns() - start < self.burn_ns {
                std::thread::yield_now();
            }
            self.now.fetch_sub(1, Ordering::SeqCst);
        });
        Ok(Outputs::one("x", support::number(0)))
    }
}

fn thread_cpu_ns() -> i64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

fn tiled(frames: u64, node: &Tiled) -> Bench {
    let mut bench = Bench::new(&[""]);
    bench.stage("tiled", Numbers::new(frames));
    for name in ["a", "b", "c"] {
        bench.node(planned(name, Contract::Pure, [source(0), None, None]), Instance::Pure(Box::new(node.clone())));
    }
    bench
}

#[test]
fn workers_and_helpers_together_are_never_more_than_asked_for() {
    for workers in [1, 2, 5] {
        let node = Tiled { burn_ns: 20_000, ..Tiled::default() };
        let ready = tiled(30, &node).ready();
        run(ready, &Notebook::default(), &options(workers), &Unwatched, &Interrupt::default()).unwrap();
        assert!(node.peak.load(Ordering::SeqCst) <= workers);
    }
}

#[test]
fn a_tile_counts_as_its_nodes_time_whoever_ran_it() {
    let node = Tiled { burn_ns: 500_000, ..Tiled::default() };
    let ready = tiled(3, &node).ready();
    let report = run(ready, &Notebook::default(), &options(4), &Unwatched, &Interrupt::default()).unwrap();
    let a = report.timings.iter().find(|t| t.label == "a").unwrap();
    assert_eq!(a.count, 3);
    assert!(a.cpu.min_ns >= 8 * 500_000, "{a:?}");
}

/// Warns about three pixels on every frame, and on every call.
struct Warner;

impl PureNode for Warner {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        ctx.host.warn_n(3, "pixels are not numbers");
        ctx.host.warn("was called");
        Ok(Outputs::one("x", Value::Calibration(Arc::clone(inputs.get("a")?))))
    }
}

/// Counts the warnings that it receives.
#[derive(Default)]
struct WarningCollector(Mutex<Vec<String>>);

impl Observer for WarningCollector {
    fn warned(&self, run: RunId, node: Option<NodeId>, what: &str) {
        self.0.lock().expect("the lock is not poisoned").push(format!("{run} {node:?} {what}"));
    }
}

#[test]
fn equal_warnings_of_a_node_are_counted_and_told_once_with_any_number_of_workers() {
    for workers in [1, 2, 8] {
        let mut bench = Bench::new(&["full"]);
        bench.stage("compare", Numbers::new(40));
        bench.toy("quiet", Contract::Pure, [source(0), None, None], Toy::salted(1));
        bench.node(planned("loud", Contract::Pure, [source(0), None, None]), Instance::Pure(Box::new(Warner)));
        let (plan, collector) = (bench.plan.clone(), WarningCollector::default());
        let report =
            run(bench.ready(), &Notebook::with_parts(2), &options(workers), &collector, &Interrupt::default()).unwrap();
        let texts: Vec<String> = report.warnings.iter().map(|warning| warning.text(&plan)).collect();
        assert_eq!(
            texts,
            ["compare.loud: 120 pixels are not numbers, on 40 frames", "compare.loud: was called, on 40 frames"]
        );
        let mut collector = collector.0.into_inner().unwrap();
        collector.sort_unstable();
        assert_eq!(collector, ["0 Some(1) pixels are not numbers", "0 Some(1) was called"]);
    }
}
