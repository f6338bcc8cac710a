//! The schema and value of a parameter, before variants are applied.

use std::sync::Arc;

use serde_json::Value as Json;

use super::path;
use crate::language::check::score;
use crate::language::check::with_schema;
use crate::language::text::tree::{Node, Tree};
use crate::registry::Registry;

pub(crate) struct Parameters<'a> {
    pub(crate) root: &'a Arc<Node>,
    pub(crate) registry: &'a Registry,
}

impl<'a> Parameters<'a> {
    pub(crate) fn schema(&self, path: &str) -> Option<&'a Json> {
        let keys = path::keys(self.root, path)?;
        let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
        let (kind, parameter) = match keys.as_slice() {
            ["stages", stage, "nodes", node, "with", parameter @ ..] => {
                let node = self.root.get("stages")?.get(stage)?.get("nodes")?.get(node)?;
                (&self.registry.node_kind(node.get("kind")?.text()?)?.schema, parameter)
            }
            ["sources", source, "with", parameter @ ..] => {
                let source = self.root.get("sources")?.get(source)?;
                (&self.registry.source_kind(source.get("kind")?.text()?)?.schema, parameter)
            }
            ["stages", _, "score", "estimates", _, parameter @ ..] | ["stages", _, "score", parameter @ ..] => {
                // A parameter of both kinds has the same schema in both.
                let name = parameter.first()?;
                let mut schemas = score::kinds(self.registry).map(|kind| &kind.schema);
                (schemas.find(|schema| with_schema::property(schema, name).is_some())?, parameter)
            }
            _ => return None,
        };
        if parameter.is_empty() {
            return None;
        }
        parameter.iter().try_fold(kind, |schema, key| with_schema::property(schema, key))
    }

    pub(crate) fn value(&self, path: &str, document: &Node) -> Option<Json> {
        let keys = path::keys(self.root, path)?;
        match at(document, &keys) {
            Some(node) => Some(node.to_json()),
            None => self.schema(path)?.get("default").cloned(),
        }
    }
}

pub(crate) fn at<'n>(root: &'n Node, keys: &[String]) -> Option<&'n Arc<Node>> {
    let (first, rest) = keys.split_first()?;
    rest.iter().try_fold(root.get(first)?, |node, key| match &node.value {
        Tree::List(items) => items.get(key.parse::<usize>().ok()?),
        _ => node.get(key),
    })
}
