//! The outline of a document: sources, stages with their nodes, estimates and variants.

use depthloom_graphs::language::{Entry, Place};
use gen_lsp_types::{DocumentSymbol, SymbolKind};

use crate::positions;
use crate::view::View;

/// The symbols of the document's own file.
pub(crate) fn symbols(view: &View<'_>) -> Vec<DocumentSymbol> {
    let Some(own) = view.document.own() else { return Vec::new() };
    own.entries().iter().filter_map(|entry| section(view.text, entry)).collect()
}

fn section(text: &str, entry: &Entry) -> Option<DocumentSymbol> {
    let children = match entry.key.as_str() {
        "sources" => named(text, entry, SymbolKind::Variable),
        "stages" => entry.value.entries().iter().map(|stage| of_stage(text, stage)).collect(),
        "nodes" => named(text, entry, SymbolKind::Function),
        "variants" | "matrix" => named(text, entry, SymbolKind::EnumMember),
        "experiment" => return Some(symbol(text, entry, SymbolKind::Module, Vec::new())),
        _ => return None,
    };
    Some(symbol(text, entry, SymbolKind::Namespace, children))
}

fn of_stage(text: &str, stage: &Entry) -> DocumentSymbol {
    let mut children =
        stage.value.entry("nodes").map(|nodes| named(text, nodes, SymbolKind::Function)).unwrap_or_default();
    let estimates = stage.value.get("score").and_then(|score| score.entry("estimates"));
    children.extend(estimates.into_iter().flat_map(|estimates| named(text, estimates, SymbolKind::Number)));
    symbol(text, stage, SymbolKind::Class, children)
}

fn named(text: &str, entry: &Entry, kind: SymbolKind) -> Vec<DocumentSymbol> {
    entry.value.entries().iter().map(|entry| symbol(text, entry, kind, Vec::new())).collect()
}

fn symbol(text: &str, entry: &Entry, kind: SymbolKind, children: Vec<DocumentSymbol>) -> DocumentSymbol {
    let key = &entry.key_place;
    let end = if entry.value.place.is_in(&key.file) { entry.value.place.span.end } else { key.span.end };
    let whole = Place::new(&key.file, &(key.span.start..end.max(key.span.end)));
    let detail = entry.value.get("kind").and_then(|kind| kind.scalar_text()).or_else(|| entry.value.scalar_text());
    #[expect(deprecated, reason = "the struct has the field")]
    DocumentSymbol {
        name: entry.key.clone(),
        detail,
        kind,
        tags: None,
        deprecated: None,
        range: positions::range(text, &whole.span),
        selection_range: positions::range(text, &key.span),
        children: Some(children).filter(|children| !children.is_empty()),
    }
}
