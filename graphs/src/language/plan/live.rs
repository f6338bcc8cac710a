//! Which nodes of a variant are of any use: recorded, scored, or read by one that is; and stages that nothing comes of.

use std::collections::HashSet;

use super::linked::Linked;
use super::record::Recorded;
use crate::contracts::Rate;
use crate::language::text::diagnostics::{Diagnostic, Report};

/// The useful nodes of one variant, as (stage, node).
pub(crate) fn nodes(linked: &Linked<'_>, recording: &Recorded) -> HashSet<(usize, usize)> {
    let mut live = HashSet::new();
    let mut open = Vec::new();
    for (s, stage) in linked.stages.iter().enumerate() {
        for (n, node) in stage.nodes.iter().enumerate() {
            let kept = node.signature.as_ref().is_none_or(|signature| {
                // What gives nothing (a sink) is there for what it does.
                let outputs = &signature.outputs;
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

/// Warns of stages that learn what nobody uses: in no variant a later stage reads any of it, nothing of theirs is scored, and `record`
/// does not ask for it. Where no later stage scores anything, what is learned is what the experiment is for.
pub(crate) fn check_stages(variants: &[Linked<'_>], recording: &Recorded, report: &mut Report) {
    let Some(first) = variants.first() else { return };
    let scores = |s: usize| variants.iter().any(|linked| !linked.stages[s].estimates.is_empty());
    for (s, stage) in first.stages.iter().enumerate() {
        let mut learns = stage
            .nodes
            .iter()
            .filter_map(|node| node.outputs().iter().find(|port| port.rate == Rate::Once).map(|port| (node, port)));
        let Some((node, port)) = learns.next_back() else { continue };
        let reads = |linked: &Linked<'_>| {
            let others = linked.stages.iter().enumerate().filter(|(other, _)| *other != s);
            others.flat_map(|(_, other)| &other.nodes).flat_map(|node| &node.reads).any(|(of, ..)| *of == s)
        };
        let later_scores = (s + 1..first.stages.len()).any(scores);
        if !later_scores || scores(s) || recording.asks_for(&stage.name.text) || variants.iter().any(reads) {
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
