//! Aggregate values (aggregate values), and the inputs that read them.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use depthloom_graphs::contracts::Contract;
use depthloom_graphs::plan::{NodeRef, Origin, PlannedNode, PortId};
use depthloom_graphs::{Key, Port, Rate, Value, value_keys};

/// An aggregate value and its key in the keys of values computed from it.
#[derive(Clone, Debug)]
pub(crate) struct AggregateValue {
    pub(crate) value: Value,
    pub(crate) key: Key,
}

pub(crate) enum AggregateState {
    /// Its node has not run yet.
    Pending,
    Absent,
    There(AggregateValue),
}

/// The aggregate values so far.
pub(crate) struct AggregateValues {
    files: BTreeMap<PathBuf, Value>,
    /// `None` where the node left out an optional output.
    pub(crate) made: HashMap<(NodeRef, PortId), Option<AggregateValue>>,
    /// The values of aggregate nodes by their key: equal nodes, also of several stages, run once.
    pub(crate) given: HashMap<Key, Vec<Option<Value>>>,
}

impl AggregateValues {
    pub(crate) fn new(files: BTreeMap<PathBuf, Value>) -> Self {
        Self { files, made: HashMap::new(), given: HashMap::new() }
    }

    /// Stores the outputs of a node: by aggregate port, under the node's key.
    pub(crate) fn make(&mut self, node: NodeRef, planned: &PlannedNode, key: Option<Key>, outputs: Vec<Option<Value>>) {
        let mut outputs = outputs.into_iter();
        for (port, output) in PortId::enumerate(&planned.outputs).filter(|(_, o)| is_once(planned, &o.port)) {
            let value = outputs.next().flatten();
            let keyed = value.zip(key).map(|(value, key)| {
                let content = value.artifact().map(|artifact| artifact.hash);
                let key = content.unwrap_or_else(|| value_keys::port(&key, output.port.name));
                AggregateValue { value, key }
            });
            self.made.insert((node, port), keyed);
        }
    }

    pub(crate) fn find(&self, from: &Origin) -> AggregateState {
        match from {
            Origin::Here(_) => AggregateState::Pending,
            Origin::Once { run, node, port } => match self.made.get(&(NodeRef { run: *run, node: *node }, *port)) {
                None => AggregateState::Pending,
                Some(None) => AggregateState::Absent,
                Some(Some(once)) => AggregateState::There(once.clone()),
            },
            Origin::File(path) => {
                let file = self.files.get(path).and_then(|value| Some((value.clone(), value.artifact()?.hash)));
                file.map_or(AggregateState::Pending, |(value, key)| {
                    AggregateState::There(AggregateValue { value, key })
                })
            }
        }
    }
}

pub(crate) fn is_once(node: &PlannedNode, port: &Port) -> bool {
    node.contract == Contract::Once || port.rate == Rate::Once
}

/// The output ports with aggregate values.
pub(crate) fn aggregate_ports(node: &PlannedNode) -> Vec<Port> {
    node.outputs.iter().map(|output| &output.port).filter(|port| is_once(node, port)).cloned().collect()
}

/// The inputs of an aggregate node; `None` while one of them is pending.
pub(crate) fn inputs_of(node: &PlannedNode, values: &AggregateValues) -> Option<Vec<Option<AggregateValue>>> {
    let state = |from: &Option<Origin>| from.as_ref().map_or(AggregateState::Absent, |from| values.find(from));
    let value = |state| match state {
        AggregateState::Pending => None,
        AggregateState::Absent => Some(None),
        AggregateState::There(value) => Some(Some(value)),
    };
    node.inputs.iter().map(|input| value(state(&input.from))).collect()
}
