//! What is shared, put together as the stage runs of a plan.

use super::linked::{Linked, Wire};
use super::record::Recorded;
use super::share::{PlacedStage, Shared, SharedNode, SharedRun};
use super::topics::Topics;
use crate::plan::{Estimate, Origin, PlannedInput, PlannedNode, PlannedSource, StageRun};

/// The stage runs of all variants, named.
pub(crate) fn stage_runs(
    shared: &Shared<'_>,
    names: &[String],
    variants: &[Linked<'_>],
    recorded: &Recorded,
) -> Vec<StageRun> {
    let topics = Topics::new(shared, names, variants, recorded);
    let runs = shared.runs.iter().enumerate();
    let mut runs: Vec<StageRun> = runs.map(|(r, run)| stage_run(shared, r, run, &topics)).collect();
    label(&mut runs, &shared.placed, names, variants);
    runs
}

fn stage_run(shared: &Shared<'_>, r: usize, run: &SharedRun<'_>, topics: &Topics<'_>) -> StageRun {
    let source = PlannedSource {
        name: run.source.name.clone(),
        parts: run.source.parts.clone(),
        outputs: topics.of_source(run),
    };
    let planned = |(n, node): (usize, &SharedNode<'_>)| {
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
            outputs: topics.of_node(shared, r, n),
            observes: node.signature.observes.clone(),
            recipe: node.recipe,
            variants: node.variants.clone(),
        }
    };
    StageRun {
        stage: run.stage.to_owned(),
        prefix: topics.prefix(run),
        source,
        nodes: run.nodes.iter().enumerate().map(planned).collect(),
        estimates: Vec::new(),
        variants: run.variants.clone(),
    }
}

/// The path of a file as it may be shown, where a variable is part of it.
fn shown(wire: Option<&Wire>) -> Option<String> {
    match wire {
        Some(Wire::File { shown, .. }) => shown.clone(),
        _ => None,
    }
}

/// Labels what is scored: an estimate that is the same in all variants once, any other once a variant.
fn label(runs: &mut [StageRun], placed: &[Vec<PlacedStage>], names: &[String], variants: &[Linked<'_>]) {
    let Some(first) = variants.first() else { return };
    for (s, stage) in first.stages.iter().enumerate() {
        let name = |e: usize| stage.estimates[e].name.text.clone();
        let place = |v: usize, e: usize| {
            let placed = &placed[v][s];
            Some((placed.run, placed.nodes[variants[v].stages[s].estimates[e].node]?))
        };
        let everywhere = |e: usize| {
            let here = place(0, e);
            (1..variants.len()).all(|v| place(v, e) == here)
        };
        let (alike, differing): (Vec<usize>, Vec<usize>) = (0..stage.estimates.len()).partition(|&e| everywhere(e));
        let mut found = Vec::new();
        for e in alike {
            found.extend(place(0, e).map(|at| (at, name(e), name(e), None)));
        }
        for (v, variant) in names.iter().enumerate() {
            for &e in &differing {
                let label = format!("{variant}/{}", name(e));
                found.extend(place(v, e).map(|at| (at, label, name(e), Some(v))));
            }
        }
        for ((run, score_node), label, name, variant) in found {
            let slot = |port: &str| {
                let inputs = &runs[run].nodes[score_node].inputs;
                match inputs.iter().find(|input| input.port.name == port)?.from {
                    Some(Origin::Here(slot)) => Some(slot),
                    _ => None,
                }
            };
            let (Some(estimate), Some(truth)) = (slot("estimate"), slot("truth")) else { continue };
            runs[run].estimates.push(Estimate { label, name, variant, estimate, truth, score_node });
        }
    }
}
