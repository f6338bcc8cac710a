//! The sink of a replay: compares recomputed values with recorded ones on the workers, and counts in the order of
//! frames.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use depthloom_graphs::contracts::{Commit, ErrorMessage, Failure, NodeWarning, Sink, Slot};
use depthloom_graphs::plan::{FrameIndex, NodeId, NodeRef, PartId, Plan, PortId, RunId};
use depthloom_graphs::values::{Differs, ValueDifference};
use depthloom_graphs::{Frame, Key, Value, ValueType};
use depthloom_recording::Recording;
use depthloom_threads::{into_unlocked, locked};

use crate::guard::Failures;
use crate::plan::{Expected, Replay, Replayed, Unchecked};
use crate::tolerance::Tolerances;

/// Compares the values of a replay with the recorded ones.
pub struct Checker {
    recording: Arc<Recording>,
    nodes: Vec<Vec<Replayed>>,
    plan: Plan,
    tolerances: Tolerances,
    failures: Failures,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// By stage run and node.
    tallies: Vec<Vec<Tally>>,
    damage: Vec<String>,
}

/// The result of the comparison of a node.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// The number of frames or aggregate values that were compared.
    pub values: u64,
    /// The number of those that differ.
    pub different: u64,
    /// The number of numbers in them.
    pub numbers: u64,
    /// The number of those that differ.
    pub different_numbers: u64,
    /// The first difference.
    pub first: Option<Placed>,
    /// The largest difference.
    pub worst: Option<Placed>,
    came: Vec<PortId>,
}

/// A difference, and the value it is in.
#[derive(Clone, Debug)]
pub struct Placed {
    /// The frame's id; `None` for an aggregate value.
    pub frame: Option<Arc<str>>,
    /// The topic.
    pub topic: String,
    /// What type its values have.
    pub value_type: ValueType,
    /// The difference.
    pub differs: Differs,
}

/// The result of a replay.
pub struct Outcome {
    /// For each compared node, in plan order: the node of the recording, what was replayed, and the comparison.
    pub checked: Vec<(NodeRef, Replayed, Tally)>,
    /// The nodes that could not be compared because they read a node that failed.
    pub behind: Vec<Unchecked>,
    /// The nodes that failed in a way that would have ended a run.
    pub failed: Vec<Unchecked>,
    /// What of the recording could not be read.
    pub damage: Vec<String>,
}

const THERE: &str = "a value";
const NONE: &str = "none";

fn failed(why: &str) -> String {
    format!("none, because it failed: {why}")
}

impl Checker {
    /// For a replay, whose nodes are moved out of it.
    pub fn new(recording: Arc<Recording>, replay: &mut Replay, tolerances: Tolerances) -> Self {
        let nodes = std::mem::take(&mut replay.nodes);
        let tallies = nodes.iter().map(|nodes| vec![Tally::default(); nodes.len()]).collect();
        let state = Mutex::new(State { tallies, damage: Vec::new() });
        let (plan, failures) = (replay.ready.plan.clone(), replay.failures.clone());
        Self { recording, nodes, plan, tolerances, failures, state }
    }

    /// The result.
    pub fn finish(mut self) -> Outcome {
        self.take_missing();
        let (failed, behind) = (self.failed(), self.behind_failed());
        let State { tallies, damage } = into_unlocked(self.state);
        let all = RunId::enumerate(self.nodes.into_iter().zip(tallies)).flat_map(|(run, (nodes, tallies))| {
            nodes
                .into_iter()
                .zip(tallies)
                .map(move |(replayed, tally)| (NodeRef { run, node: replayed.recorded }, replayed, tally))
        });
        let is_compared = |replayed: &Replayed| replayed.expected.iter().any(Option::is_some);
        let is_behind = |node: NodeRef| behind.iter().any(|other| other.node == node);
        let mut checked: Vec<_> =
            all.filter(|(node, replayed, _)| is_compared(replayed) && !is_behind(*node)).collect();
        checked.sort_by_key(|(node, ..)| *node);
        Outcome { checked, behind, failed, damage }
    }

    /// The nodes that failed in a way that would have ended a run.
    fn failed(&self) -> Vec<Unchecked> {
        let mut failed = Vec::new();
        for (run, nodes) in RunId::enumerate(&self.nodes) {
            for (node, replayed) in NodeId::enumerate(nodes) {
                if let Some(why) = self.failures.find(NodeRef { run, node }) {
                    failed.push(Unchecked { node: NodeRef { run, node: replayed.recorded }, why, is_damage: false });
                }
            }
        }
        failed
    }

    /// The nodes that read recomputed values of a node that failed.
    fn behind_failed(&self) -> Vec<Unchecked> {
        let mut without: BTreeMap<NodeRef, String> = BTreeMap::new();
        loop {
            let before = without.len();
            for (run, stage_run) in RunId::enumerate(&self.plan.runs) {
                for (node, planned) in NodeId::enumerate(&stage_run.nodes) {
                    let is_failed = |node: NodeRef| self.failures.find(node).is_some();
                    let mut read = planned.inputs.iter().filter_map(|input| input.node_read(run));
                    let failed = read.find(|read| is_failed(*read) || without.contains_key(read));
                    let node = NodeRef { run, node };
                    if let (Some(failed), false) = (failed, is_failed(node)) {
                        let name = &self.plan.runs[failed.run].nodes[failed.node].name;
                        without.insert(node, format!("it reads `{name}` recomputed, which failed"));
                    }
                }
            }
            if without.len() == before {
                break;
            }
        }
        let unchecked = |(NodeRef { run, node }, why): (NodeRef, String)| {
            let replayed = &self.nodes[run][node];
            let is_compared = replayed.expected.iter().any(Option::is_some);
            is_compared.then_some(Unchecked { node: NodeRef { run, node: replayed.recorded }, why, is_damage: false })
        };
        without.into_iter().filter_map(unchecked).collect()
    }

    /// Counts the recorded aggregate values that were not recomputed.
    fn take_missing(&mut self) {
        let state = self.state.get_mut().unwrap_or_else(PoisonError::into_inner);
        for (run, nodes) in RunId::enumerate(&self.nodes) {
            for (node, replayed) in NodeId::enumerate(nodes) {
                for (port, expected) in PortId::enumerate(&replayed.expected) {
                    let tally = &mut state.tallies[run][node];
                    if matches!(expected, Some(Expected::Once { value: Some(_) })) && !tally.came.contains(&port) {
                        let output = &self.plan.runs[run].nodes[node].outputs[port];
                        tally.values += 1;
                        tally.different += 1;
                        let value_type = output.port.value_type;
                        let why = self.failures.find(NodeRef { run, node }).map(|why| failed(&why));
                        let now = why.as_deref().unwrap_or(NONE);
                        tally.take(None, (&output.topic, value_type), ValueDifference::whole(THERE, now));
                    }
                }
            }
        }
    }

    fn state<R>(&self, f: impl FnOnce(&mut State) -> R) -> R {
        f(&mut locked(&self.state))
    }

    fn between(&self, recorded: Option<&Value>, now: Option<&Value>) -> Option<ValueDifference> {
        // Of no rows of scores nothing is recorded.
        let is_there = |value: &&Value| !matches!(value, Value::Scores(rows) if rows.is_empty());
        match (recorded.filter(is_there), now.filter(is_there)) {
            (Some(recorded), Some(now)) => {
                Some(ValueDifference::between(recorded, now, self.tolerances.of_type(now.value_type())))
            }
            (Some(_), None) => Some(ValueDifference::whole(THERE, NONE)),
            (None, Some(_)) => Some(ValueDifference::whole(NONE, THERE)),
            (None, None) => None,
        }
    }

    /// Says why a value is not there, where it is known: what failed on its frame before, and what now.
    fn explain(&self, at: NodeRef, differs: &mut Differs, before: Option<&Failure>, now: Option<&Failure>) {
        let Differs::Whole { recorded, now: made } = differs else { return };
        if let Some(why) = self.failures.find(at).filter(|_| made == NONE) {
            *made = failed(&why);
        }
        if let Some(before) = before.filter(|_| recorded == NONE) {
            *recorded = format!("none, because it failed: {}", before.what);
        }
        if let Some((failure, node)) = now.filter(|_| made == NONE).and_then(|now| Some((now, now.node?))) {
            let name = &self.plan.runs[at.run].nodes[node].name;
            *made = format!("none, for `{name}` failed: {}", failure.what);
        }
    }

    /// What failed on a frame when it was recorded.
    fn recorded_failure(&self, run: RunId, frame: &Frame, node: NodeId) -> Option<&Failure> {
        let frame = self.recording.frames(run).iter().find(|of| of.index == frame.index)?;
        frame.failures.iter().find(|failure| failure.node == Some(node))
    }
}

impl Tally {
    fn take(&mut self, frame: Option<&Arc<str>>, (topic, value_type): (&str, ValueType), difference: ValueDifference) {
        self.numbers += difference.numbers;
        self.different_numbers += difference.different;
        let placed = |differs| Placed { frame: frame.cloned(), topic: topic.to_owned(), value_type, differs };
        if self.first.is_none() {
            self.first = difference.first.map(placed);
        }
        if let Some(worst) = difference.worst
            && self.worst.as_ref().is_none_or(|before| worst.by() > before.differs.by())
        {
            self.worst = Some(placed(worst));
        }
    }
}

impl Sink for Checker {
    /// By output port that has a value on either side.
    type Part = Vec<(PortId, ValueDifference)>;

    /// One a node.
    fn parts(&self, run: RunId) -> usize {
        self.nodes[run].len()
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        let is_compared = |expected: &Option<Expected>, with: PortId| matches!(expected, Some(Expected::Frames { port }) if *port == with);
        let node = match slot {
            Slot::Source { port } => {
                self.nodes[run].iter().position(|node| node.expected.iter().any(|expected| is_compared(expected, port)))
            }
            Slot::Node { node, port } => {
                matches!(self.nodes[run][node].expected[port], Some(Expected::Frames { .. })).then_some(node.0)
            }
        };
        node.map(PartId)
    }

    fn encode(
        &self,
        run: RunId,
        _: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Self::Part, ErrorMessage> {
        let at = |slot: Slot| values.iter().find(|(of, _)| *of == slot).map(|(_, value)| value);
        let node = NodeId(part.0);
        let of_port = |(port, expected): (PortId, &Option<Expected>)| {
            let Some(Expected::Frames { port: recorded }) = expected else { return None };
            let recorded = at(Slot::Source { port: *recorded });
            Some((port, self.between(recorded, at(Slot::Node { node, port }))?))
        };
        Ok(PortId::enumerate(&self.nodes[run][node].expected).filter_map(of_port).collect())
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<Self::Part>) -> Result<(), ErrorMessage> {
        let (run, frame) = (commit.run, commit.frame);
        if let Some(unreadable) = commit.failures.iter().find(|failure| failure.node.is_none()) {
            self.state(|state| state.damage.push(format!("frame `{}`: {}", frame.id, unreadable.what)));
            return Ok(());
        }
        for (node, part) in NodeId::enumerate(parts) {
            if part.is_empty() {
                continue;
            }
            let before = self.recorded_failure(run, frame, self.nodes[run][node].recorded);
            let own = commit.failures.iter().find(|failure| failure.node == Some(node));
            let now = own.or_else(|| commit.failures.first());
            let differs = part.iter().any(|(_, difference)| difference.different > 0);
            self.state(|state| {
                let tally = &mut state.tallies[run][node];
                tally.values += 1;
                tally.different += u64::from(differs);
                for (port, mut difference) in part {
                    for differs in [&mut difference.first, &mut difference.worst].into_iter().flatten() {
                        self.explain(NodeRef { run, node }, differs, before, now);
                    }
                    let output = &self.plan.runs[run].nodes[node].outputs[port];
                    tally.take(Some(&frame.id), (&output.topic, output.port.value_type), difference);
                }
            });
        }
        Ok(())
    }

    fn once(&self, run: RunId, slot: Slot, _: &Key, value: &Value, _: &[NodeWarning]) -> Result<(), ErrorMessage> {
        let Slot::Node { node, port } = slot else { return Ok(()) };
        let Some(Expected::Once { value: recorded }) = &self.nodes[run][node].expected[port] else { return Ok(()) };
        let output = &self.plan.runs[run].nodes[node].outputs[port];
        let recorded = match recorded.as_ref().map(|once| self.recording.aggregate_value(once)).transpose() {
            Ok(recorded) => recorded,
            Err(error) => {
                self.state(|state| {
                    state.damage.push(format!("{}: {error}", output.topic));
                    state.tallies[run][node].came.push(port);
                });
                return Ok(());
            }
        };
        let difference = self.between(recorded.as_ref(), Some(value)).unwrap_or_default();
        self.state(|state| {
            let tally = &mut state.tallies[run][node];
            tally.came.push(port);
            tally.values += 1;
            tally.different += u64::from(difference.different > 0);
            tally.take(None, (&output.topic, output.port.value_type), difference);
        });
        Ok(())
    }
}
