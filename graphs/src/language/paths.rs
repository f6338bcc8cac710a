//! Paths in parameters: a relative path starts at the folder of the file it is written in.
//!
//! Two exceptions, where the path stands in no file: what comes out of the environment and what `--set` gives start at the working
//! directory, as they would in any other command.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value as Json;

use super::files::normal;
use super::source_file::Place;
use super::tree::{Node, Tree};
use crate::contracts::FrameSelection;

/// The path a scalar names, from the working directory.
pub(super) fn located(node: &Node, text: &str) -> PathBuf {
    match &node.written {
        _ if text.is_empty() => PathBuf::new(),
        Some(written) if written.leads => normal(Path::new(text)),
        _ => normal(&node.place.file.folder().join(text)),
    }
}

/// Where in its files an experiment names paths, each with the text that leads there from any folder of this machine.
#[derive(Default)]
pub(super) struct Anywhere(HashMap<(usize, usize), (Place, String)>);

impl Anywhere {
    /// Remembers a path, unless its text leads there from anywhere already: it is absolute, or begins with a variable.
    pub(super) fn add(&mut self, node: &Node, text: &str) {
        let written = match &node.written {
            Some(written) if written.leads => return,
            Some(written) => written.text.as_str(),
            None => text,
        };
        if text.is_empty() || Path::new(text).is_absolute() {
            return;
        }
        let folder = std::path::absolute(node.place.file.folder().join("."));
        if let Some(folder) = folder.ok().as_deref().and_then(Path::to_str) {
            let folder = folder.trim_end_matches('/').replace("${", "$${");
            let place = node.place.clone();
            self.0.insert(Self::key(&place), (place, format!("{folder}/{written}")));
        }
    }

    /// The text for what stands at a place.
    pub(super) fn of(&self, place: &Place) -> Option<&str> {
        self.0.get(&Self::key(place)).map(|(_, text)| text.as_str())
    }

    /// The file, which the place keeps where it is, and the offset in it.
    fn key(place: &Place) -> (usize, usize) {
        (Arc::as_ptr(&place.file).addr(), place.span.start)
    }

    /// All places with their texts.
    pub(super) fn iter(&self) -> impl Iterator<Item = (&Place, &str)> {
        self.0.values().map(|(place, text)| (place, text.as_str()))
    }
}

/// A tree as JSON for parameters of a schema: paths located, numbers out of the environment as text where text is wanted.
pub(super) fn parameters(node: &Node, schema: &Json, anywhere: &mut Anywhere) -> Json {
    match &node.value {
        Tree::Text(text) if has_format(schema, "path") => {
            anywhere.add(node, text);
            Json::String(located(node, text).to_string_lossy().into_owned())
        }
        Tree::Text(text) if has_format(schema, "frames") => match frames_file(node, text) {
            Some(path) => {
                anywhere.add(node, text);
                Json::String(path)
            }
            None => Json::String(text.clone()),
        },
        Tree::Number(_) | Tree::Bool(_) | Tree::Null => match &node.written {
            Some(written) if wants_text_only(schema) => Json::String(written.value.clone()),
            _ => node.to_json(),
        },
        Tree::Text(text) => Json::String(text.clone()),
        Tree::List(items) => {
            let item_schema = part(schema, &|s| s.get("items")).unwrap_or(&Json::Null);
            Json::Array(items.iter().map(|item| parameters(item, item_schema, anywhere)).collect())
        }
        Tree::Map(entries) => {
            let mut value =
                |key: &str, node: &Node| parameters(node, property(schema, key).unwrap_or(&Json::Null), anywhere);
            Json::Object(entries.iter().map(|e| (e.key.clone(), value(&e.key, &e.value))).collect())
        }
    }
}

/// The file of frame ids that a text names: by its form, or because there is such a file. A range is never one.
fn frames_file(node: &Node, text: &str) -> Option<String> {
    let path = || located(node, text).to_string_lossy().into_owned();
    match FrameSelection::parse(text) {
        Ok(FrameSelection::File(_)) => Some(path()),
        Err(_) if !text.is_empty() && Path::new(&path()).is_file() => {
            // Of a form that says so, wherever it is read again.
            let path = path();
            Some(if path.contains('/') { path } else { format!("./{path}") })
        }
        Ok(_) | Err(_) => None,
    }
}

/// Resolved parameters with every path replaced by what `name` makes of it.
pub(super) fn with_paths(value: &Json, schema: &Json, name: &mut dyn FnMut(&Path) -> Json) -> Json {
    match value {
        Json::String(text) if !text.is_empty() => {
            let is_path = has_format(schema, "path")
                || has_format(schema, "frames") && matches!(FrameSelection::parse(text), Ok(FrameSelection::File(_)));
            if is_path { name(Path::new(text)) } else { value.clone() }
        }
        Json::Array(items) => {
            let item_schema = part(schema, &|s| s.get("items")).unwrap_or(&Json::Null);
            Json::Array(items.iter().map(|item| with_paths(item, item_schema, name)).collect())
        }
        Json::Object(map) => {
            let mut new = serde_json::Map::new();
            for (key, value) in map {
                new.insert(key.clone(), with_paths(value, property(schema, key).unwrap_or(&Json::Null), name));
            }
            Json::Object(new)
        }
        Json::Null | Json::Bool(_) | Json::Number(_) | Json::String(_) => value.clone(),
    }
}

/// Resolved parameters, those that are operational left out.
pub(super) fn decisive(value: &Json, schema: &Json) -> Json {
    chosen(value, schema, false)
}

/// Resolved parameters, those alone that are operational.
pub(super) fn operational(value: &Json, schema: &Json) -> Json {
    chosen(value, schema, true)
}

/// The parameters of a map that are operational, or are not; a list is taken as a whole.
fn chosen(value: &Json, schema: &Json, operational: bool) -> Json {
    let Json::Object(map) = value else { return value.clone() };
    let of = |key: &str| property(schema, key).unwrap_or(&Json::Null);
    let kept = map.iter().filter(|(key, _)| is_operational(of(key)) == operational);
    Json::Object(kept.map(|(key, value)| (key.clone(), value.clone())).collect())
}

/// Whether a parameter is declared to decide no output; see [`Node::Params`](crate::contracts::Node::Params).
pub(crate) fn is_operational(schema: &Json) -> bool {
    part(schema, &|s| s.get(OPERATIONAL).filter(|is| is.as_bool() == Some(true))).is_some()
}

/// The attribute of a parameter's schema by which it is operational.
const OPERATIONAL: &str = "operational";

/// A part of a schema, or of the first of its alternatives that has it.
fn part<'s>(schema: &'s Json, find: &dyn Fn(&'s Json) -> Option<&'s Json>) -> Option<&'s Json> {
    find(schema).or_else(|| {
        ["anyOf", "oneOf", "allOf"]
            .iter()
            .filter_map(|key| schema.get(key)?.as_array())
            .flatten()
            .find_map(|alternative| part(alternative, find))
    })
}

fn property<'s>(schema: &'s Json, key: &str) -> Option<&'s Json> {
    part(schema, &|s| s.get("properties")?.get(key)).or_else(|| part(schema, &|s| s.get("additionalProperties")))
}

fn has_format(schema: &Json, format: &str) -> bool {
    part(schema, &|s| s.get("format").filter(|f| f.as_str() == Some(format))).is_some()
}

fn wants_text_only(schema: &Json) -> bool {
    match schema.get("type") {
        Some(Json::String(one)) => one == "string",
        Some(Json::Array(several)) => several.iter().all(|t| matches!(t.as_str(), Some("string" | "null"))),
        _ => false,
    }
}
