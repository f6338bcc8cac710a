//! A stage run's frame graph, laid out by index: which step waits for which, and where values lie.

use depthloom_graphs::contracts::{Contract, Slot, Tap};
use depthloom_graphs::plan::{Origin, PlannedOutput, StageRun};
use depthloom_graphs::{Instance, Port, Rate};

use crate::once::{OnceState, OnceValue};

/// A step of a frame: the source, a node or a part to encode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Reading the frame.
    Source,
    /// A node, by its index in the stage run.
    Node(usize),
    /// A part of the tap's.
    Encode(usize),
}

/// What feeds an input port.
pub(crate) enum Feed {
    /// Nothing.
    Unwired,
    /// A per-frame value: the place it lies in, and the step that puts it there.
    Place { place: usize, step: usize },
    /// A once-value, which is there before the frames; `None` if its node did not give it.
    Once(Option<OnceValue>),
}

/// A per-frame output.
pub(crate) struct Place {
    /// How many inputs and parts take the value; it is dropped with the last.
    pub(crate) uses: u32,
    /// Whether a node takes it, so that it needs a key of its own.
    pub(crate) keyed: bool,
}

/// What gives values: the source, or a node.
pub(crate) struct Producer {
    /// The input ports.
    pub(crate) inputs: Vec<Port>,
    /// What feeds them.
    pub(crate) feeds: Vec<Feed>,
    /// The per-frame output ports.
    pub(crate) outputs: Vec<Port>,
    /// Where the first of their values lies; the others follow.
    pub(crate) first_place: usize,
}

/// When a step runs.
#[derive(Default)]
pub(crate) struct Order {
    /// How many other steps it waits for.
    pub(crate) waits_for: u32,
    /// The steps that wait for it.
    pub(crate) then: Vec<usize>,
}

/// A stage run's frame graph.
///
/// Steps are numbered: the source, then the nodes, then the parts. A once-node has its number, but nothing leads to it.
pub(crate) struct FrameGraph {
    /// The source and the nodes, by step.
    pub(crate) producers: Vec<Producer>,
    /// Per-frame outputs: the source's ports, then the nodes' in plan order.
    pub(crate) places: Vec<Place>,
    /// What the tap takes, by part: in plan order.
    pub(crate) parts: Vec<Vec<(Slot, usize)>>,
    /// By step.
    pub(crate) order: Vec<Order>,
    /// How many steps a frame has.
    pub(crate) steps_per_frame: u32,
}

impl FrameGraph {
    /// Lays out a stage run. `once` finds the once-values that are there before the frames.
    ///
    /// # Errors
    /// Where the plan contradicts itself, the nodes built or the tap.
    pub(crate) fn new<T: Tap>(
        run: usize,
        plan: &StageRun,
        tap: &T,
        once: impl Fn(&Origin) -> OnceState,
    ) -> Result<Self, String> {
        let source = Producer {
            inputs: Vec::new(),
            feeds: Vec::new(),
            outputs: frame_ports(&plan.source.outputs),
            first_place: 0,
        };
        let mut places = source.outputs.len();
        let mut producers = vec![source];
        for node in &plan.nodes {
            let outputs = frame_ports(&node.outputs);
            let inputs = node.inputs.iter().map(|i| i.port.clone()).collect();
            let first_place = places;
            places += outputs.len();
            producers.push(Producer { inputs, feeds: Vec::new(), outputs, first_place });
        }
        let mut graph = Self {
            places: (0..places).map(|_| Place { uses: 0, keyed: false }).collect(),
            parts: vec![Vec::new(); tap.parts(run)],
            order: (0..=plan.nodes.len() + tap.parts(run)).map(|_| Order::default()).collect(),
            steps_per_frame: 1,
            producers,
        };
        for (index, node) in plan.nodes.iter().enumerate().filter(|(_, n)| n.contract != Contract::Once) {
            let mut feeds = Vec::with_capacity(node.inputs.len());
            for input in &node.inputs {
                let feed = match &input.from {
                    None => Feed::Unwired,
                    Some(Origin::Here(slot)) => graph.place_of(plan, *slot).ok_or_else(|| {
                        format!("input `{}` of node `{}` is wired to no per-frame output", input.port.name, node.name)
                    })?,
                    Some(elsewhere) => match once(elsewhere) {
                        OnceState::There(value) => Feed::Once(Some(value)),
                        OnceState::Absent => Feed::Once(None),
                        OnceState::Pending => {
                            return Err(format!(
                                "the once-value at input `{}` of node `{}` is not there before the stage's frames",
                                input.port.name, node.name
                            ));
                        }
                    },
                };
                if let Feed::Place { place, step } = feed {
                    if step > index {
                        return Err(format!("node `{}` reads a node after it", node.name));
                    }
                    graph.places[place].uses += 1;
                    graph.places[place].keyed = true;
                }
                feeds.push(feed);
            }
            let steps = feeds.iter().filter_map(|w| if let Feed::Place { step, .. } = w { Some(*step) } else { None });
            graph.wait(steps.collect(), 1 + index);
            graph.producers[1 + index].feeds = feeds;
        }
        graph.hand_over(run, plan, tap)?;
        Ok(graph)
    }

    /// What step a number stands for.
    pub(crate) const fn step(&self, number: usize) -> Step {
        match number {
            0 => Step::Source,
            _ if number < self.producers.len() => Step::Node(number - 1),
            _ => Step::Encode(number - self.producers.len()),
        }
    }

    fn place_of(&self, plan: &StageRun, slot: Slot) -> Option<Feed> {
        let (outputs, step, port) = match slot {
            Slot::Source { port } => (&plan.source.outputs, 0, port),
            Slot::Node { node, port } => (&plan.nodes.get(node)?.outputs, 1 + node, port),
        };
        if outputs.get(port)?.port.rate != Rate::Frame {
            return None;
        }
        let before = outputs[..port].iter().filter(|o| o.port.rate == Rate::Frame).count();
        Some(Feed::Place { place: self.producers[step].first_place + before, step })
    }

    /// Asks the tap which values it takes, and in which part.
    fn hand_over<T: Tap>(&mut self, run: usize, plan: &StageRun, tap: &T) -> Result<(), String> {
        let mut steps = vec![Vec::new(); self.parts.len()];
        let of_source = (0..plan.source.outputs.len()).map(|port| Slot::Source { port });
        let of_nodes = plan.nodes.iter().enumerate();
        let of_nodes = of_nodes.flat_map(|(node, n)| (0..n.outputs.len()).map(move |port| Slot::Node { node, port }));
        for slot in of_source.chain(of_nodes) {
            let Some(Feed::Place { place, step }) = self.place_of(plan, slot) else { continue };
            let Some(part) = tap.part(run, slot) else { continue };
            let count = self.parts.len();
            let taken = self.parts.get_mut(part).ok_or_else(|| format!("the tap has {count} parts, none is {part}"))?;
            taken.push((slot, place));
            self.places[place].uses += 1;
            steps[part].push(step);
        }
        for (part, steps) in steps.into_iter().enumerate() {
            self.wait(steps, self.producers.len() + part);
        }
        Ok(())
    }

    /// Makes a step wait for others; for the source, if there are none.
    fn wait(&mut self, mut others: Vec<usize>, step: usize) {
        others.sort_unstable();
        others.dedup();
        if others.is_empty() {
            others.push(0);
        }
        self.order[step].waits_for = u32::try_from(others.len()).unwrap_or(u32::MAX);
        others.iter().for_each(|&other| self.order[other].then.push(step));
        self.steps_per_frame += 1;
    }
}

fn frame_ports(outputs: &[PlannedOutput]) -> Vec<Port> {
    outputs.iter().map(|o| &o.port).filter(|p| p.rate == Rate::Frame).cloned().collect()
}

/// The contract of a node that was built.
pub(crate) const fn contract_of(instance: &Instance) -> Contract {
    match instance {
        Instance::Pure(_) => Contract::Pure,
        Instance::Ordered(_) => Contract::Ordered,
        Instance::Once(_) => Contract::Once,
    }
}
