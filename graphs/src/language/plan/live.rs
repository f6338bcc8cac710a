//! Which nodes of a variant are of any use: recorded, scored, or read by one that is.

use std::collections::HashSet;

use super::linked::Linked;
use super::record::Recorded;
use crate::language::text::diagnostics::{Diagnostic, Report};

/// The useful nodes of one variant, as (stage, node).
pub(crate) fn nodes(linked: &Linked<'_>, recording: &Recorded) -> HashSet<(usize, usize)> {
    let mut live = HashSet::new();
    let mut open = Vec::new();
    for (s, stage) in linked.stages.iter().enumerate() {
        for (n, node) in stage.nodes.iter().enumerate() {
            let kept = node.kind.is_none_or(|kind| {
                // What gives nothing (a sink) is there for what it does.
                let outputs = &kind.declaration.outputs;
                outputs.is_empty() || outputs.iter().any(|o| recording.keeps(&stage.name.text, &node.name.text, o.name))
            });
            if node.is_score || kept {
                open.push((s, n));
            }
        }
    }
    while let Some((s, n)) = open.pop() {
        if live.insert((s, n)) {
            open.extend(linked.stages[s].nodes[n].reads.iter().map(|(stage, node, _)| (*stage, *node)));
        }
    }
    live
}

/// Reports nodes that are of no use in any variant.
pub(crate) fn check(variants: &[Linked<'_>], live: &[HashSet<(usize, usize)>], report: &mut Report) {
    let Some(first) = variants.first() else { return };
    for (s, stage) in first.stages.iter().enumerate() {
        for (n, node) in stage.nodes.iter().enumerate() {
            if live.iter().any(|live| live.contains(&(s, n))) {
                continue;
            }
            let (stage, name) = (&stage.name.text, &node.name.text);
            let what = format!("nothing reads or records node `{name}`");
            let help = format!("read one of its outputs, add `{stage}.{name}` to `record`, or remove the node");
            report.push(Diagnostic::error(&node.name.place, what).label("of no use").help(help));
        }
    }
}
