//! A share of a plan: what this process computes while other processes compute the rest.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use depthloom_graphs::contracts::{Contract, Slot, Store};
use depthloom_graphs::plan::{NodeId, NodeRef, Origin, PlannedNode, RunId, StageRun};
use depthloom_graphs::{Key, Source};

use crate::aggregate_values::{AggregateState, AggregateValues};
use crate::reuse::aggregate_values;

/// What a process computes of a plan.
///
/// The cache keys are those of a complete run, so that a later run reuses the values. Nothing is audited: the run that
/// reuses the values does that.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Share {
    /// By stage run.
    pub runs: Vec<StageShare>,
    /// The aggregate values that other processes computed, which are in the store: the keys of their nodes.
    pub aggregates: BTreeMap<NodeRef, Key>,
}

/// What a process computes of a stage run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StageShare {
    /// The positions of its frames.
    pub frames: Range<usize>,
    /// The nodes that it computes. Ordered nodes need all frames.
    pub nodes: BTreeSet<NodeId>,
}

impl Share {
    /// The frames of a stage run that are processed.
    pub(crate) fn frames(share: Option<&Self>, run: RunId, source: &dyn Source) -> Range<usize> {
        let all = source.frames().len();
        share.map_or(0..all, |share| {
            let Range { start, end } = share.runs[run].frames;
            start.min(all)..end.min(all)
        })
    }

    pub(crate) fn computes(&self, node: NodeRef) -> bool {
        self.runs[node.run].nodes.contains(&node.node)
    }

    /// Finds the aggregate values of a stage run that other processes computed.
    pub(crate) fn find_aggregates(
        &self,
        run: RunId,
        planned: &StageRun,
        store: &dyn Store,
        values: &mut AggregateValues,
    ) {
        for (node, planned_node) in NodeId::enumerate(&planned.nodes) {
            let of_node = NodeRef { run, node };
            if let Some(key) = self.aggregates.get(&of_node).filter(|_| !self.computes(of_node))
                && let Some(outputs) = aggregate_values(store, planned, node, key)
            {
                values.make(of_node, planned_node, Some(*key), outputs);
            }
        }
    }

    /// The nodes of a stage run that do not run on its frames: those that other processes compute, and those that need
    /// a value that this process does not have.
    pub(crate) fn omitted(
        &self,
        run: RunId,
        planned: &StageRun,
        frames: &Range<usize>,
        values: &AggregateValues,
    ) -> BTreeSet<NodeId> {
        let mut omitted = BTreeSet::new();
        for (node, planned) in NodeId::enumerate(&planned.nodes) {
            let is_frame_node = planned.contract != Contract::Once;
            let is_computed = self.computes(NodeRef { run, node }) && !frames.is_empty();
            if is_frame_node && !(is_computed && has_inputs(planned, &omitted, values)) {
                omitted.insert(node);
            }
        }
        omitted
    }
}

fn has_inputs(node: &PlannedNode, omitted: &BTreeSet<NodeId>, values: &AggregateValues) -> bool {
    node.inputs.iter().all(|input| match &input.from {
        None | Some(Origin::Here(Slot::Source { .. })) => true,
        Some(Origin::Here(Slot::Node { node, .. })) => !omitted.contains(node),
        Some(elsewhere) => !matches!(values.find(elsewhere), AggregateState::Pending),
    })
}
