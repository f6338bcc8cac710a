//! Which nodes of a variant are useful: recorded, scored, or read by a useful node; and stages that are not used.

use std::collections::HashSet;

use super::linked::Linked;
use super::record::Recorded;
use crate::contracts::Rate;
use crate::language::ids::{StageId, StageNode, StageNodeId};
use crate::language::text::diagnostics::{Diagnostic, Report};

pub(crate) fn nodes(linked: &Linked<'_>, recording: &Recorded) -> HashSet<StageNode> {
    let mut live = HashSet::new();
    let mut open = Vec::new();
    for (stage_id, stage) in StageId::enumerate(&linked.stages) {
        for (node_id, node) in StageNodeId::enumerate(&stage.nodes) {
            let is_recorded = node.types.signature.as_ref().is_none_or(|signature| {
                // A node without outputs (a sink) is used for its effects.
                let outputs = &signature.outputs;
                outputs.is_empty() || outputs.iter().any(|o| recording.keeps(&stage.name.text, &node.name.text, o))
            });
            if node.is_score || is_recorded {
                open.push(StageNode { stage: stage_id, node: node_id });
            }
        }
    }
    while let Some(node) = open.pop() {
        if live.insert(node) {
            open.extend(linked.stages[node.stage].nodes[node.node].reads.iter().map(|(read, _)| *read));
        }
    }
    live
}

pub(crate) fn check(variants: &[Linked<'_>], live: &[HashSet<StageNode>], report: &mut Report) {
    let Some(first) = variants.first() else { return };
    for (stage_id, stage) in StageId::enumerate(&first.stages) {
        for (node_id, node) in StageNodeId::enumerate(&stage.nodes) {
            if live.iter().any(|live| live.contains(&StageNode { stage: stage_id, node: node_id })) {
                continue;
            }
            let (stage, name) = (&stage.name.text, &node.name.text);
            let what = format!("node `{name}` is unused: no node reads its outputs, and `record` does not name it");
            let help = format!("read one of its outputs, add `{stage}.{name}` to `record`, or remove the node");
            report.push(Diagnostic::error(&node.name.place, what).label("unused").help(help));
        }
    }
}

/// Warns of stages whose aggregate values nothing uses: no other stage reads them, and they are neither scored nor
/// named in `record`. If no later stage is scored, training is the purpose of the experiment.
pub(crate) fn check_stages(variants: &[Linked<'_>], recording: &Recorded, report: &mut Report) {
    let Some(first) = variants.first() else { return };
    let scores = |stage: StageId| variants.iter().any(|linked| !linked.stages[stage].estimates.is_empty());
    for (stage_id, stage) in StageId::enumerate(&first.stages) {
        let mut learns = stage.nodes.iter().filter_map(|node| {
            node.types.outputs().iter().find(|port| port.rate == Rate::Once).map(|port| (node, port))
        });
        let Some((node, port)) = learns.next_back() else { continue };
        let reads = |linked: &Linked<'_>| {
            let others = StageId::enumerate(&linked.stages).filter(|(other, _)| *other != stage_id);
            let mut reads = others.flat_map(|(_, other)| &other.nodes).flat_map(|node| &node.reads);
            reads.any(|(read, _)| read.stage == stage_id)
        };
        let later_scores = StageId::all(first.stages.len()).skip(stage_id.0 + 1).any(scores);
        if !later_scores || scores(stage_id) || recording.asks_for(&stage.name.text) || variants.iter().any(reads) {
            continue;
        }
        let name = &stage.name.text;
        let value = format!("{name}.{}/{}", node.name.text, port.name);
        let help = format!(
            "wire it into a later stage (`{value}`), ask for it (`record: [{value}, ...]`), or leave the stage out: `{name}: null` in an \
             experiment that extends this one, `--set {name}=null`"
        );
        let warning = Diagnostic::warning(&stage.name.place, format!("nothing uses what stage `{name}` learns"));
        report.push(warning.label("runs all the same").help(help));
    }
}
