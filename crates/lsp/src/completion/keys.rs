//! Keys of the language, from the schema of experiment files; and kinds.

use depthloom_graphs::contracts::Contract;
use gen_lsp_types::CompletionItemKind;
use serde_json::Value as Json;

use super::Candidate;
use crate::view::View;

/// The keys of an experiment or graph file.
pub(super) fn experiment(view: &View<'_>) -> Vec<Candidate> {
    if view.is_graph_file() {
        return ["description", "nodes"].map(|key| Candidate::new(key, CompletionItemKind::Keyword)).into();
    }
    at(view, "/properties")
}

/// The keys of a definition of the schema: `source`, `stage` or `node`.
pub(super) fn of_definition(view: &View<'_>, name: &str) -> Vec<Candidate> {
    at(view, &format!("/$defs/{name}/properties"))
}

/// The keys of a score, or of one of its estimates.
pub(super) fn of_score(view: &View<'_>, is_estimate: bool) -> Vec<Candidate> {
    let score = "/$defs/stage/properties/score/properties";
    match is_estimate {
        true => at(view, &format!("{score}/estimates/additionalProperties/anyOf/1/properties")),
        false => at(view, score),
    }
}

/// The keys that the schema lists at a pointer.
pub(super) fn at(view: &View<'_>, pointer: &str) -> Vec<Candidate> {
    let properties = view.schema.pointer(pointer).and_then(Json::as_object);
    let candidate = |(name, schema): (&String, &Json)| {
        let description = schema.get("description").and_then(Json::as_str).unwrap_or_default();
        Candidate::new(name, CompletionItemKind::Keyword).documentation(description)
    };
    properties.into_iter().flatten().map(candidate).collect()
}

pub(super) fn node_kinds(view: &View<'_>) -> Vec<Candidate> {
    let declarations = view.registry.nodes().map(|kind| &kind.declaration);
    declarations.map(|kind| kind_of(kind.kind, kind.contract.name(), kind.summary)).collect()
}

pub(super) fn source_kinds(view: &View<'_>) -> Vec<Candidate> {
    let declarations = view.registry.sources().map(|kind| &kind.declaration);
    declarations.map(|kind| kind_of(kind.kind, "source", kind.summary)).collect()
}

fn kind_of(kind: &str, contract: &str, summary: &str) -> Candidate {
    let detail = if contract == Contract::Once.name() { "aggregate node".to_owned() } else { contract.to_owned() };
    Candidate::new(kind, CompletionItemKind::Class).detail(detail).documentation(summary)
}
