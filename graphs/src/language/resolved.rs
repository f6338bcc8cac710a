//! The experiment as resolved, as YAML text: `extends`, graph files and `--set` applied.
//!
//! Scalars with `${...}` and relative paths stay as they were written, so that the same experiment on two machines gives the
//! same text.

use serde_json::Value as Json;

use super::tree::{Node, Tree};

/// A document as YAML.
pub(super) fn yaml(root: &Node) -> String {
    // Maps with text as keys, lists and scalars: all of it can be written.
    serde_saphyr::to_string(&as_written(root)).unwrap_or_default()
}

fn as_written(node: &Node) -> Json {
    if let Some(written) = &node.written {
        return Json::String(written.text.clone());
    }
    match &node.value {
        Tree::List(items) => Json::Array(items.iter().map(|item| as_written(item)).collect()),
        Tree::Map(entries) => {
            Json::Object(entries.iter().map(|entry| (entry.key.clone(), as_written(&entry.value))).collect())
        }
        Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => node.to_json(),
    }
}
