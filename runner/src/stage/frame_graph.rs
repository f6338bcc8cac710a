//! A stage run's frame graph by index: which step waits for which, and the places of values.

use std::collections::BTreeSet;

use depthloom_graphs::contracts::{Contract, Sink, Slot};
use depthloom_graphs::plan::{NodeId, Origin, PartId, PlannedOutput, RunId, StageRun};
use depthloom_graphs::{ErrorMessage, Port, Rate, index_type};

use crate::aggregate_values::{AggregateState, AggregateValue};

index_type! {
    /// Index of a step of a frame: the source, then the nodes, then the parts of the sink.
    pub(crate) struct StepId;
}

index_type! {
    /// Index of a per-frame output: among those of a step.
    pub(crate) struct OutputId;
}

index_type! {
    /// Index of a place: among the per-frame outputs of all steps.
    pub(crate) struct PlaceId;
}

/// A per-frame output of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct StepOutput {
    pub(crate) step: StepId,
    pub(crate) output: OutputId,
}

impl StepId {
    pub(crate) const SOURCE: Self = Self(0);

    pub(crate) const fn of_node(node: NodeId) -> Self {
        Self(1 + node.0)
    }

    pub(crate) const fn of_slot(slot: Slot) -> Self {
        match slot {
            Slot::Source { .. } => Self::SOURCE,
            Slot::Node { node, .. } => Self::of_node(node),
        }
    }

    /// `None` for the source; meaningless for a part.
    pub(crate) fn node(self) -> Option<NodeId> {
        self.0.checked_sub(1).map(NodeId)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    Source,
    Node(NodeId),
    Encode(PartId),
}

/// What feeds an input port.
pub(crate) enum Feed {
    Unwired,
    /// A per-frame value, and the step that computes it.
    Place {
        place: PlaceId,
        step: StepId,
    },
    /// An aggregate value, known before the frames; `None` if its node left it out.
    Once(Option<AggregateValue>),
}

/// The place of a per-frame output.
pub(crate) struct Place {
    /// How many inputs and parts take the value; the last one drops it.
    pub(crate) uses: u32,
    /// Whether a node takes it, so that it needs a key.
    pub(crate) keyed: bool,
}

/// The source, or a node.
pub(crate) struct Producer {
    pub(crate) inputs: Vec<Port>,
    /// By input.
    pub(crate) feeds: Vec<Feed>,
    /// The per-frame output ports.
    pub(crate) outputs: Vec<Port>,
    /// The place of the first output; the others follow.
    pub(crate) first_place: PlaceId,
    /// Whether it runs on no frame, because another process computes it.
    pub(crate) is_omitted: bool,
}

impl Producer {
    pub(crate) const fn place(&self, output: OutputId) -> PlaceId {
        PlaceId(self.first_place.0 + output.0)
    }

    pub(crate) const fn output_at(&self, place: PlaceId) -> OutputId {
        OutputId(place.0 - self.first_place.0)
    }
}

#[derive(Default)]
pub(crate) struct Order {
    /// How many other steps it waits for.
    pub(crate) waits_for: u32,
    /// The steps that wait for it.
    pub(crate) then: Vec<StepId>,
}

/// The steps of a frame: the source, the nodes, the parts. An aggregate node has its number, but nothing leads to it.
pub(crate) struct FrameGraph {
    /// The source and the nodes, by step.
    pub(crate) producers: Vec<Producer>,
    /// Per-frame outputs: the source's, then the nodes' in plan order.
    pub(crate) places: Vec<Place>,
    /// What the sink takes: by part, in plan order.
    pub(crate) parts: Vec<Vec<(Slot, PlaceId)>>,
    /// By step.
    pub(crate) order: Vec<Order>,
    pub(crate) steps_per_frame: u32,
}

impl FrameGraph {
    /// `omitted` nodes have no inputs and no values. `once` finds the aggregate values that are known before the
    /// frames.
    ///
    /// # Errors
    /// If the plan contradicts itself or the sink.
    pub(crate) fn new<T: Sink>(
        run: RunId,
        plan: &StageRun,
        sink: &T,
        omitted: &BTreeSet<NodeId>,
        once: impl Fn(&Origin) -> AggregateState,
    ) -> Result<Self, ErrorMessage> {
        let source = Producer {
            inputs: Vec::new(),
            feeds: Vec::new(),
            outputs: frame_ports(&plan.source.outputs),
            first_place: PlaceId(0),
            is_omitted: false,
        };
        let mut places = source.outputs.len();
        let mut producers = vec![source];
        for (index, node) in NodeId::enumerate(&plan.nodes) {
            let outputs = frame_ports(&node.outputs);
            let inputs = node.inputs.iter().map(|i| i.port.clone()).collect();
            let first_place = PlaceId(places);
            places += outputs.len();
            let is_omitted = omitted.contains(&index);
            producers.push(Producer { inputs, feeds: Vec::new(), outputs, first_place, is_omitted });
        }
        let mut graph = Self {
            places: (0..places).map(|_| Place { uses: 0, keyed: false }).collect(),
            parts: vec![Vec::new(); sink.parts(run)],
            order: (0..=plan.nodes.len() + sink.parts(run)).map(|_| Order::default()).collect(),
            steps_per_frame: 1,
            producers,
        };
        for (index, node) in NodeId::enumerate(&plan.nodes).filter(|(_, n)| n.contract != Contract::Once) {
            let own_step = StepId::of_node(index);
            let mut feeds = Vec::with_capacity(node.inputs.len());
            let inputs = if omitted.contains(&index) { &[][..] } else { &node.inputs };
            for input in inputs {
                let feed = match &input.from {
                    None => Feed::Unwired,
                    Some(Origin::Here(slot)) => graph.place_of(plan, *slot).ok_or_else(|| {
                        let (input, node) = (input.port.name, &node.name);
                        ErrorMessage::new(format!(
                            "input `{input}` of node `{node}` is not wired to a per-frame output"
                        ))
                    })?,
                    Some(elsewhere) => match once(elsewhere) {
                        AggregateState::There(value) => Feed::Once(Some(value)),
                        AggregateState::Absent => Feed::Once(None),
                        AggregateState::Pending => {
                            return Err(ErrorMessage::new(format!(
                                "the aggregate value at input `{}` of node `{}` is not known before the stage's frames",
                                input.port.name, node.name
                            )));
                        }
                    },
                };
                if let Feed::Place { place, step } = feed {
                    if step >= own_step {
                        return Err(ErrorMessage::new(format!("node `{}` reads a node after it", node.name)));
                    }
                    graph.places[place].uses += 1;
                    graph.places[place].keyed = true;
                }
                feeds.push(feed);
            }
            let steps = feeds.iter().filter_map(|w| if let Feed::Place { step, .. } = w { Some(*step) } else { None });
            graph.wait(steps.collect(), own_step);
            graph.producers[own_step].feeds = feeds;
        }
        graph.add_parts(run, plan, sink)?;
        Ok(graph)
    }

    pub(crate) fn step(&self, step: StepId) -> Step {
        match step.node() {
            None => Step::Source,
            Some(node) if step.0 < self.producers.len() => Step::Node(node),
            Some(_) => Step::Encode(PartId(step.0 - self.producers.len())),
        }
    }

    fn place_of(&self, plan: &StageRun, slot: Slot) -> Option<Feed> {
        let (outputs, port) = match slot {
            Slot::Source { port } => (&plan.source.outputs, port),
            Slot::Node { node, port } => (&plan.nodes.get(node.0)?.outputs, port),
        };
        if outputs.get(port.0)?.port.rate != Rate::Frame {
            return None;
        }
        let before = outputs[..port.0].iter().filter(|o| o.port.rate == Rate::Frame).count();
        let step = StepId::of_slot(slot);
        Some(Feed::Place { place: self.producers[step].place(OutputId(before)), step })
    }

    /// Adds the values that the sink takes.
    fn add_parts<T: Sink>(&mut self, run: RunId, plan: &StageRun, sink: &T) -> Result<(), ErrorMessage> {
        let mut steps = vec![Vec::new(); self.parts.len()];
        for slot in plan.slots() {
            let Some(Feed::Place { place, step }) = self.place_of(plan, slot) else { continue };
            let Some(part) = sink.part(run, slot) else { continue };
            let count = self.parts.len();
            let values = self.parts.get_mut(part.0);
            values
                .ok_or_else(|| ErrorMessage::new(format!("the sink has {count} parts, and none is {part}")))?
                .push((slot, place));
            self.places[place].uses += 1;
            steps[part].push(step);
        }
        for (part, steps) in steps.into_iter().enumerate() {
            self.wait(steps, StepId(self.producers.len() + part));
        }
        Ok(())
    }

    /// Makes a step wait for the others, or for the source if `others` is empty.
    fn wait(&mut self, mut others: Vec<StepId>, step: StepId) {
        others.sort_unstable();
        others.dedup();
        if others.is_empty() {
            others.push(StepId::SOURCE);
        }
        self.order[step].waits_for = u32::try_from(others.len()).unwrap_or(u32::MAX);
        others.iter().for_each(|&other| self.order[other].then.push(step));
        self.steps_per_frame += 1;
    }
}

fn frame_ports(outputs: &[PlannedOutput]) -> Vec<Port> {
    outputs.iter().map(|o| &o.port).filter(|p| p.rate == Rate::Frame).cloned().collect()
}
