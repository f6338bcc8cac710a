//! Nodes whose failure ends a run: guarded, so that it ends no comparison of others. What they fail of is kept, and
//! from there on they give nothing.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::Instance;
use depthloom_graphs::plan::NodeRef;
use depthloom_graphs::{Context, Fault, Frame, Inputs, OnceNode, OrderedNode, Outputs, Port, Rate};
use depthloom_threads::{Caught, caught, locked};

/// The failures of guarded nodes, by node of the plan that is replayed.
#[derive(Clone, Default)]
pub struct Failures(Arc<Mutex<BTreeMap<NodeRef, String>>>);

impl Failures {
    /// What a node failed of, if it did.
    pub fn of(&self, node: NodeRef) -> Option<String> {
        locked(&self.0).get(&node).cloned()
    }

    /// The node under guard. A pure one needs none, for its failure is that of a frame.
    pub fn guard(&self, at: NodeRef, instance: Instance, outputs: &[Port]) -> Instance {
        let guard = Guard { at, failures: self.clone() };
        let at_rate = |is_once| outputs.iter().filter(|port| (port.rate == Rate::Once) == is_once).cloned().collect();
        match instance {
            Instance::Pure(node) => Instance::Pure(node),
            Instance::Ordered(node) => {
                let (outputs, finished) = (at_rate(false), at_rate(true));
                Instance::Ordered(Box::new(GuardedOrdered { node: Some(node), outputs, finished, guard }))
            }
            Instance::Once(node) => Instance::Once(Box::new(GuardedOnce { node, outputs: outputs.to_vec(), guard })),
        }
    }
}

struct Guard {
    at: NodeRef,
    failures: Failures,
}

impl Guard {
    /// What a node gives at its ports; `None` if it fails, which is put down with where it did. That it was cancelled
    /// is no failure.
    fn given(
        &self,
        ports: &[Port],
        place: &str,
        fire: impl FnOnce() -> Result<Outputs, Fault>,
    ) -> Result<Option<Outputs>, Fault> {
        let given = caught(fire).unwrap_or_else(|Caught(told)| Err(Fault::new(format!("panicked {told}"))));
        match given.and_then(|given| given.in_order_of(ports)) {
            Ok(values) => {
                let there = ports.iter().zip(values).filter_map(|(port, value)| Some((port.name, value?)));
                Ok(Some(there.fold(Outputs::none(), |outputs, (name, value)| outputs.with(name, value))))
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

struct GuardedOnce {
    node: Box<dyn OnceNode>,
    outputs: Vec<Port>,
    guard: Guard,
}

impl OnceNode for GuardedOnce {
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let given = self.guard.given(&self.outputs, "", || self.node.run(inputs, ctx))?;
        Ok(given.unwrap_or_else(Outputs::none))
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
        let given = self.guard.given(&self.outputs, &place, || node.process(frame, inputs, ctx))?;
        if given.is_none() {
            self.node = None;
        }
        Ok(given.unwrap_or_else(Outputs::none))
    }

    fn finish(self: Box<Self>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let Self { node, finished, guard, .. } = *self;
        let Some(node) = node else { return Ok(Outputs::none()) };
        Ok(guard.given(&finished, "", || node.finish(ctx))?.unwrap_or_else(Outputs::none))
    }
}
