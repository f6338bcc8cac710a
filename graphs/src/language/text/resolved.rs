//! The resolved experiment as YAML: `extends`, graph files and `--set` applied.
//!
//! Scalars with `${...}` stay as written. So do relative paths in a recording, which is equal on all machines; next to
//! a recording they are absolute.

use serde_json::Value as Json;

use super::paths::Anywhere;
use super::tree::{Node, Tree};

/// Paths are as written, or as they lead from `anywhere`.
pub(crate) fn yaml(root: &Node, anywhere: Option<&Anywhere>) -> String {
    // Maps with text as keys, lists and scalars: all of it can be written.
    serde_saphyr::to_string(&as_written(root, anywhere)).unwrap_or_default()
}

/// A value with its `${...}` as written.
pub(crate) fn as_written(node: &Node, anywhere: Option<&Anywhere>) -> Json {
    if let Some(path) = anywhere.and_then(|anywhere| anywhere.replacement(&node.place)).filter(|_| is_scalar(node)) {
        return Json::String(path.to_owned());
    }
    if let Some(written) = &node.written {
        return Json::String(written.text.clone());
    }
    match &node.value {
        Tree::List(items) => Json::Array(items.iter().map(|item| as_written(item, anywhere)).collect()),
        Tree::Map(entries) => {
            Json::Object(entries.iter().map(|entry| (entry.key.clone(), as_written(&entry.value, anywhere))).collect())
        }
        Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => node.to_json(),
    }
}

/// A map may begin where its first path begins.
const fn is_scalar(node: &Node) -> bool {
    !matches!(node.value, Tree::List(_) | Tree::Map(_))
}
