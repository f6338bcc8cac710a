//! Checks whether each node can use its inputs, as far as kinds know before any frame.

use super::share::SharedRun;
use crate::contracts::{InputOrigin, Slot, Upstream, UpstreamNode};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::plan::{Origin, PlannedNode, StageRun};
use crate::registry::Registry;

pub(crate) fn check(
    runs: &[StageRun],
    shared: &[SharedRun<'_>],
    variants: &[String],
    registry: &Registry,
    report: &mut Report,
) {
    for (run, shared) in runs.iter().zip(shared) {
        for (node, shared) in run.nodes.iter().zip(&shared.nodes) {
            let Some(kind) = registry.node_kind(&node.kind) else { continue };
            let wired = node.inputs.iter().filter_map(|input| Some((&input.port, input.from.as_ref()?)));
            let upstream = Upstream::new(wired.map(|(port, from)| (port, origin(runs, run, from))));
            if let Err(fault) = (kind.check_inputs)(&node.params, &upstream) {
                let variant = match node.variants.first() {
                    Some(&first) if node.variants.len() < variants.len() => {
                        format!(" (in variant `{}`)", variants[first])
                    }
                    _ => String::new(),
                };
                let what = format!("node `{}`: {}{variant}", node.name, fault.chain());
                let help = fault.remedy_text().map(ToOwned::to_owned);
                report.push(
                    Diagnostic::error(&shared.first.name.place, what).label("cannot use its inputs").maybe_help(help),
                );
            }
        }
    }
}

fn origin<'a>(runs: &'a [StageRun], here: &'a StageRun, from: &'a Origin) -> InputOrigin<'a> {
    match from {
        Origin::Here(Slot::Source { .. }) => InputOrigin::Source,
        Origin::Here(Slot::Node { node, .. }) => InputOrigin::Node(upstream_node(&here.nodes[*node])),
        Origin::Once { run, node, .. } => InputOrigin::Node(upstream_node(&runs[*run].nodes[*node])),
        Origin::File(path) => InputOrigin::File(path),
    }
}

fn upstream_node(node: &PlannedNode) -> UpstreamNode<'_> {
    let wired = node.inputs.iter().filter(|input| input.from.is_some()).map(|input| input.port.name).collect();
    UpstreamNode { name: &node.name, kind: &node.kind, params: &node.params, wired }
}
