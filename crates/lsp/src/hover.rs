//! What the word under the pointer means: the documentation of kinds, parameters and ports, and resolved values.

use std::sync::Arc;

use depthloom_graphs::language::{Entry, Node};
use depthloom_graphs::plan::Plan;
use depthloom_graphs::render::{enumeration, kind_reference, parameter_details, port_details};
use serde_json::Value as Json;

use crate::completion::schema_at;
use crate::cursor::{Cursor, ITEM};
use crate::symbols::{self, SCORE_REFERENCES, Symbol};
use crate::view::{View, names};

/// Values longer than this are abbreviated.
const LONGEST: usize = 200;

/// More variants are counted.
const MOST_VARIANTS: usize = 12;

/// The documentation of what is at a cursor, in Markdown, and the node whose reuse belongs to it.
pub(crate) fn text(view: &View<'_>, cursor: &Cursor, offset: usize) -> Option<(String, Option<Symbol>)> {
    let symbol = symbols::at(view, offset).map(|occurrence| occurrence.symbol);
    if let Some(symbol) = symbol {
        let text = of_symbol(view, &symbol)?;
        let node = matches!(symbol, Symbol::Node { .. }).then_some(symbol);
        return Some((text, node));
    }
    let word = view.text.get(cursor.word.clone())?;
    let mut keys = view.keys(cursor);
    if cursor.is_key {
        keys.push(word);
    }
    of_keys(view, &keys, word, cursor.is_key).map(|text| (text, None))
}

fn of_symbol(view: &View<'_>, symbol: &Symbol) -> Option<String> {
    let keys = symbol.keys();
    let entry = keys.iter().try_fold(view.root()?, |node, key| node.get(key))?;
    let file =
        view.definition(&keys).filter(|place| Some(&place.file) != view.document.files.first().map(|(file, _)| file));
    let from = file.map(|place| format!("\n\nDefined in {place}.")).unwrap_or_default();
    let name = symbol.name();
    let text = match symbol {
        Symbol::Node { stage, node } => {
            let mut text = format!("**{name}**: node of the kind {}", kind_line(view, entry));
            let (_, outputs) = view.ports(stage, node);
            for port in &outputs {
                text.push_str(&format!("\n- `{name}/{}`: {}", port.name, port_details(port).replace("\n\n", ". ")));
            }
            text
        }
        Symbol::Source(_) => format!("**{name}**: source of the kind {}", kind_line(view, entry)),
        Symbol::Stage(_) => {
            let source = entry.get("source").and_then(|source| source.scalar_text()).unwrap_or_default();
            format!("**{name}**: stage on the source `{source}`; nodes: {}", listed(&names(entry.get("nodes"))))
        }
        Symbol::Variant(_) => {
            let change = |entry: &Entry| format!("\n- `{}: {}`", entry.key, short(&entry.value.to_json()));
            let changes: String = entry.entries().iter().map(change).collect();
            match changes.is_empty() {
                true => format!("**{name}**: variant without a change"),
                false => format!("**{name}**: variant that changes\n{changes}"),
            }
        }
        Symbol::Estimate { .. } => {
            let from = entry.text().map(ToOwned::to_owned).or_else(|| entry.get("from")?.scalar_text());
            format!("**{name}**: estimate, scored from `{}`", from.unwrap_or_default())
        }
    };
    Some(text + &from)
}

/// A kind and its summary.
fn kind_line(view: &View<'_>, node: &Node) -> String {
    let Some(kind) = node.get("kind").and_then(|kind| kind.scalar_text()) else {
        return "that `concat` joins".to_owned();
    };
    let summary = view.registry.node_kind(&kind).map(|kind| kind.declaration.summary);
    let summary = summary.or_else(|| view.registry.source_kind(&kind).map(|kind| kind.declaration.summary));
    format!("`{kind}`\n\n{}", summary.unwrap_or("There is no such kind."))
}

fn listed(names: &[&str]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

fn of_keys(view: &View<'_>, keys: &[&str], word: &str, is_key: bool) -> Option<String> {
    match keys {
        [.., "kind"] if !is_key => kind_reference(view.registry, word),
        ["variants", _, path] | ["matrix", path] | ["matrix", ITEM, path] if is_key => of_path(view, path),
        ["matrix", _, "paths"] | ["matrix", _, "paths", ITEM] => of_path(view, word),
        ["variants", _, path, below @ ..] => {
            let keys = view.document.keys_of_change(path)?;
            let keys: Vec<&str> = keys.iter().map(String::as_str).chain(below.iter().copied()).collect();
            in_place(view, &keys, word, is_key)
        }
        _ => in_place(view, keys, word, is_key),
    }
}

/// What the last part of a path is.
fn of_path(view: &View<'_>, path: &str) -> Option<String> {
    let keys = view.document.keys_of_change(path)?;
    let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
    in_place(view, &keys, keys.last()?, true)
}

fn in_place(view: &View<'_>, keys: &[&str], word: &str, is_key: bool) -> Option<String> {
    match keys {
        ["stages", stage, "nodes", node, "inputs", port] if is_key => input(view, stage, node, port),
        ["stages", stage, "nodes", _, "inputs", _] => output(view, stage, word),
        ["stages", stage, "score", key] | ["stages", stage, "score", "estimates", _, key]
            if SCORE_REFERENCES.contains(key) && !is_key =>
        {
            output(view, stage, word)
        }
        ["stages", stage, "score", "estimates", _] if !is_key => output(view, stage, word),
        ["stages", stage, "nodes", node, "with", path @ ..] if !path.is_empty() => {
            let schema = view.parameters_of(view.node(stage, node)?)?;
            let mut text = parameter(schema, path, word, is_key)?;
            let own = view.node(stage, node)?.get("with");
            let default = || schema_at(schema, path)?.get("default").cloned();
            text.push_str(&resolved(
                path,
                own,
                default,
                view.loaded.as_ref().map(|loaded| planned_nodes(&loaded.plan, stage, node)),
            ));
            Some(text)
        }
        ["sources", name, "with", path @ ..] if !path.is_empty() => {
            let source = view.source(name)?;
            let schema = view.parameters_of(source)?;
            let mut text = parameter(schema, path, word, is_key)?;
            let default = || schema_at(schema, path)?.get("default").cloned();
            text.push_str(&resolved(path, source.get("with"), default, None));
            Some(text)
        }
        ["stages", _, "score", "estimates", _, path @ ..] | ["stages", _, "score", path @ ..] if !path.is_empty() => {
            let kinds = ["score/depth", "score/disparity"].into_iter().filter_map(|kind| view.registry.node_kind(kind));
            let mut schemas = kinds.map(|kind| &kind.schema);
            schemas.find_map(|schema| parameter(schema, path, word, is_key)).or_else(|| key(view, keys, is_key))
        }
        _ => key(view, keys, is_key),
    }
}

/// The documentation of a key of the language.
fn key(view: &View<'_>, keys: &[&str], is_key: bool) -> Option<String> {
    let pointer = match keys {
        _ if !is_key => return None,
        [key] => format!("/properties/{key}"),
        ["stages", _, key] => format!("/$defs/stage/properties/{key}"),
        ["stages", _, "score", key] => format!("/$defs/stage/properties/score/properties/{key}"),
        ["stages", _, "nodes", _, key] => format!("/$defs/node/properties/{key}"),
        ["sources", _, key] => format!("/$defs/source/properties/{key}"),
        ["record", key] => format!("/properties/record/anyOf/1/properties/{key}"),
        _ => return None,
    };
    let description = view.schema.pointer(&pointer)?.get("description")?.as_str()?;
    Some(format!("**{}**: {description}", keys.last()?))
}

fn input(view: &View<'_>, stage: &str, node: &str, port: &str) -> Option<String> {
    let inputs = view.ports(stage, node).0;
    let port = inputs.iter().find(|input| input.name == port)?;
    Some(format!("**{}**: input of `{node}`, {}", port.name, port_details(port)))
}

/// The port that a reference names.
fn output(view: &View<'_>, stage: &str, word: &str) -> Option<String> {
    let (place, port) = word.split_once('/')?;
    let (stage, node) = place.split_once('.').unwrap_or((stage, place));
    let outputs = if node == "source" { view.source_ports(stage) } else { view.ports(stage, node).1 };
    let port = outputs.iter().find(|output| output.name == port)?;
    Some(format!("**{word}**: output, {}", port_details(port)))
}

fn parameter(schema: &Json, path: &[&str], word: &str, is_key: bool) -> Option<String> {
    let schema = schema_at(schema, path)?;
    let name = path.iter().rfind(|key| **key != ITEM)?;
    let value = enumeration(schema).into_iter().find(|(value, _)| !is_key && value == word);
    match value {
        Some((value, Some(documentation))) => Some(format!("**{name}: {value}**: {documentation}")),
        _ => Some(format!("**{name}**: {}", parameter_details(schema))),
    }
}

/// The parameters of a node in a plan, each with the variants that have them; without names if all have.
fn planned_nodes<'p>(plan: &'p Plan, stage: &str, node: &str) -> Vec<(&'p Json, Vec<&'p str>)> {
    let runs = plan.runs.iter().filter(|run| run.stage == stage);
    let nodes = runs.flat_map(|run| run.nodes.iter().filter(|planned| planned.name == node));
    nodes.map(|planned| (&planned.shown, planned.variant_names(plan))).collect()
}

/// The value after `extends`, variants and defaults.
fn resolved(
    path: &[&str],
    own: Option<&Arc<Node>>,
    default: impl FnOnce() -> Option<Json>,
    planned: Option<Vec<(&Json, Vec<&str>)>>,
) -> String {
    let at = |value: &Json| {
        let steps = path.iter().filter(|key| **key != ITEM);
        steps.into_iter().try_fold(value, |value, key| value.get(key)).cloned()
    };
    let written = own.and_then(|own| at(&own.to_json()));
    let origin = if written.is_some() { "" } else { " (default)" };
    let mut values: Vec<(Json, Vec<String>)> = Vec::new();
    for (parameters, variants) in planned.into_iter().flatten() {
        let Some(value) = at(parameters) else { continue };
        let variants = variants.into_iter().map(ToOwned::to_owned);
        match values.iter_mut().find(|(known, _)| *known == value) {
            Some((_, known)) => known.extend(variants),
            None => values.push((value, variants.collect())),
        }
    }
    match values.as_slice() {
        [] => match written.or_else(default) {
            Some(value) => format!("\n\nResolved value: `{}`{origin}", short(&value)),
            None => String::new(),
        },
        [(value, _)] => format!("\n\nResolved value: `{}`{origin}", short(value)),
        several => {
            let line = |(value, variants): &(Json, Vec<String>)| {
                let more = variants.len().saturating_sub(MOST_VARIANTS);
                let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                let first: Vec<&str> = variants.iter().take(MOST_VARIANTS).map(String::as_str).collect();
                format!("\n- `{}`: {}{more}", short(value), first.join(", "))
            };
            format!("\n\nResolved values by variant:\n{}", several.iter().map(line).collect::<String>())
        }
    }
}

fn short(value: &Json) -> String {
    let text = match value {
        Json::String(text) => text.clone(),
        // `80`, not `80.0`.
        Json::Number(number) => {
            number.as_f64().filter(|_| number.is_f64()).map_or(number.to_string(), |n| n.to_string())
        }
        other => other.to_string(),
    };
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}
