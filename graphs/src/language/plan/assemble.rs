//! What is shared, put together as the stage runs of a plan.

use super::linked::{Linked, Wire};
use super::record::Recorded;
use super::share::{PlacedStage, Shared, SharedNode};
use super::topics::Topics;
use crate::language::ids::StageId;
use crate::plan::{
    Estimate, NodeId, NodeRef, Origin, PlannedInput, PlannedNode, PlannedSource, RunId, StageRun, VariantId,
};

pub(crate) fn stage_runs(
    shared: &Shared<'_>,
    names: &[String],
    variants: &[Linked<'_>],
    recorded: &Recorded,
) -> Vec<StageRun> {
    let topics = Topics::new(shared, names, variants, recorded);
    let mut runs: Vec<StageRun> = RunId::all(shared.runs.len()).map(|run| stage_run(shared, run, &topics)).collect();
    label(&mut runs, &shared.placed, names, variants);
    runs
}

fn stage_run(shared: &Shared<'_>, run_id: RunId, topics: &Topics<'_>) -> StageRun {
    let run = &shared.runs[run_id];
    let source = PlannedSource {
        name: run.source.name.clone(),
        parts: run.source.parts.clone(),
        outputs: topics.of_source(run),
    };
    let planned = |(node_id, node): (NodeId, &SharedNode<'_>)| {
        let declaration = &node.kind.declaration;
        let wired = node.inputs.iter().cloned().zip(&node.first.wires);
        let inputs = node.signature.inputs.iter().cloned().zip(wired);
        let inputs = inputs.map(|(port, (from, wire))| PlannedInput { port, from, shown: shown(wire.as_ref()) });
        PlannedNode {
            name: node.first.name.text.clone(),
            kind: declaration.kind.to_owned(),
            version: declaration.version,
            contract: node.signature.contract,
            params: node.parameters.resolved.clone(),
            shown: node.parameters.shown.clone(),
            portable: node.parameters.recorded.clone(),
            auto: node.parameters.following.iter().filter(|one| one.is_auto).map(|one| one.name.clone()).collect(),
            inputs: inputs.collect(),
            outputs: topics.of_node(shared, NodeRef { run: run_id, node: node_id }),
            observes: node.signature.observes.clone(),
            node_hash: node.node_hash,
            variants: node.variants.clone(),
        }
    };
    StageRun {
        stage: run.stage.to_owned(),
        prefix: topics.prefix(run),
        source,
        nodes: NodeId::enumerate(&run.nodes).map(planned).collect(),
        estimates: Vec::new(),
        variants: run.variants.clone(),
    }
}

fn shown(wire: Option<&Wire>) -> Option<String> {
    match wire {
        Some(Wire::File { shown, .. }) => shown.clone(),
        _ => None,
    }
}

/// An estimate that is the same in all variants has one label, any other one per variant.
fn label(runs: &mut [StageRun], placed: &[Vec<PlacedStage>], names: &[String], variants: &[Linked<'_>]) {
    let Some(first) = variants.first() else { return };
    for (stage_id, stage) in StageId::enumerate(&first.stages) {
        let name = |e: usize| stage.estimates[e].name.text.clone();
        let place = |variant: VariantId, e: usize| {
            let placed = &placed[variant][stage_id];
            let node = placed.nodes[variants[variant].stages[stage_id].estimates[e].node]?;
            Some(NodeRef { run: placed.run, node })
        };
        let everywhere =
            |e: usize| VariantId::all(variants.len()).all(|other| place(other, e) == place(VariantId(0), e));
        let (alike, differing): (Vec<usize>, Vec<usize>) = (0..stage.estimates.len()).partition(|&e| everywhere(e));
        let mut found = Vec::new();
        for e in alike {
            found.extend(place(VariantId(0), e).map(|at| (at, name(e), name(e), None)));
        }
        for (variant, variant_name) in VariantId::enumerate(names) {
            for &e in &differing {
                let label = format!("{variant_name}/{}", name(e));
                found.extend(place(variant, e).map(|at| (at, label, name(e), Some(variant))));
            }
        }
        for (NodeRef { run, node: score_node }, label, name, variant) in found {
            let slot = |port: &str| {
                let inputs = &runs[run].nodes[score_node].inputs;
                match inputs.iter().find(|input| input.port.name == port)?.from {
                    Some(Origin::Here(slot)) => Some(slot),
                    _ => None,
                }
            };
            let (Some(estimate), Some(truth)) = (slot("estimate"), slot("ground_truth")) else { continue };
            runs[run].estimates.push(Estimate { label, name, variant, estimate, truth, score_node });
        }
    }
}
