//! Guards for nodes whose failure ends a run: the failure is stored, the node has no outputs from then on, and the
//! comparison of other nodes continues.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::Instance;
use depthloom_graphs::plan::NodeRef;
use depthloom_graphs::{AggregateNode, Context, Fault, Frame, Inputs, OrderedNode, Outputs, Port, Rate};
use depthloom_threads::{Caught, caught, locked};

/// The failures of guarded nodes, by node of the plan that is replayed.
#[derive(Clone, Default)]
pub struct Failures(Arc<Mutex<BTreeMap<NodeRef, String>>>);

impl Failures {
    /// The failure of a node, if it failed.
    pub fn find(&self, node: NodeRef) -> Option<String> {
        locked(&self.0).get(&node).cloned()
    }

    /// The node with a guard. A pure node does not need one: its failure affects only one frame.
    pub fn guard(&self, at: NodeRef, instance: Instance, outputs: &[Port]) -> Instance {
        let guard = Guard { at, failures: self.clone() };
        let at_rate = |is_once| outputs.iter().filter(|port| (port.rate == Rate::Once) == is_once).cloned().collect();
        match instance {
            Instance::Pure(node) => Instance::Pure(node),
            Instance::Ordered(node) => {
                let (outputs, finished) = (at_rate(false), at_rate(true));
                Instance::Ordered(Box::new(GuardedOrdered { node: Some(node), outputs, finished, guard }))
            }
            Instance::Once(node) => {
                Instance::Once(Box::new(GuardedAggregate { node, outputs: outputs.to_vec(), guard }))
            }
        }
    }
}

struct Guard {
    at: NodeRef,
    failures: Failures,
}

impl Guard {
    /// The outputs of a node by port; `None` if it failed, which is stored with its place. A cancelled call is not a
    /// failure.
    fn outputs(
        &self,
        ports: &[Port],
        place: &str,
        fire: impl FnOnce() -> Result<Outputs, Fault>,
    ) -> Result<Option<Outputs>, Fault> {
        let outcome = caught(fire).unwrap_or_else(|Caught(message)| Err(Fault::new(format!("panicked {message}"))));
        match outcome.and_then(|outputs| outputs.in_order_of(ports)) {
            Ok(values) => {
                let present = ports.iter().zip(values).filter_map(|(port, value)| Some((port.name, value?)));
                Ok(Some(present.fold(Outputs::none(), |outputs, (name, value)| outputs.with(name, value))))
            }
            Err(Fault::Cancelled) => Err(Fault::Cancelled),
            Err(fault) => {
                let mut failures = locked(&self.failures.0);
                failures.entry(self.at).or_insert_with(|| format!("{place}{}", fault.chain()));
                Ok(None)
            }
        }
    }
}

struct GuardedAggregate {
    node: Box<dyn AggregateNode>,
    outputs: Vec<Port>,
    guard: Guard,
}

impl AggregateNode for GuardedAggregate {
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let outputs = self.guard.outputs(&self.outputs, "", || self.node.run(inputs, ctx))?;
        Ok(outputs.unwrap_or_else(Outputs::none))
    }
}

struct GuardedOrdered {
    /// `None` once it failed.
    node: Option<Box<dyn OrderedNode>>,
    outputs: Vec<Port>,
    finished: Vec<Port>,
    guard: Guard,
}

impl OrderedNode for GuardedOrdered {
    fn process(&mut self, frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let Some(node) = &mut self.node else { return Ok(Outputs::none()) };
        let place = format!("frame `{}`: ", frame.id);
        let outputs = self.guard.outputs(&self.outputs, &place, || node.process(frame, inputs, ctx))?;
        if outputs.is_none() {
            self.node = None;
        }
        Ok(outputs.unwrap_or_else(Outputs::none))
    }

    fn finish(self: Box<Self>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let Self { node, finished, guard, .. } = *self;
        let Some(node) = node else { return Ok(Outputs::none()) };
        Ok(guard.outputs(&finished, "", || node.finish(ctx))?.unwrap_or_else(Outputs::none))
    }
}
