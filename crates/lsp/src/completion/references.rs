//! References to outputs, and the ports that take them.

use depthloom_graphs::render::port_details;
use depthloom_graphs::{Port, Rate, ValueType};
use gen_lsp_types::CompletionItemKind;

use super::Candidate;
use crate::view::{View, names};

/// The input ports of a node, those that have no value yet first.
pub(super) fn inputs(view: &View<'_>, stage: &str, node: &str) -> Vec<Candidate> {
    let wired = names(view.node(stage, node).and_then(|node| node.get("inputs")));
    let candidate = |port: &Port| {
        let details = port_details(port);
        let (facts, meaning) = details.split_once("\n\n").unwrap_or((&details, ""));
        let rank = if wired.contains(&port.name) { 2 } else { u8::from(port.optional) };
        Candidate::new(port.name, CompletionItemKind::Field).detail(facts).documentation(meaning).rank(rank)
    };
    view.ports(stage, node).0.iter().map(candidate).collect()
}

/// The outputs that an input can read, those of its type first.
pub(super) fn to_input(view: &View<'_>, stage: &str, node: &str, port: &str) -> Vec<Candidate> {
    let inputs = view.ports(stage, node).0;
    let input = inputs.iter().find(|input| input.name == port);
    outputs(view, stage, Some(node), input.map(|input| input.value_type))
}

/// The outputs that can be scored, depths first.
pub(super) fn to_score(view: &View<'_>, stage: &str) -> Vec<Candidate> {
    outputs(view, stage, None, Some(ValueType::Depth))
}

fn outputs(view: &View<'_>, stage: &str, reader: Option<&str>, wanted: Option<ValueType>) -> Vec<Candidate> {
    let mut found = Vec::new();
    let mut push = |prefix: &str, port: &Port, far: u8| {
        let rank = far + if wanted.is_none_or(|wanted| wanted == port.value_type) { 0 } else { 2 };
        found.push(candidate(format!("{prefix}/{}", port.name), port).rank(rank));
    };
    view.source_ports(stage).iter().for_each(|port| push("source", port, 0));
    for node in nodes(view, stage).into_iter().filter(|node| Some(*node) != reader) {
        view.ports(stage, node).1.iter().for_each(|port| push(node, port, 0));
    }
    // Of earlier stages, the values that are there once.
    let stages = names(view.root().and_then(|root| root.get("stages")));
    for other in stages.into_iter().take_while(|other| *other != stage) {
        for node in nodes(view, other) {
            let outputs = view.ports(other, node).1;
            let once = outputs.iter().filter(|port| port.rate == Rate::Once);
            once.for_each(|port| push(&format!("{other}.{node}"), port, 1));
        }
    }
    found
}

/// `stage.node/port` of all outputs.
pub(super) fn all_outputs(view: &View<'_>) -> Vec<Candidate> {
    let mut found = Vec::new();
    for stage in names(view.root().and_then(|root| root.get("stages"))) {
        found.extend(
            view.source_ports(stage).iter().map(|port| candidate(format!("{stage}.source/{}", port.name), port)),
        );
        for node in nodes(view, stage) {
            let outputs = view.ports(stage, node).1;
            found.extend(outputs.iter().map(|port| candidate(format!("{stage}.{node}/{}", port.name), port)));
        }
    }
    found
}

pub(super) fn nodes<'v>(view: &'v View<'_>, stage: &str) -> Vec<&'v str> {
    let mut nodes = names(view.stage(stage).and_then(|stage| stage.get("nodes")));
    nodes.retain(|node| *node != "graph");
    nodes
}

fn candidate(word: String, port: &Port) -> Candidate {
    let details = port_details(port);
    let (facts, meaning) = details.split_once("\n\n").unwrap_or((&details, ""));
    Candidate::new(word, CompletionItemKind::Reference).detail(facts).documentation(meaning)
}
