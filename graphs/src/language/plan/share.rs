//! Sharing: nodes of equal kind, parameters and inputs are one node, across variants.
//!
//! Operational parameters do not count: the first node in order of variants and file determines them. Files count by
//! content.

use std::collections::{HashMap, HashSet};

use super::linked::{Linked, LinkedNode, LinkedSource, Wire};
use super::node_hash::{self, InputHash};
use crate::contracts::{Rate, Signature, Slot};
use crate::key::Key;
use crate::language::check::params::{Parameters, canonical};
use crate::language::ids::{StageId, StageNode};
use crate::language::text::source_file::Place;
use crate::plan::{NodeId, Origin, PortId, RunId, VariantId};
use crate::registry::NodeKind;

pub(crate) struct Shared<'l> {
    pub(crate) runs: Vec<SharedRun<'l>>,
    /// By variant and stage.
    pub(crate) placed: Vec<Vec<PlacedStage>>,
    pub(crate) overruled: Vec<Overruled>,
}

pub(crate) struct SharedRun<'l> {
    pub(crate) stage: &'l str,
    pub(crate) source: &'l LinkedSource,
    pub(crate) nodes: Vec<SharedNode<'l>>,
    pub(crate) variants: Vec<VariantId>,
}

pub(crate) struct SharedNode<'l> {
    /// The first of the nodes that it replaces.
    pub(crate) first: &'l LinkedNode<'l>,
    pub(crate) kind: &'l NodeKind,
    pub(crate) parameters: &'l Parameters,
    pub(crate) signature: &'l Signature,
    /// By input port.
    pub(crate) inputs: Vec<Option<Origin>>,
    pub(crate) node_hash: Key,
    pub(crate) variants: Vec<VariantId>,
}

pub(crate) struct Overruled {
    pub(crate) node: String,
    pub(crate) place: Place,
    /// The variant and node whose parameters count.
    pub(crate) variant: VariantId,
    pub(crate) first: String,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct PlacedStage {
    pub(crate) run: RunId,
    /// By node of the linked stage; `None` for unused nodes.
    pub(crate) nodes: Vec<Option<NodeId>>,
}

#[derive(PartialEq, Eq, Hash)]
struct Identity {
    run: RunId,
    kind: &'static str,
    params: String,
    inputs: Vec<Option<InputIdentity>>,
}

#[derive(PartialEq, Eq, Hash)]
enum InputIdentity {
    Value(Origin),
    Content(Key),
}

/// The node of the stage run, and its first variant.
type NodesByIdentity = HashMap<Identity, (NodeId, VariantId)>;

pub(crate) fn share<'l>(variants: &'l [Linked<'l>], live: &[HashSet<StageNode>]) -> Shared<'l> {
    let mut shared = Shared { runs: Vec::new(), placed: vec![Vec::new(); variants.len()], overruled: Vec::new() };
    let mut known = NodesByIdentity::new();
    let stages = variants.first().map_or(0, |linked| linked.stages.len());
    for stage_id in StageId::all(stages) {
        // Stage runs first: aggregate values of this stage are looked up by run.
        let first_run = shared.runs.len();
        for (variant, linked) in VariantId::enumerate(variants) {
            let stage = &linked.stages[stage_id];
            let Some(source) = &stage.source else { continue };
            let equal = |run: &SharedRun<'_>| run.source.parts == source.parts;
            let known = shared.runs[first_run..].iter().position(equal);
            let run = RunId(known.map_or(shared.runs.len(), |known| first_run + known));
            if known.is_none() {
                let (nodes, variants) = (Vec::new(), Vec::new());
                shared.runs.push(SharedRun { stage: &stage.name.text, source, nodes, variants });
            }
            shared.runs[run].variants.push(variant);
            shared.placed[variant].push(PlacedStage { run, nodes: vec![None; stage.nodes.len()] });
        }
        for (variant, linked) in VariantId::enumerate(variants) {
            let stage = &linked.stages[stage_id];
            for &node in &stage.order {
                if live[variant].contains(&StageNode { stage: stage_id, node }) {
                    let placed = shared.place(&mut known, variant, stage_id, &stage.nodes[node]);
                    shared.placed[variant][stage_id].nodes[node] = placed;
                }
            }
        }
    }
    shared
}

impl<'l> Shared<'l> {
    fn place(
        &mut self,
        known: &mut NodesByIdentity,
        variant: VariantId,
        stage: StageId,
        node: &'l LinkedNode<'l>,
    ) -> Option<NodeId> {
        let (kind, parameters, signature) =
            (node.types.kind?, node.types.parameters.as_deref()?, node.types.signature.as_deref()?);
        let run = self.placed[variant][stage].run;
        let declaration = &kind.declaration;
        let inputs: Vec<Option<Origin>> =
            node.wires.iter().map(|wire| self.origin(variant, stage, wire.as_ref()?)).collect();
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
        let next = NodeId(self.runs[run].nodes.len());
        let &mut (index, first) = known.entry(identity).or_insert((next, variant));
        if index == next {
            let contributions: Vec<(&'static str, InputHash<'_>)> = signature
                .inputs
                .iter()
                .zip(&node.wires)
                .zip(&inputs)
                .filter_map(|((port, wire), from)| {
                    Some((port.name, self.contribution(run, wire.as_ref()?, from.as_ref()?)))
                })
                .collect();
            let node_hash = node_hash::node_hash(
                declaration.kind,
                declaration.version,
                &canonical(&parameters.portable),
                &contributions,
            );
            let variants = Vec::new();
            self.runs[run].nodes.push(SharedNode {
                first: node,
                kind,
                parameters,
                signature,
                inputs,
                node_hash,
                variants,
            });
        }
        let shared = &mut self.runs[run].nodes[index];
        if shared.parameters.operational != parameters.operational {
            self.overruled.push(Overruled {
                node: node.name.text.clone(),
                place: node.name.place.clone(),
                variant: first,
                first: shared.first.name.text.clone(),
            });
        }
        if shared.variants.last() != Some(&variant) {
            shared.variants.push(variant);
        }
        Some(index)
    }

    fn origin(&self, variant: VariantId, stage: StageId, wire: &Wire) -> Option<Origin> {
        match wire {
            Wire::Source { port } => Some(Origin::Here(Slot::Source { port: *port })),
            Wire::File { path, .. } => Some(Origin::File(path.clone())),
            Wire::Node { node: read, port } => {
                let placed = &self.placed[variant][read.stage];
                let node = placed.nodes[read.node]?;
                let once = self.runs[placed.run].nodes[node].signature.outputs[*port].rate == Rate::Once;
                Some(if once || read.stage != stage {
                    Origin::Once { run: placed.run, node, port: *port }
                } else {
                    Origin::Here(Slot::Node { node, port: *port })
                })
            }
        }
    }

    fn contribution<'a>(&'a self, run: RunId, wire: &'a Wire, from: &Origin) -> InputHash<'a> {
        let output = |run: RunId, node: NodeId, port: PortId| {
            let node = &self.runs[run].nodes[node];
            InputHash::Node(&node.node_hash, node.signature.outputs[port].name)
        };
        match (from, wire) {
            (Origin::Here(Slot::Source { port }), _) => InputHash::Source(self.runs[run].source.outputs[*port].name),
            (Origin::Here(Slot::Node { node, port }), _) => output(run, *node, *port),
            (Origin::Once { run, node, port }, _) => output(*run, *node, *port),
            (Origin::File(_), Wire::File { content, .. }) => InputHash::File(content),
            (Origin::File(_), _) => unreachable!("only a file's wire becomes a file"),
        }
    }
}

/// A file is identified by its content.
fn input_identity(from: &Origin, wire: &Wire) -> Option<InputIdentity> {
    Some(match wire {
        Wire::File { content, .. } => InputIdentity::Content(*content),
        Wire::Source { .. } | Wire::Node { .. } => InputIdentity::Value(from.clone()),
    })
}
