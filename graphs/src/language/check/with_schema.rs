//! Parameters with the schema of their kind: which of them are paths, and which are operational.

use std::path::Path;

use serde_json::Value as Json;

use crate::contracts::FrameSelection;
use crate::language::text::paths::{Anywhere, located};
use crate::language::text::tree::{Node, Tree};

/// JSON for parameters of a schema: paths located, numbers from the environment as text where text is expected.
pub(crate) fn parameters(node: &Node, schema: &Json, anywhere: &mut Anywhere) -> Json {
    match &node.value {
        Tree::Text(text) if has_format(schema, "path") || has_format(schema, "code") => {
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
        Tree::Text(text) if has_format(schema, "argument") && is_file_argument(node, text) => {
            anywhere.add(node, text);
            let path = located(node, text).to_string_lossy().into_owned();
            // A program without a folder would be searched along the PATH.
            Json::String(if text.starts_with("./") && !path.contains('/') { format!("./{path}") } else { path })
        }
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

/// By its form (`./x`), or because there is such a file. A bare word is a program of the PATH.
fn is_file_argument(node: &Node, text: &str) -> bool {
    let by_form = text.starts_with("./") || text.starts_with("../");
    let could_be = text.contains(['/', '.']) && !text.starts_with('-');
    by_form || could_be && located(node, text).is_file()
}

/// By its form, or because there is such a file. A range is never one.
fn frames_file(node: &Node, text: &str) -> Option<String> {
    let path = || located(node, text).to_string_lossy().into_owned();
    match FrameSelection::parse(text) {
        Ok(FrameSelection::File(_)) => Some(path()),
        Err(_) if !text.is_empty() && Path::new(&path()).is_file() => {
            // In a form that is always read as a path.
            let path = path();
            Some(if path.contains('/') { path } else { format!("./{path}") })
        }
        Ok(_) | Err(_) => None,
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PathOf {
    Data,
    Code,
}

/// Replaces every path by `name` of it, and a path in a command by its last part.
pub(crate) fn with_paths(value: &Json, schema: &Json, name: &mut dyn FnMut(&Path, PathOf) -> Json) -> Json {
    match value {
        Json::String(text) if has_format(schema, "argument") => {
            let name = Path::new(text).file_name().filter(|_| text.contains('/') && Path::new(text).is_file());
            name.map_or_else(|| value.clone(), |name| Json::String(name.to_string_lossy().into_owned()))
        }
        Json::String(text) if !text.is_empty() => {
            let is_path = has_format(schema, "path")
                || has_format(schema, "frames") && matches!(FrameSelection::parse(text), Ok(FrameSelection::File(_)));
            match is_path {
                true => name(Path::new(text), PathOf::Data),
                false if has_format(schema, "code") => name(Path::new(text), PathOf::Code),
                false => value.clone(),
            }
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

/// The parameters that are operational, or those that are not; a list is taken as a whole.
pub(crate) fn chosen(value: &Json, schema: &Json, operational: bool) -> Json {
    let Json::Object(map) = value else { return value.clone() };
    let chosen = map.iter().filter(|(key, _)| property(schema, key).is_some_and(is_operational) == operational);
    Json::Object(chosen.map(|(key, value)| (key.clone(), value.clone())).collect())
}

/// See [`Node::Params`](crate::contracts::Node::Params).
pub(crate) fn is_operational(schema: &Json) -> bool {
    part(schema, &|s| s.get("operational").filter(|is| is.as_bool() == Some(true))).is_some()
}

/// A part of a schema, or of the first alternative that has it.
pub(super) fn part<'s>(schema: &'s Json, find: &dyn Fn(&'s Json) -> Option<&'s Json>) -> Option<&'s Json> {
    let parts = || alternatives(schema).chain(schema.get("allOf").and_then(Json::as_array).into_iter().flatten());
    find(schema).or_else(|| parts().find_map(|inner| part(inner, find)))
}

/// The schema of a key, also of one of the alternatives.
pub fn property<'s>(schema: &'s Json, key: &str) -> Option<&'s Json> {
    part(schema, &|s| s.get("properties")?.get(key)).or_else(|| part(schema, &|s| s.get("additionalProperties")))
}

/// The schema of the items of a list, also of one of the alternatives.
pub fn item(schema: &Json) -> Option<&Json> {
    part(schema, &|s| s.get("items"))
}

pub(crate) fn alternatives(schema: &Json) -> impl Iterator<Item = &Json> {
    ["anyOf", "oneOf"].into_iter().filter_map(|key| schema.get(key)?.as_array()).flatten()
}

/// Whether a schema takes values of this type only.
pub(crate) fn has_type(schema: &Json, name: &str) -> bool {
    schema.get("type").and_then(Json::as_str) == Some(name)
}

pub(super) fn has_format(schema: &Json, format: &str) -> bool {
    part(schema, &|s| s.get("format").filter(|f| f.as_str() == Some(format))).is_some()
}

fn wants_text_only(schema: &Json) -> bool {
    match schema.get("type") {
        Some(Json::String(one)) => one == "string",
        Some(Json::Array(several)) => several.iter().all(|t| matches!(t.as_str(), Some("string" | "null"))),
        _ => false,
    }
}
