//! The reference of kinds, in Markdown, from their declarations and parameter types.

use std::fmt::Write as _;

use serde_json::Value as Json;

use crate::contracts::{Port, Rate};
use crate::language::{alternatives, has_type, is_operational, range_text};
use crate::registry::Registry;

/// All kinds with a sentence each.
pub fn kinds_index(registry: &Registry) -> String {
    let mut text = String::from("# Sources\n\n| kind | what it gives |\n|---|---|\n");
    for kind in registry.sources() {
        let _ = writeln!(text, "| `{}` | {} |", kind.declaration.kind, cell(kind.declaration.summary));
    }
    text.push_str("\n# Nodes\n\n| kind | contract | what it does |\n|---|---|---|\n");
    for kind in registry.nodes() {
        let declaration = &kind.declaration;
        let contract = declaration.contract.name();
        let _ = writeln!(text, "| `{}` | {contract} | {} |", declaration.kind, cell(declaration.summary));
    }
    text
}

/// Everything about one kind: ports, parameters with type, default and range, docs. `None` if there is no such kind.
pub fn kind_reference(registry: &Registry, kind: &str) -> Option<String> {
    let kind = registry.kind(kind)?;
    let mut text = format!("# {}\n\n{}\n", kind.kind, kind.summary);
    let what = kind.contract.map_or_else(|| "Source".to_owned(), |own| format!("{} node", capital(own.name())));
    let _ = writeln!(text, "\n{what}, version {}.", kind.version);
    paragraph(&mut text, kind.doc);
    if kind.own_ports {
        paragraph(&mut text, "Which ports a node has follows from its parameters.");
    }
    ports(&mut text, "Inputs", kind.inputs);
    files(&mut text, kind.inputs);
    ports(&mut text, "Outputs", kind.outputs);
    parameters(&mut text, kind.schema);
    Some(text)
}

fn paragraph(text: &mut String, doc: &str) {
    if !doc.trim().is_empty() {
        let _ = write!(text, "\n{}\n", doc.trim());
    }
}

fn ports(text: &mut String, title: &str, ports: &[Port]) {
    if ports.is_empty() {
        return;
    }
    let _ = write!(text, "\n## {title}\n\n| port | carries | how often | meaning |\n|---|---|---|---|\n");
    for port in ports {
        let rate = match port.rate {
            Rate::Frame => "each frame",
            Rate::Once => "once a stage",
        };
        let optional = if port.optional { ", optional" } else { "" };
        let _ = writeln!(text, "| `{}` | {} | {rate}{optional} | {} |", port.name, port.value_type, cell(port.doc));
    }
}

fn files(text: &mut String, inputs: &[Port]) {
    for port in inputs.iter().filter(|port| port.takes_file()) {
        let name = port.name;
        let _ = write!(
            text,
            "\n`{name}` is an input: `inputs: {{ {name}: STAGE.NODE/{name} }}` of an earlier stage, or a file, "
        );
        let _ = writeln!(text, "`inputs: {{ {name}: {{ file: PATH }} }}`, relative to the experiment's file.");
    }
}

fn parameters(text: &mut String, schema: &Json) {
    let mut rows = Vec::new();
    collect(schema, "", &mut rows);
    if rows.is_empty() {
        text.push_str("\nNo parameters.\n");
        return;
    }
    text.push_str("\n## Parameters\n\n| parameter | type | default | range | meaning |\n|---|---|---|---|---|\n");
    for row in rows {
        let _ = writeln!(text, "| `{}` | {} | {} | {} | {} |", row.name, row.kind, row.default, row.range, row.meaning);
    }
}

struct Row {
    name: String,
    kind: String,
    default: String,
    range: String,
    meaning: String,
}

/// Parameters of an inner map are named `outer.inner`.
fn collect(schema: &Json, prefix: &str, rows: &mut Vec<Row>) {
    let Some(properties) = schema.get("properties").and_then(Json::as_object) else { return };
    let required: Vec<&str> =
        schema.get("required").and_then(Json::as_array).into_iter().flatten().filter_map(Json::as_str).collect();
    for (key, property) in properties {
        let name = format!("{prefix}{key}");
        if property.get("properties").is_some() {
            collect(property, &format!("{name}."), rows);
            continue;
        }
        let default = match property.get("default") {
            _ if required.contains(&key.as_str()) || is_mandatory(property) => "required".to_owned(),
            Some(Json::Null) | None => "none".to_owned(),
            Some(Json::String(text)) if text.is_empty() => "none".to_owned(),
            Some(default) => format!("`{}`", cell(&plain(default))),
        };
        let range = range_of(property).unwrap_or_else(|| "-".to_owned());
        let mut meaning = cell(&meaning(property));
        if is_operational(property) {
            meaning.push_str(" Decides no result, and enters no key.");
        }
        rows.push(Row { name, kind: cell(&type_text(property)), default, range, meaning });
    }
}

/// A parameter in one line, for the help of an error: its type, range and default, and where to read more.
pub(crate) fn parameter_help(kind: &str, schema: &Json, path: &[String]) -> Option<String> {
    let mut property = schema;
    let names = path.iter().filter(|part| part.parse::<usize>().is_err());
    for name in names.clone() {
        property = property.get("properties").and_then(|properties| properties.get(name))?;
    }
    let mut words = vec![type_text(property)];
    words.extend(range_of(property));
    match property.get("default") {
        Some(Json::Null) | None => {}
        Some(Json::String(text)) if text.is_empty() => {}
        Some(default @ (Json::String(_) | Json::Number(_) | Json::Bool(_))) => {
            words.push(format!("default `{}`", plain(default)));
        }
        Some(_) => {}
    }
    let name = names.map(String::as_str).collect::<Vec<_>>().join(".");
    Some(match name.is_empty() {
        true => format!("`depthloom nodes {kind}` describes the parameters"),
        // Without a range or a default, the type alone explains nothing.
        false if words.len() == 1 && ["map", "text"].contains(&words[0].as_str()) => {
            format!("`depthloom nodes {kind}` describes `{name}`")
        }
        false => format!("`{name}` is {}; `depthloom nodes {kind}` describes it", words.join(", ")),
    })
}

/// Parameters with a default in Rust that a kind nevertheless requires.
pub(super) fn is_mandatory(schema: &Json) -> bool {
    schema.get("mandatory").and_then(Json::as_bool) == Some(true)
}

pub(super) fn range_of(schema: &Json) -> Option<String> {
    // Its type lists the values.
    if is_frames(schema) || schema.get("enum").is_some() {
        return None;
    }
    let own = schema.as_object().and_then(range_text);
    own.or_else(|| alternatives(schema).find_map(range_of)).or_else(|| {
        let items = schema.get("items").and_then(range_of)?;
        Some(format!("each {items}"))
    })
}

fn is_frames(schema: &Json) -> bool {
    schema.get("format").and_then(Json::as_str) == Some("frames") || alternatives(schema).any(is_frames)
}

pub(super) fn plain(value: &Json) -> String {
    value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned)
}

pub(super) fn type_text(schema: &Json) -> String {
    let values = enumeration(schema);
    let words_alone = alternatives(schema).all(|one| has_type(one, "null") || !enumeration(one).is_empty());
    if !values.is_empty() && words_alone {
        return values.iter().map(|(value, _)| format!("`{value}`")).collect::<Vec<_>>().join(", ");
    }
    let format = |name: &str| schema.get("format").and_then(Json::as_str) == Some(name);
    if format("path") {
        return "path".to_owned();
    }
    if format("code") {
        return "path, folder or pattern".to_owned();
    }
    if is_frames(schema) {
        return "`1..=40`, `0..48`, list of indices, or file of ids".to_owned();
    }
    let several: Vec<String> = alternatives(schema).filter(|one| !has_type(one, "null")).map(type_text).collect();
    if !several.is_empty() {
        return several.join(" or ");
    }
    let one = |name: &str| match name {
        "integer" => "whole number".to_owned(),
        "number" => "number".to_owned(),
        "string" => "text".to_owned(),
        "boolean" => "`true` or `false`".to_owned(),
        "array" => schema
            .get("items")
            .map_or_else(|| "list".to_owned(), |items| format!("list of {}", plural(&type_text(items)))),
        "object" => "map".to_owned(),
        other => other.to_owned(),
    };
    match schema.get("type") {
        Some(Json::String(name)) => one(name),
        Some(Json::Array(names)) => {
            let names: Vec<String> = names.iter().filter_map(Json::as_str).filter(|n| *n != "null").map(one).collect();
            names.join(" or ")
        }
        _ => "anything".to_owned(),
    }
}

fn plural(kind: &str) -> String {
    if kind.ends_with("number") || kind == "path" || kind == "map" { format!("{kind}s") } else { kind.to_owned() }
}

/// The values of an enumeration with their docs.
pub fn enumeration(schema: &Json) -> Vec<(String, Option<&str>)> {
    let own = schema.get("enum").and_then(Json::as_array).into_iter().flatten();
    let own = own.filter(|value| !value.is_null()).map(|value| (plain(value), None));
    let constant = schema.get("const").map(|value| (plain(value), description(schema)));
    let of_each: Vec<Vec<_>> = alternatives(schema).filter(|one| !has_type(one, "null")).map(enumeration).collect();
    // The values are incomplete if one of the alternatives is not an enumeration.
    let inner = if of_each.iter().any(Vec::is_empty) { Vec::new() } else { of_each };
    own.chain(constant).chain(inner.into_iter().flatten()).collect()
}

fn description(schema: &Json) -> Option<&str> {
    schema.get("description").and_then(Json::as_str)
}

pub(super) fn meaning(schema: &Json) -> String {
    let own = description(schema).filter(|_| schema.get("const").is_none()).unwrap_or("");
    let values = enumeration(schema);
    let documented: Vec<String> =
        values.iter().filter_map(|(value, doc)| Some(format!("`{value}`: {}", (*doc)?))).collect();
    match (own.is_empty(), documented.is_empty()) {
        (_, true) => own.to_owned(),
        (true, false) => documented.join(" "),
        (false, false) => format!("{own} {}", documented.join(" ")),
    }
}

fn cell(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}
