//! Once-values: where they are, and which inputs read them.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use depthloom_graphs::contracts::Contract;
use depthloom_graphs::plan::{NodeRef, Origin, PlannedNode, PortId};
use depthloom_graphs::{Key, Port, Rate, Value, value_keys};

/// A once-value and the key by which it enters the keys of what is made from it.
#[derive(Clone, Debug)]
pub(crate) struct OnceValue {
    pub(crate) value: Value,
    pub(crate) key: Key,
}

/// What is known of a once-value.
pub(crate) enum OnceState {
    /// Its node has not fired yet.
    Pending,
    /// Its node gave nothing there.
    Absent,
    /// It is there.
    There(OnceValue),
}

/// The once-values there are so far.
pub(crate) struct OnceValues {
    files: BTreeMap<PathBuf, Value>,
    /// By node and port; `None` where the node left an optional output out.
    pub(crate) made: HashMap<(NodeRef, PortId), Option<OnceValue>>,
    /// What once-nodes gave, by their key: of two that are equal, in whichever stage runs, one fires.
    pub(crate) given: HashMap<Key, Vec<Option<Value>>>,
}

impl OnceValues {
    pub(crate) fn new(files: BTreeMap<PathBuf, Value>) -> Self {
        Self { files, made: HashMap::new(), given: HashMap::new() }
    }

    /// Puts down what a node gave, by once-output, under its key.
    pub(crate) fn make(&mut self, node: NodeRef, planned: &PlannedNode, key: Option<Key>, outputs: Vec<Option<Value>>) {
        let mut outputs = outputs.into_iter();
        for (port, output) in PortId::enumerate(&planned.outputs).filter(|(_, o)| is_once(planned, &o.port)) {
            let value = outputs.next().flatten();
            let keyed = value.zip(key).map(|(value, key)| {
                let content = value.artifact().map(|artifact| artifact.hash);
                let key = content.unwrap_or_else(|| value_keys::port(&key, output.port.name));
                OnceValue { value, key }
            });
            self.made.insert((node, port), keyed);
        }
    }

    /// What is wired to a once-input.
    pub(crate) fn find(&self, from: &Origin) -> OnceState {
        let there = |once: Option<OnceValue>| once.map_or(OnceState::Absent, OnceState::There);
        match from {
            Origin::Here(_) => OnceState::Pending,
            Origin::Once { run, node, port } => self
                .made
                .get(&(NodeRef { run: *run, node: *node }, *port))
                .map_or(OnceState::Pending, |made| there(made.clone())),
            Origin::File(path) => {
                let value = self.files.get(path);
                value
                    .and_then(|value| Some((value, value.artifact()?.hash)))
                    .map_or(OnceState::Pending, |(value, key)| {
                        OnceState::There(OnceValue { value: value.clone(), key })
                    })
            }
        }
    }
}

/// Whether a node's output is a once-value.
pub(crate) fn is_once(node: &PlannedNode, port: &Port) -> bool {
    node.contract == Contract::Once || port.rate == Rate::Once
}

/// What is at a once-node's inputs; `None` while one of them is not there yet.
pub(crate) fn inputs_of(node: &PlannedNode, values: &OnceValues) -> Option<Vec<Option<OnceValue>>> {
    let found = node.inputs.iter().map(|input| input.from.as_ref().map_or(OnceState::Absent, |from| values.find(from)));
    found
        .map(|state| match state {
            OnceState::Pending => None,
            OnceState::Absent => Some(None),
            OnceState::There(value) => Some(Some(value)),
        })
        .collect()
}
