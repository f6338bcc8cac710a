//! Paths of variants and axes, and the values that they set.

use depthloom_graphs::language::{Node, Tree};
use gen_lsp_types::CompletionItemKind;

use super::{Candidate, in_stage, keys, parameters, references, sources, values};
use crate::cursor::ITEM;
use crate::view::{View, names};

/// Every path that a variant can change.
pub(super) fn paths(view: &View<'_>) -> Vec<Candidate> {
    let mut found = Vec::new();
    let stages = names(view.root().and_then(|root| root.get("stages")));
    for &stage in &stages {
        for node_name in references::nodes(view, stage) {
            let Some(node) = view.node(stage, node_name) else { continue };
            let prefix = format!("{stage}.{node_name}");
            below_with(view, node, &prefix, 0, &mut found);
            found.push(Candidate::new(format!("{prefix}.kind"), CompletionItemKind::Property).rank(1));
            for input in view.ports(stage, node_name).0 {
                let path = format!("{prefix}.inputs.{}", input.name);
                found.push(Candidate::new(path, CompletionItemKind::Property).detail(input.value_type.name()).rank(1));
            }
        }
        found.push(Candidate::new(format!("{stage}.source"), CompletionItemKind::Property).rank(2));
        if view.stage(stage).is_some_and(|stage| stage.get("score").is_some()) {
            let keys = keys::of_score(view, false);
            found.extend(keys.into_iter().map(|key| Candidate {
                word: format!("{stage}.score.{}", key.word),
                rank: 2,
                ..key
            }));
        }
    }
    for source_name in names(view.root().and_then(|root| root.get("sources"))) {
        let Some(source) = view.source(source_name) else { continue };
        let prefix = format!("sources.{source_name}");
        below_with(view, source, &prefix, 3, &mut found);
        found.push(Candidate::new(format!("{prefix}.kind"), CompletionItemKind::Property).rank(3));
    }
    found
}

fn below_with(view: &View<'_>, node: &Node, prefix: &str, rank: u8, found: &mut Vec<Candidate>) {
    let Some(schema) = view.parameters_of(node) else { return };
    let mut push = |candidate: Candidate, within: &str| {
        let word = format!("{prefix}.with.{within}{}", candidate.word);
        found.push(Candidate { word, rank, ..candidate });
    };
    for candidate in parameters(schema, &[], true) {
        let name = candidate.word.clone();
        let inner = schema["properties"][&name].get("properties").map(|_| parameters(schema, &[&name], true));
        push(candidate, "");
        inner.into_iter().flatten().for_each(|candidate| push(candidate, &format!("{name}.")));
    }
}

/// What can be written as the value of a path.
pub(super) fn value(view: &View<'_>, path: &str, below: &[&str], is_key: bool) -> Vec<Candidate> {
    let Some(keys) = view.document.keys_of_change(path) else { return Vec::new() };
    let keys: Vec<&str> = keys.iter().map(String::as_str).chain(below.iter().copied()).collect();
    match keys.as_slice() {
        ["stages", stage, rest @ ..] => in_stage(view, stage, rest, is_key),
        ["sources", rest @ ..] => super::source(view, rest, is_key),
        _ => Vec::new(),
    }
}

/// Below `matrix`, or below one of several matrices.
pub(super) fn matrix(view: &View<'_>, keys: &[&str], is_key: bool) -> Vec<Candidate> {
    match (keys, is_key) {
        ([], true) => {
            let own = [
                ("include", "Further combinations."),
                ("exclude", "Combinations left out."),
                ("sample", "Some of all combinations."),
            ];
            let own =
                own.map(|(key, text)| Candidate::new(key, CompletionItemKind::Keyword).documentation(text).rank(4));
            paths(view).into_iter().chain(own).collect()
        }
        (["sample"], true) => keys::at(view, "/$defs/matrix/properties/sample/properties"),
        (["sample", key], false) => {
            let schema = view.schema.pointer(&format!("/$defs/matrix/properties/sample/properties/{key}"));
            schema.map(values).unwrap_or_default()
        }
        (["include" | "exclude", ITEM] | [_, "when"], true) => axes(view).into_iter().chain(paths(view)).collect(),
        (["include" | "exclude", ITEM, axis] | [_, "when", axis], false)
        | (["include" | "exclude", ITEM, axis, ITEM] | [_, "when", axis, ITEM], _) => axis_values(view, axis),
        (["include" | "exclude" | "sample", ..], _) => Vec::new(),
        ([_], true) => keys::at(view, "/$defs/matrix/additionalProperties/anyOf/1/properties"),
        ([_, "paths"], false) | ([_, "paths", ITEM], _) => paths(view),
        ([axis] | [axis, ITEM | "values"] | [axis, "values", ITEM], _) => axis_values(view, axis),
        ([_, "values", _], true) => paths(view),
        ([axis, "values", _], false) => axis_values(view, axis),
        ([_, "values", _, path, rest @ ..], is_key) => value(view, path, rest, is_key),
        ([_, "log"], false) => ["true", "false"].map(|word| Candidate::new(word, CompletionItemKind::Value)).into(),
        _ => Vec::new(),
    }
}

/// The matrices of the experiment.
fn matrices<'v>(view: &'v View<'_>) -> Vec<&'v Node> {
    match view.root().and_then(|root| root.get("matrix")).map(|matrix| (&**matrix, &matrix.value)) {
        Some((_, Tree::List(matrices))) => matrices.iter().map(|matrix| &**matrix).collect(),
        Some((matrix, _)) => vec![matrix],
        None => Vec::new(),
    }
}

fn axes(view: &View<'_>) -> Vec<Candidate> {
    let entries = matrices(view).into_iter().flat_map(Node::entries);
    let axes = entries.filter(|entry| !matches!(entry.key.as_str(), "include" | "exclude" | "sample"));
    axes.map(|axis| Candidate::new(&axis.key, CompletionItemKind::Variable)).collect()
}

/// The values of an axis: those of its path, or of the first of its paths.
fn axis_values(view: &View<'_>, axis: &str) -> Vec<Candidate> {
    let named = matrices(view).into_iter().find_map(|matrix| matrix.get(axis)?.get("paths").cloned());
    let path = named.and_then(|paths| match &paths.value {
        Tree::List(paths) => paths.first()?.scalar_text(),
        _ => paths.scalar_text(),
    });
    let path = path.unwrap_or_else(|| axis.to_owned());
    if view.document.keys_of_change(&path).is_some_and(|keys| keys.last().is_some_and(|key| key == "source")) {
        return sources(view);
    }
    match view.document.schema_of_change(&path, view.registry) {
        Some(schema) => values(schema),
        None => value(view, &path, &[], false),
    }
}
