//! Sharing: nodes of equal kind, parameters and inputs are one node, whichever variants they come from.
//!
//! Operational parameters do not count: of nodes that differ in them alone, the first in order of variants and file gives its own. Files
//! count by what is in them.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::linked::{Linked, LinkedNode, LinkedSource, Wire};
use super::recipe::{self, InputRecipe};
use super::record::Recording;
use super::topics;
use crate::contracts::Slot;
use crate::key::Key;
use crate::language::check::params::{Parameters, canonical};
use crate::language::text::source_file::Place;
use crate::plan::{Estimate, From, PlannedInput, PlannedNode, PlannedOutput, PlannedSource, StageRun};

/// Where the nodes of each variant went: by variant and stage, the stage run and the planned node of each of its nodes.
pub(crate) struct Shared {
    pub(crate) runs: Vec<StageRun>,
    pub(crate) placed: Vec<Vec<PlacedStage>>,
    /// By stage run and planned node, where the first of those it stands for is written.
    pub(crate) places: Vec<Vec<Place>>,
    /// Nodes that share one with other operational parameters.
    pub(crate) overruled: Vec<Overruled>,
}

/// A node whose operational parameters do not count, since it is one with a node written before it.
pub(crate) struct Overruled {
    pub(crate) node: String,
    pub(crate) place: Place,
    /// The variant and node whose parameters count.
    pub(crate) variant: usize,
    pub(crate) first: String,
}

/// A stage of a variant, in the plan.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct PlacedStage {
    pub(crate) run: usize,
    /// By the linked stage's nodes; `None` for those of no use to this variant.
    pub(crate) nodes: Vec<Option<usize>>,
}

/// What makes two nodes of a stage run the same.
#[derive(PartialEq, Eq, Hash)]
struct Identity {
    run: usize,
    kind: &'static str,
    params: String,
    inputs: Vec<Option<InputIdentity>>,
}

/// What makes two inputs the same.
#[derive(PartialEq, Eq, Hash)]
enum InputIdentity {
    Value(From),
    Content(Key),
}

/// The nodes there are: by identity, the planned node, and the variant and parameters it is from.
type Known = HashMap<Identity, (usize, usize, Arc<Parameters>)>;

/// Puts linked variants without errors together.
pub(crate) fn share(
    names: &[String],
    variants: &[Linked<'_>],
    live: &[HashSet<(usize, usize)>],
    recording: &Recording,
) -> Shared {
    let placed = vec![Vec::new(); variants.len()];
    let mut shared = Shared { runs: Vec::new(), placed, places: Vec::new(), overruled: Vec::new() };
    let mut known = Known::new();
    let stages = variants.first().map_or(0, |linked| linked.stages.len());
    for s in 0..stages {
        // Stage runs first: once-values of this stage are looked up by run.
        let first_run = shared.runs.len();
        for (v, linked) in variants.iter().enumerate() {
            let Some(source) = &linked.stages[s].source else { continue };
            let run = shared.runs[first_run..].iter().position(|run| same_frames(&run.source, source));
            let run = run.map_or_else(|| shared.open_run(&linked.stages[s].name.text, source), |run| first_run + run);
            shared.runs[run].variants.push(v);
            shared.placed[v].push(PlacedStage { run, nodes: vec![None; linked.stages[s].nodes.len()] });
        }
        for (v, linked) in variants.iter().enumerate() {
            let stage = &linked.stages[s];
            for &n in stage.order.iter().filter(|&&n| live[v].contains(&(s, n))) {
                let planned = shared.place(&mut known, v, s, &stage.nodes[n]);
                shared.placed[v][s].nodes[n] = planned;
            }
        }
    }
    topics::name(&mut shared, names, variants, recording);
    estimates(&mut shared, names, variants);
    shared
}

fn same_frames(planned: &PlannedSource, linked: &LinkedSource) -> bool {
    planned.parts == linked.parts
}

impl Shared {
    fn open_run(&mut self, stage: &str, source: &LinkedSource) -> usize {
        let outputs = source.outputs.iter().cloned().map(unnamed).collect();
        self.runs.push(StageRun {
            stage: stage.to_owned(),
            prefix: String::new(),
            source: PlannedSource { name: source.name.clone(), parts: source.parts.clone(), outputs },
            nodes: Vec::new(),
            estimates: Vec::new(),
            variants: Vec::new(),
        });
        self.places.push(Vec::new());
        self.runs.len() - 1
    }

    /// The planned node of a variant's node: one that is there already, or a new one.
    fn place(&mut self, known: &mut Known, variant: usize, stage: usize, node: &LinkedNode<'_>) -> Option<usize> {
        let (kind, parameters) = (node.kind?, node.parameters.as_ref()?);
        let run = self.placed[variant][stage].run;
        let declaration = &kind.declaration;
        let inputs: Vec<Option<From>> =
            node.wires.iter().map(|wire| self.from(variant, stage, wire.as_ref()?)).collect();
        let identity = Identity {
            run,
            kind: declaration.kind,
            params: parameters.identity.clone(),
            inputs: inputs
                .iter()
                .zip(&node.wires)
                .map(|(from, wire)| input_identity(from.as_ref()?, wire.as_ref()?))
                .collect(),
        };
        let next = self.runs[run].nodes.len();
        let (index, first, counting) = known.entry(identity).or_insert_with(|| (next, variant, Arc::clone(parameters)));
        let index = *index;
        if counting.operational != parameters.operational {
            self.overruled.push(Overruled {
                node: node.name.text.clone(),
                place: node.name.place.clone(),
                variant: *first,
                first: self.runs[run].nodes[index].name.clone(),
            });
        }
        if index == next {
            let contributions: Vec<(&'static str, InputRecipe<'_>)> = declaration
                .inputs
                .iter()
                .zip(&node.wires)
                .zip(&inputs)
                .filter_map(|((port, wire), from)| {
                    Some((port.name, self.contribution(run, wire.as_ref()?, from.as_ref()?)))
                })
                .collect();
            let recipe =
                recipe::of(declaration.kind, declaration.version, &canonical(&parameters.portable), &contributions);
            self.places[run].push(node.name.place.clone());
            let ports = declaration.inputs.iter().cloned();
            self.runs[run].nodes.push(PlannedNode {
                name: node.name.text.clone(),
                kind: declaration.kind.to_owned(),
                version: declaration.version,
                contract: declaration.contract,
                params: parameters.resolved.clone(),
                portable: parameters.portable.clone(),
                inputs: ports.zip(inputs).map(|(port, from)| PlannedInput { port, from }).collect(),
                outputs: declaration.outputs.iter().cloned().map(unnamed).collect(),
                recipe,
                variants: Vec::new(),
            });
        }
        let planned = &mut self.runs[run].nodes[index];
        if planned.variants.last() != Some(&variant) {
            planned.variants.push(variant);
        }
        Some(index)
    }

    fn from(&self, variant: usize, stage: usize, wire: &Wire) -> Option<From> {
        match wire {
            Wire::Source { port } => Some(From::Here(Slot::Source { port: *port })),
            Wire::File { path, .. } => Some(From::File(path.clone())),
            Wire::Node { stage: of, node, port } => {
                let placed = &self.placed[variant][*of];
                let node = placed.nodes[*node]?;
                let once = self.runs[placed.run].nodes[node].outputs[*port].port.rate == crate::contracts::Rate::Once;
                Some(if once || *of != stage {
                    From::Once { run: placed.run, node, port: *port }
                } else {
                    From::Here(Slot::Node { node, port: *port })
                })
            }
        }
    }

    fn contribution<'a>(&'a self, run: usize, wire: &'a Wire, from: &From) -> InputRecipe<'a> {
        let of = |run: usize, node: usize, port: usize| {
            let node = &self.runs[run].nodes[node];
            InputRecipe::Node(&node.recipe, node.outputs[port].port.name)
        };
        match (from, wire) {
            (From::Here(Slot::Source { port }), _) => {
                InputRecipe::Source(self.runs[run].source.outputs[*port].port.name)
            }
            (From::Here(Slot::Node { node, port }), _) => of(run, *node, *port),
            (From::Once { run, node, port }, _) => of(*run, *node, *port),
            (From::File(_), Wire::File { content, .. }) => InputRecipe::File(content),
            (From::File(_), _) => unreachable!("only a file's wire becomes a file"),
        }
    }
}

/// A file counts by its content, wherever it lies.
fn input_identity(from: &From, wire: &Wire) -> Option<InputIdentity> {
    Some(match wire {
        Wire::File { content, .. } => InputIdentity::Content(*content),
        Wire::Source { .. } | Wire::Node { .. } => InputIdentity::Value(from.clone()),
    })
}

fn unnamed(port: crate::contracts::Port) -> PlannedOutput {
    PlannedOutput { port, topic: String::new(), aliases: Vec::new(), recorded: false }
}

/// Labels what is scored: an estimate that is the same in all variants once, any other once a variant.
fn estimates(shared: &mut Shared, names: &[String], variants: &[Linked<'_>]) {
    let Some(first) = variants.first() else { return };
    for (s, stage) in first.stages.iter().enumerate() {
        let name = |e: usize| stage.estimates[e].name.text.clone();
        let place = |shared: &Shared, v: usize, e: usize| {
            let placed = &shared.placed[v][s];
            Some((placed.run, placed.nodes[variants[v].stages[s].estimates[e].node]?))
        };
        let everywhere = |shared: &Shared, e: usize| {
            let here = place(shared, 0, e);
            (1..variants.len()).all(|v| place(shared, v, e) == here)
        };
        let (alike, differing): (Vec<usize>, Vec<usize>) =
            (0..stage.estimates.len()).partition(|&e| everywhere(shared, e));
        let mut found = Vec::new();
        for e in alike {
            found.extend(place(shared, 0, e).map(|at| (at, name(e), name(e), None)));
        }
        for (v, variant) in names.iter().enumerate() {
            for &e in &differing {
                let label = format!("{variant}/{}", name(e));
                found.extend(place(shared, v, e).map(|at| (at, label, name(e), Some(v))));
            }
        }
        for ((run, score_node), label, name, variant) in found {
            let slot = |port: &str| {
                let inputs = &shared.runs[run].nodes[score_node].inputs;
                match inputs.iter().find(|input| input.port.name == port)?.from {
                    Some(From::Here(slot)) => Some(slot),
                    _ => None,
                }
            };
            let (Some(estimate), Some(truth)) = (slot("estimate"), slot("truth")) else { continue };
            shared.runs[run].estimates.push(Estimate { label, name, variant, estimate, truth, score_node });
        }
    }
}
