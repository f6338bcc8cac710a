//! What can be written at the cursor.

mod changes;
mod keys;
mod references;

use std::path::Path;

use depthloom_graphs::language::{Tree, item, property};
use depthloom_graphs::render::{enumeration, parameter_details};
use gen_lsp_types::{
    CompletionItem, CompletionItemKind, CompletionItemTextEdit, CompletionList, Documentation, MarkupContent,
    MarkupKind, TextEdit,
};
use serde_json::Value as Json;

use crate::cursor::{Cursor, ITEM};
use crate::positions;
use crate::symbols::SCORE_REFERENCES;
use crate::view::{View, names};

/// More are not sent at once.
const MOST: usize = 2000;

/// A word that can be written at the cursor.
#[derive(Clone, Debug, Default)]
pub(crate) struct Candidate {
    pub(crate) word: String,
    pub(crate) detail: String,
    pub(crate) documentation: String,
    pub(crate) kind: Option<CompletionItemKind>,
    /// Candidates of a lower rank come first.
    pub(crate) rank: u8,
}

impl Candidate {
    pub(crate) fn new(word: impl Into<String>, kind: CompletionItemKind) -> Self {
        Self { word: word.into(), kind: Some(kind), ..Self::default() }
    }

    pub(crate) fn detail(self, detail: impl Into<String>) -> Self {
        Self { detail: detail.into(), ..self }
    }

    pub(crate) fn documentation(self, documentation: impl Into<String>) -> Self {
        Self { documentation: documentation.into(), ..self }
    }

    pub(crate) fn rank(self, rank: u8) -> Self {
        Self { rank, ..self }
    }
}

/// The words that can be written at the cursor, in the order in which they are shown.
pub(crate) fn complete(view: &View<'_>, cursor: &Cursor) -> CompletionList {
    let mut found = candidates(view, cursor);
    found.sort_by_key(|candidate| candidate.rank);
    let is_incomplete = found.len() > MOST;
    found.truncate(MOST);
    let range = positions::range(view.text, &cursor.word);
    // A key that is already followed by its colon.
    let has_colon = view.text[cursor.word.end..].starts_with(':');
    let quoted = view.text[..cursor.word.start].ends_with(['"', '\'']);
    let item = |(index, candidate): (usize, Candidate)| {
        let ending = if cursor.is_key && !has_colon && !quoted { ": " } else { "" };
        let markdown = MarkupContent { kind: MarkupKind::Markdown, value: candidate.documentation };
        CompletionItem {
            kind: candidate.kind,
            detail: Some(candidate.detail).filter(|detail| !detail.is_empty()),
            documentation: Some(markdown).filter(|text| !text.value.is_empty()).map(Documentation::MarkupContent),
            sort_text: Some(format!("{index:05}")),
            filter_text: Some(candidate.word.clone()),
            text_edit: Some(CompletionItemTextEdit::TextEdit(TextEdit {
                range,
                new_text: format!("{}{ending}", candidate.word),
            })),
            label: candidate.word,
            ..CompletionItem::default()
        }
    };
    CompletionList {
        is_incomplete,
        items: found.into_iter().enumerate().map(item).collect(),
        ..CompletionList::default()
    }
}

fn candidates(view: &View<'_>, cursor: &Cursor) -> Vec<Candidate> {
    let keys = view.keys(cursor);
    match (keys.as_slice(), cursor.is_key) {
        ([], true) => keys::experiment(view),
        (["extends"], false) => files(view),
        (["only"] | ["only", ITEM], _) => variants(view),
        (["record", ..], _) => record(view, &keys, cursor.is_key),
        (["sources", rest @ ..], is_key) => source(view, rest, is_key),
        (["stages", stage, rest @ ..], is_key) => in_stage(view, stage, rest, is_key),
        (["variants", _], true) => changes::paths(view),
        (["variants", _, path, rest @ ..], is_key) => changes::value(view, path, rest, is_key),
        (["matrix", ITEM, rest @ ..], is_key) => changes::matrix(view, rest, is_key),
        (["matrix", rest @ ..], is_key) => changes::matrix(view, rest, is_key),
        _ => Vec::new(),
    }
}

fn source(view: &View<'_>, keys: &[&str], is_key: bool) -> Vec<Candidate> {
    match (keys, is_key) {
        ([_], true) => keys::of_definition(view, "source"),
        ([_, "concat", ITEM], true) => {
            keys::of_definition(view, "node").into_iter().filter(|key| key.word != "inputs").collect()
        }
        ([_, "kind"] | [_, "concat", ITEM, "kind"], false) => keys::source_kinds(view),
        ([name, "with", path @ ..], is_key) => {
            let schema = view.source(name).and_then(|source| view.parameters_of(source));
            schema.map(|schema| parameters(schema, path, is_key)).unwrap_or_default()
        }
        ([name, "concat", ITEM, "with", path @ ..], is_key) => {
            // Parts of one source have the same kind, as a rule.
            let concat = view.source(name).and_then(|source| source.get("concat"));
            let part = concat.and_then(|concat| match &concat.value {
                Tree::List(parts) => parts.iter().find(|part| part.get("kind").is_some()),
                _ => None,
            });
            let schema = part.and_then(|part| view.parameters_of(part));
            schema.map(|schema| parameters(schema, path, is_key)).unwrap_or_default()
        }
        _ => Vec::new(),
    }
}

/// Below `stages.STAGE`; also of a value that a variant sets there.
pub(crate) fn in_stage(view: &View<'_>, stage: &str, keys: &[&str], is_key: bool) -> Vec<Candidate> {
    match (keys, is_key) {
        ([], true) if !stage.is_empty() => keys::of_definition(view, "stage"),
        (["source"], false) => sources(view),
        (["nodes"], true) => {
            vec![Candidate::new("graph", CompletionItemKind::Keyword).detail("file with nodes, relative to this file")]
        }
        (["nodes", "graph"], false) => files(view),
        (["nodes", _], true) => keys::of_definition(view, "node"),
        (["nodes", _, "kind"], false) => keys::node_kinds(view),
        (["nodes", node, "inputs"], true) => references::inputs(view, stage, node),
        (["nodes", node, "inputs", port], false) => references::to_input(view, stage, node, port),
        (["nodes", node, "with", path @ ..], is_key) => {
            let schema = view.node(stage, node).and_then(|node| view.parameters_of(node));
            schema.map(|schema| parameters(schema, path, is_key)).unwrap_or_default()
        }
        (["score"], true) => keys::of_score(view, false),
        (["score", "estimates", _], true) => keys::of_score(view, true),
        (["score", "estimates", _], false) => references::to_score(view, stage),
        (["score", "estimates", _, key] | ["score", key], false) if SCORE_REFERENCES.contains(key) => {
            references::to_score(view, stage)
        }
        (["score", "estimates", _, path @ ..] | ["score", path @ ..], is_key) => score_parameters(view, path, is_key),
        _ => Vec::new(),
    }
}

/// Below a parameter of a score, of either of its kinds.
fn score_parameters(view: &View<'_>, path: &[&str], is_key: bool) -> Vec<Candidate> {
    let mut found: Vec<Candidate> = Vec::new();
    for kind in ["score/depth", "score/disparity"] {
        let more = view.registry.node_kind(kind).map(|kind| parameters(&kind.schema, path, is_key)).unwrap_or_default();
        found.extend(
            more.into_iter().filter(|new| !found.iter().any(|known| known.word == new.word)).collect::<Vec<_>>(),
        );
    }
    found
}

/// The schema of a value within the parameters of a kind.
pub(crate) fn schema_at<'s>(schema: &'s Json, path: &[&str]) -> Option<&'s Json> {
    path.iter().try_fold(schema, |schema, key| match *key {
        ITEM => item(schema),
        key => property(schema, key),
    })
}

/// The keys or values at a path within the parameters of a kind.
pub(crate) fn parameters(schema: &Json, path: &[&str], is_key: bool) -> Vec<Candidate> {
    let Some(schema) = schema_at(schema, path) else { return Vec::new() };
    if is_key { parameter_names(schema) } else { values(schema) }
}

fn parameter_names(schema: &Json) -> Vec<Candidate> {
    let own = schema.get("properties").and_then(Json::as_object);
    let others = ["anyOf", "oneOf", "allOf"].into_iter().filter_map(|key| schema.get(key)?.as_array()).flatten();
    let candidate = |(name, schema): (&String, &Json)| {
        let details = parameter_details(schema);
        let (facts, meaning) = details.split_once("\n\n").unwrap_or((&details, ""));
        Candidate::new(name, CompletionItemKind::Property).detail(facts.replace('`', "")).documentation(meaning)
    };
    own.into_iter().flatten().map(candidate).chain(others.flat_map(parameter_names)).collect()
}

/// The values that a parameter can have, as far as they can be listed.
pub(crate) fn values(schema: &Json) -> Vec<Candidate> {
    let mut found: Vec<Candidate> = Vec::new();
    let default = schema.get("default");
    let mut push = |word: String, documentation: &str, kind: CompletionItemKind| {
        if !found.iter().any(|known| known.word == word) {
            let is_default = default.is_some_and(|default| plain(default) == word);
            let detail = if is_default { "default" } else { "" };
            found.push(Candidate::new(word, kind).detail(detail).documentation(documentation));
        }
    };
    for (value, documentation) in enumerations(schema) {
        push(value, documentation.unwrap_or_default(), CompletionItemKind::EnumMember);
    }
    if has(schema, "type", "boolean") {
        push("true".to_owned(), "", CompletionItemKind::Value);
        push("false".to_owned(), "", CompletionItemKind::Value);
    }
    if let Some(default) = default.filter(|default| !default.is_null() && !plain(default).is_empty()) {
        push(plain(default), "", CompletionItemKind::Value);
    }
    if has(schema, "format", "frames") {
        for (frames, documentation) in FRAMES {
            push(frames.to_owned(), documentation, CompletionItemKind::Value);
        }
    }
    found
}

/// Common selections of frames.
const FRAMES: [(&str, &str); 5] = [
    ("0..8", "The first eight frames: the end is not included."),
    ("0..48", "The first 48 frames."),
    ("1..=40", "The frames 1 to 40: the end is included."),
    ("[0, 5, 9]", "These frames."),
    ("./frames.txt", "The frames whose ids this file lists, one per line."),
];

/// The values of an enumeration, also of one of several alternatives.
fn enumerations(schema: &Json) -> Vec<(String, Option<&str>)> {
    let own = enumeration(schema);
    if !own.is_empty() {
        return own;
    }
    let alternatives = ["anyOf", "oneOf"].into_iter().filter_map(|key| schema.get(key)?.as_array()).flatten();
    alternatives.flat_map(enumerations).collect()
}

fn has(schema: &Json, key: &str, value: &str) -> bool {
    let own = match schema.get(key) {
        Some(Json::Array(values)) => values.iter().any(|own| own == value),
        Some(own) => own == value,
        None => false,
    };
    let alternatives = || ["anyOf", "oneOf"].into_iter().filter_map(|key| schema.get(key)?.as_array()).flatten();
    own || alternatives().any(|schema| has(schema, key, value))
}

fn plain(value: &Json) -> String {
    value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned)
}

fn sources(view: &View<'_>) -> Vec<Candidate> {
    let sources = view.root().and_then(|root| root.get("sources"));
    let kind = |name: &str| view.source(name).and_then(|source| source.get("kind")?.scalar_text()).unwrap_or_default();
    names(sources)
        .into_iter()
        .map(|name| Candidate::new(name, CompletionItemKind::Variable).detail(kind(name)))
        .collect()
}

fn variants(view: &View<'_>) -> Vec<Candidate> {
    let planned = view.loaded.iter().flat_map(|loaded| loaded.plan.variants.iter().map(String::as_str));
    let mut found = names(view.root().and_then(|root| root.get("variants")));
    found.extend(planned.filter(|name| !name.is_empty()));
    let mut seen = std::collections::HashSet::new();
    found.retain(|name| seen.insert(*name));
    found.into_iter().map(|name| Candidate::new(name, CompletionItemKind::Variable)).collect()
}

fn record(view: &View<'_>, keys: &[&str], is_key: bool) -> Vec<Candidate> {
    match keys {
        ["record"] if is_key => keys::at(view, "/properties/record/anyOf/1/properties"),
        ["record", ITEM] | ["record", "topics" | "points", ITEM] => references::all_outputs(view),
        ["record", "view"] => ["true", "false"].map(|word| Candidate::new(word, CompletionItemKind::Value)).into(),
        _ => Vec::new(),
    }
}

/// YAML files beside the document.
fn files(view: &View<'_>) -> Vec<Candidate> {
    let folder = view.path.parent().unwrap_or(Path::new(""));
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let names = entries.take(MOST).filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let own = view.path.file_name().map(|name| name.to_string_lossy().into_owned());
    let is_yaml = |name: &String| name.ends_with(".yaml") || name.ends_with(".yml");
    let mut names: Vec<String> = names.filter(is_yaml).filter(|name| Some(name) != own.as_ref()).collect();
    names.sort();
    names.into_iter().map(|name| Candidate::new(name, CompletionItemKind::File)).collect()
}
