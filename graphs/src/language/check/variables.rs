//! Values of environment variables, which are neither shown nor stored.
//!
//! Text from the environment may be a token or a path of this machine, so an experiment is shown and recorded with
//! `${NAME}`. Numbers, truth values, words of an enumeration and ranges of frames are settings and stay. Node hashes
//! use the values.

use serde_json::Value as Json;

use super::with_schema::{has_format, part, property};
use crate::contracts::FrameSelection;
use crate::language::text::tree::{Node, Tree};

#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Hidden {
    path: Vec<String>,
    written: String,
}

pub(crate) fn hidden(with: &Node, schema: &Json) -> Vec<Hidden> {
    let mut found = Vec::new();
    look(with, schema, &mut Vec::new(), &mut found);
    found
}

fn look(node: &Node, schema: &Json, path: &mut Vec<String>, found: &mut Vec<Hidden>) {
    let mut below = |key: String, node: &Node, schema: Option<&Json>| {
        path.push(key);
        look(node, schema.unwrap_or(&Json::Null), path, found);
        path.pop();
    };
    match &node.value {
        Tree::List(items) => {
            let schema = part(schema, &|schema| schema.get("items"));
            items.iter().enumerate().for_each(|(index, item)| below(index.to_string(), item, schema));
        }
        Tree::Map(entries) => {
            entries.iter().for_each(|entry| below(entry.key.clone(), &entry.value, property(schema, &entry.key)));
        }
        Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => {
            if let Some(written) = node.text_with_variables().filter(|_| !is_setting(node, schema)) {
                found.push(Hidden { path: path.clone(), written: written.to_owned() });
            }
        }
    }
}

/// Whether it is a setting (a number, a word of a list), not free text.
fn is_setting(node: &Node, schema: &Json) -> bool {
    if has_format(schema, "frames") {
        return node
            .text()
            .is_none_or(|text| !matches!(FrameSelection::parse(text), Ok(FrameSelection::File(_)) | Err(_)));
    }
    takes_settings(schema)
}

fn takes_settings(schema: &Json) -> bool {
    let alternatives = ["anyOf", "oneOf", "allOf"].iter().find_map(|key| schema.get(key)?.as_array());
    if let Some(alternatives) = alternatives {
        return alternatives.iter().all(takes_settings);
    }
    if schema.get("enum").or_else(|| schema.get("const")).is_some() {
        return true;
    }
    let is_setting = |name: &Json| matches!(name.as_str(), Some("number" | "integer" | "boolean" | "null"));
    match schema.get("type") {
        Some(Json::Array(types)) => types.iter().all(is_setting),
        Some(one) => is_setting(one),
        None => false,
    }
}

/// Replaces hidden values by the text of the file. Hashes of contents stay: they reveal no location.
pub(crate) fn without(parameters: &Json, hidden: &[Hidden]) -> Json {
    let mut shown = parameters.clone();
    for Hidden { path, written } in hidden {
        // Parameters may have been left out altogether.
        let top = path.split_first().and_then(|(name, rest)| Some((shown.get_mut(name)?, rest)));
        if let Some((value, rest)) = top {
            hide(value, rest, written);
        }
    }
    shown
}

fn hide(value: &mut Json, path: &[String], written: &str) {
    let Some((first, rest)) = path.split_first() else {
        if value.get("content").is_none() {
            *value = written.into();
        }
        return;
    };
    let inner = match value {
        Json::Object(map) => map.get_mut(first),
        Json::Array(items) => first.parse::<usize>().ok().and_then(|index| items.get_mut(index)),
        Json::Null | Json::Bool(_) | Json::Number(_) | Json::String(_) => None,
    };
    match inner {
        Some(inner) => hide(inner, rest, written),
        // It was resolved to another form, somewhere in which the value is.
        None => *value = written.into(),
    }
}
