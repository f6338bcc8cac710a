//! A run that takes from a store what it has gives what a run without one gives, whatever the store has forgotten; and
//! a resumed run writes what was missing.

mod support;

use std::collections::HashMap;
use std::sync::Mutex;
use std::sync::atomic::Ordering;

use depthloom_graphs::contracts::{
    Commit, Contract, ErrorMessage, NodeWarning, Sink, Slot, Store, StoredPort, StoredState,
};
use depthloom_graphs::plan::{FrameIndex, PartId, Plan, PlannedOutput, RunId};
use depthloom_graphs::{Fault, Frame, Key, Remedied, Value};
use depthloom_runner::{Audit, Cause, Interrupt, Options, RunError, Unwatched, run};
use proptest::prelude::*;
use support::any_graph::{any_graph, bench};
use support::{Bench, Notebook, Numbers, Toy, mix, node, source};

/// What runs gave, by key and port; `None` where a port gave nothing.
type Values = HashMap<Key, HashMap<&'static str, Option<Value>>>;

/// Whether a value is in a store.
type Holds = dyn Fn(&Key, &str) -> bool + Send + Sync;

/// What a store has of what runs gave.
struct Memory {
    values: Values,
    holds: Box<Holds>,
    knows: Box<dyn Fn(&Key) -> bool + Send + Sync>,
}

impl Store for Memory {
    fn find(&self, key: &Key) -> Option<Vec<StoredPort>> {
        let ports = self.values.get(key).filter(|_| (self.knows)(key))?;
        let stored = ports.iter().map(|(port, value)| StoredPort {
            port: (*port).to_owned(),
            state: match value {
                None => StoredState::Absent,
                Some(_) if (self.holds)(key, port) => StoredState::Stored,
                Some(_) => StoredState::NotKept,
            },
        });
        Some(stored.collect())
    }

    fn value(&self, key: &Key, port: &str) -> Result<Option<Value>, Fault> {
        let value = self.values.get(key).and_then(|ports| ports.get(port));
        value.cloned().ok_or_else(|| Fault::new("this value is not stored"))
    }
}

/// What was written down at once: a frame, or an aggregate value.
struct Entry {
    run: RunId,
    /// `None`: a frame.
    once: Option<Slot>,
    keys: Vec<Key>,
    values: Vec<(Key, &'static str, Option<Value>)>,
}

fn values_of(entries: &[Entry]) -> Values {
    let mut values = Values::new();
    for entry in entries {
        // Keys are known of what was not recorded, too.
        for key in &entry.keys {
            values.entry(*key).or_default();
        }
        for (key, port, value) in &entry.values {
            values.entry(*key).or_default().insert(port, value.clone());
        }
    }
    values
}

/// Values by run and frame.
type Encoded = HashMap<(RunId, u64), Vec<(Slot, Value)>>;

/// A notebook that records the keys of the values it receives, and may have a store.
struct Remembering {
    notebook: Notebook,
    /// A plan of the same graph, for the names of ports.
    plan: Plan,
    store: Option<Memory>,
    /// Every how many frames values are recorded.
    every: usize,
    /// What was encoded and waits for its keys.
    encoded: Mutex<Encoded>,
    entries: Mutex<Vec<Entry>>,
    /// What an earlier process has written.
    written: Vec<(RunId, Option<Slot>, Key)>,
}

impl Remembering {
    fn new(parts: usize, every: usize, plan: Plan, store: Option<Memory>) -> Self {
        let notebook = Notebook::with_parts(parts);
        Self { notebook, plan, store, every, encoded: Mutex::default(), entries: Mutex::default(), written: Vec::new() }
    }

    fn output(&self, run: RunId, slot: Slot) -> &PlannedOutput {
        self.plan.runs[run].output(slot)
    }

    fn remember(&self, entry: Entry) {
        self.entries.lock().expect("the lock is not poisoned").push(entry);
    }

    fn entries(self) -> Vec<Entry> {
        self.entries.into_inner().expect("the lock is not poisoned")
    }
}

impl Sink for Remembering {
    type Part = String;

    fn parts(&self, run: RunId) -> usize {
        self.notebook.parts(run)
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        self.output(run, slot).recorded.then(|| self.notebook.part(run, slot))?
    }

    fn encode(
        &self,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<String, ErrorMessage> {
        let recorded = values.iter().filter(|(slot, _)| self.keeps(run, *slot, position));
        let recorded: Vec<(Slot, Value)> = recorded.cloned().collect();
        let mut encoded = self.encoded.lock().expect("the lock is not poisoned");
        encoded.entry((run, frame.index)).or_default().extend(recorded.iter().cloned());
        self.notebook.encode(run, (position, frame), part, &recorded)
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<String>) -> Result<(), ErrorMessage> {
        let values = self.encoded.lock().expect("the lock is not poisoned").remove(&(commit.run, commit.frame.index));
        let key = |slot: Slot| match slot {
            Slot::Source { .. } => commit.source_key,
            Slot::Node { node, .. } => commit.keys.iter().find(|of| of.node == node).map(|of| of.key),
        };
        let outputs = values.into_iter().flatten().map(|(slot, value)| (slot, Some(value)));
        let outputs = outputs.chain(commit.absent.iter().map(|slot| (*slot, None)));
        let port = |slot| self.output(commit.run, slot).port.name;
        let values =
            outputs.map(|(slot, value)| (key(slot).expect("a node with a value has a key"), port(slot), value));
        let keys = commit.source_key.into_iter().chain(commit.keys.iter().map(|of| of.key)).collect();
        self.remember(Entry { run: commit.run, once: None, keys, values: values.collect() });
        self.notebook.write(commit, parts)
    }

    fn once(
        &self,
        run: RunId,
        slot: Slot,
        key: &Key,
        value: &Value,
        warned: &[NodeWarning],
    ) -> Result<(), ErrorMessage> {
        let values = vec![(*key, self.output(run, slot).port.name, Some(value.clone()))];
        self.remember(Entry { run, once: Some(slot), keys: vec![*key], values });
        self.notebook.once(run, slot, key, value, warned)
    }

    fn written(&self, run: RunId) -> usize {
        self.written.iter().filter(|(of, once, _)| (*of, *once) == (run, None)).count()
    }

    fn written_aggregate(&self, run: RunId, slot: Slot) -> Option<Key> {
        let written = self.written.iter().find(|(of, once, _)| (*of, *once) == (run, Some(slot)));
        written.map(|(.., key)| *key)
    }

    fn keeps(&self, _run: RunId, _slot: Slot, position: FrameIndex) -> bool {
        position.0.is_multiple_of(self.every)
    }

    fn store(&self) -> Option<&dyn Store> {
        self.store.as_ref().map(|store| store as &dyn Store)
    }
}

/// Runs a graph: what was written, and why it ended.
fn lines_and_error(
    bench: Bench,
    sink: &Remembering,
    workers: usize,
    keep_going: bool,
) -> (Vec<String>, Option<String>) {
    let options = Options { workers, window: Some(4), keep_going, checkpoints: None, audit: Audit::All, share: None };
    let result = run(bench.ready(), sink, &options, &Unwatched, &Interrupt::default());
    (sink.notebook.lines(), result.err().map(|error| error.to_string()))
}

/// The number of graphs; `DEPTHLOOM_CASES` sets another.
fn cases() -> u32 {
    std::env::var("DEPTHLOOM_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(128)
}

/// Leaves the outputs of some nodes unrecorded: by node, a bit each.
fn unrecorded_by(mut bench: Bench, nodes: u64) -> Bench {
    for (n, node) in bench.plan.runs.iter_mut().flat_map(|run| &mut run.nodes).enumerate() {
        node.outputs.iter_mut().for_each(|output| output.recorded = nodes >> (n % 64) & 1 == 0);
    }
    bench
}

fn draw(seed: u64, key: &Key, port: &str) -> u64 {
    key.to_string().bytes().chain(port.bytes()).fold(seed, |n, byte| mix(n, u64::from(byte)))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_a_store_has_forgotten_the_answer_is_the_same(
        graph in any_graph(),
        seed in any::<u64>(),
        every in 1..3_usize,
        // By node, a bit each.
        unrecorded in any::<u64>(),
        // Of eight: how many values are not recorded, how many keys not known.
        lost in (0..8_u64, 0..4_u64),
    ) {
        let bench = || unrecorded_by(bench(&graph), unrecorded);
        let plan = || bench().plan;
        let first = Remembering::new(graph.parts, every, plan(), None);
        let expected = lines_and_error(bench(), &first, 2, graph.keep_going);
        let values = values_of(&first.entries());
        for workers in [1, 3] {
            let store = Memory {
                values: values.clone(),
                holds: Box::new(move |key, port| draw(seed, key, port) % 8 >= lost.0),
                knows: Box::new(move |key| draw(seed, key, "") % 8 >= lost.1),
            };
            let sink = Remembering::new(graph.parts, every, plan(), Some(store));
            let (lines, end) = lines_and_error(bench(), &sink, workers, graph.keep_going);
            let differs = lines.iter().zip(&expected.0).find(|(line, other)| line != other);
            prop_assert_eq!(differs, None, "workers {}", workers);
            prop_assert_eq!((lines.len(), &end), (expected.0.len(), &expected.1), "workers {}", workers);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn wherever_a_run_is_taken_up_it_writes_the_rest(
        graph in any_graph(),
        every in 1..3_usize,
        // By node, a bit each.
        unrecorded in any::<u64>(),
        cut in any::<prop::sample::Index>(),
    ) {
        let bench = || unrecorded_by(bench(&graph), unrecorded);
        let first = Remembering::new(graph.parts, every, bench().plan, None);
        let (expected, end) = lines_and_error(bench(), &first, 2, graph.keep_going);
        let mut written = first.entries();
        let cut = cut.index(written.len() + 1);
        written.truncate(cut);
        for workers in [1, 3] {
            let store =
                Memory { values: values_of(&written), holds: Box::new(|_, _| true), knows: Box::new(|_| true) };
            let mut sink = Remembering::new(graph.parts, every, bench().plan, Some(store));
            sink.written = written.iter().map(|entry| (entry.run, entry.once, entry.keys.first().copied().unwrap_or(Key::of_content(b"")))).collect();
            let (lines, ended) = lines_and_error(bench(), &sink, workers, graph.keep_going);
            let differs = lines.iter().zip(&expected[cut..]).find(|(line, other)| line != other);
            prop_assert_eq!(differs, None, "workers {}", workers);
            prop_assert_eq!((lines.len(), &ended), (expected.len() - cut, &end), "workers {}", workers);
        }
    }
}

/// An ordered node that is not recorded, and a node that reads it.
fn chain() -> (Bench, [Toy; 2]) {
    chain_of(Toy::salted(2))
}

/// The chain with another first node.
fn chain_of(sums: Toy) -> (Bench, [Toy; 2]) {
    let toys = [sums, Toy::salted(3)];
    let mut bench = Bench::new(&["one"]);
    bench.stage("toys", Numbers::new(6));
    bench.toy("sums", Contract::Ordered, [source(0), None, None], toys[0].clone());
    bench.toy("mixes", Contract::Pure, [node(0, 0), None, None], toys[1].clone());
    bench.plan.runs[0].nodes[0].outputs.iter_mut().take(2).for_each(|output| output.recorded = false);
    (bench, toys)
}

#[test]
fn an_ordered_node_that_one_late_frame_needs_fires_on_all_before_it() {
    let first = Remembering::new(1, 1, chain().0.plan, None);
    let expected = lines_and_error(chain().0, &first, 1, false);
    let values = values_of(&first.entries());

    // The store does not know what `mixes` gave on the last frame.
    let of_last = expected.0.iter().find(|line| line.starts_with("0 f6")).expect("the last frame is written");
    let lost = values.keys().copied().find(|key| of_last.contains(&format!("1:{key}")));
    let lost = lost.expect("the last frame has a key of `mixes`");
    let store = Memory { values, holds: Box::new(|_, _| true), knows: Box::new(move |key| *key != lost) };
    let sink = Remembering::new(1, 1, chain().0.plan, Some(store));
    let (bench, toys) = chain();
    assert_eq!(lines_and_error(bench, &sink, 1, false), expected);
    assert_eq!(toys.map(|toy| toy.calls.load(Ordering::Relaxed)), [6, 1], "how often each fired");
}

/// Runs the chain twice, the second time with a store that does not know the node after its last frame. Returns how
/// often each node fired.
fn calls_without_the_last_key(has_sum: bool) -> [u64; 2] {
    let chain = || {
        let (mut bench, toys) = chain_of(Toy { has_no_sum: !has_sum, ..Toy::salted(2) });
        bench.plan.runs[0].nodes[0].outputs.truncate(if has_sum { 3 } else { 2 });
        (bench, toys)
    };
    let first = Remembering::new(1, 1, chain().0.plan, None);
    let expected = lines_and_error(chain().0, &first, 1, false);
    let entries = first.entries();
    let of_frames: Vec<Key> =
        entries.iter().filter(|entry| entry.once.is_none()).flat_map(|entry| entry.keys.clone()).collect();
    let values = values_of(&entries);
    let store = Memory { values, holds: Box::new(|_, _| true), knows: Box::new(move |key| of_frames.contains(key)) };
    let sink = Remembering::new(1, 1, chain().0.plan, Some(store));
    let (bench, toys) = chain();
    assert_eq!(lines_and_error(bench, &sink, 1, false), expected);
    toys.map(|toy| toy.calls.load(Ordering::Relaxed))
}

#[test]
fn an_ordered_node_without_aggregate_outputs_is_known_by_its_frames() {
    assert_eq!(calls_without_the_last_key(false), [0, 0]);
    // What an aggregate output gave is known by the key after the last frame alone.
    assert_eq!(calls_without_the_last_key(true), [6, 0]);
}

/// Runs a chain of which node `b` computes with a constant: a second time with another constant, over the values of the
/// first run.
fn rerun_with_another_constant(contract: Contract, holds: Box<Holds>, audit: Audit) -> Result<(), RunError> {
    let bench = |constant: u64| {
        let mut bench = Bench::new(&["full"]);
        bench.stage("compare", Numbers::new(60));
        bench.toy("a", Contract::Pure, [source(0), None, None], Toy::salted(10));
        bench.toy("b", contract, [node(0, 0), None, None], Toy::salted(constant));
        bench
    };
    let first = Remembering::new(1, 1, bench(11).plan, None);
    let options =
        |audit| Options { workers: 2, window: Some(4), keep_going: false, checkpoints: None, audit, share: None };
    run(bench(11).ready(), &first, &options(Audit::None), &Unwatched, &Interrupt::default()).expect("it runs");
    let store = Memory { values: values_of(&first.entries()), holds, knows: Box::new(|_| true) };
    let second = Remembering::new(1, 1, bench(12).plan, Some(store));
    run(bench(12).ready(), &second, &options(audit), &Unwatched, &Interrupt::default()).map(|_| ())
}

#[test]
fn the_audit_finds_a_constant_that_changed_without_a_new_version() {
    for audit in [Audit::All, Audit::Sample] {
        let error = rerun_with_another_constant(Contract::Pure, Box::new(|_, _| true), audit).unwrap_err();
        let RunError::Audit(failure) = &error else { panic!("{error}") };
        assert_eq!((failure.producer.as_str(), failure.port.as_str()), ("node `compare.b`", "x"));
        assert_eq!(failure.cause, Cause::Implementation);
        assert!(failure.frame.is_some() && error.remedy().is_some_and(|remedy| remedy.contains("--fresh")));
    }
    rerun_with_another_constant(Contract::Pure, Box::new(|_, _| true), Audit::None).unwrap();
}

#[test]
fn the_audit_compares_the_values_of_an_ordered_node_that_runs_although_they_are_stored() {
    // On some frames nothing of the node is stored, so it runs on all of them.
    let holds = || -> Box<Holds> { Box::new(|key, _| !draw(5, key, "").is_multiple_of(8)) };
    for audit in [Audit::All, Audit::Sample] {
        let error = rerun_with_another_constant(Contract::Ordered, holds(), audit).unwrap_err();
        let RunError::Audit(failure) = &error else { panic!("{error}") };
        assert_eq!((failure.producer.as_str(), failure.port.as_str()), ("node `compare.b`", "x"));
    }
    rerun_with_another_constant(Contract::Ordered, holds(), Audit::None).unwrap();
}
