//! A document at the moment of a request: its trees, what was planned of it, and the ports and schemas of its nodes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::language::{Document, Loaded, Node, Place, Tree, parameters};
use depthloom_graphs::{Port, Registry};
use gen_lsp_types::Uri;
use serde_json::Value as Json;

use crate::cursor::Cursor;

/// What a request reads.
pub(crate) struct View<'s> {
    pub(crate) registry: &'s Registry,
    /// The schema of experiment files.
    pub(crate) schema: &'s Json,
    pub(crate) path: &'s Path,
    pub(crate) uri: &'s Uri,
    pub(crate) text: &'s str,
    pub(crate) document: Document,
    /// The last plan, if there is one.
    pub(crate) loaded: Option<Arc<Loaded>>,
}

/// Looks up a variable of the environment.
pub(crate) fn variable(name: &str) -> Option<String> {
    std::env::var_os(name).map(|value| value.to_string_lossy().into_owned())
}

/// Reads a document, with the texts of open documents.
pub(crate) fn read(path: &Path, texts: &[(PathBuf, String)]) -> Document {
    Document::read(path, texts, &variable)
}

/// Reads a document that may be incomplete at the cursor: as it is, with the line completed, without the line, or as it
/// was when it could last be read.
pub(crate) fn read_incomplete(
    path: &Path,
    texts: &[(PathBuf, String)],
    cursor: &Cursor,
    last_good: Option<&str>,
) -> Document {
    let document = read(path, texts);
    let Some(index) = texts.iter().position(|(of, _)| of == path).filter(|_| document.own().is_none()) else {
        return document;
    };
    let text = &texts[index].1;
    let start = text[..cursor.word.start].rfind('\n').map_or(0, |at| at + 1);
    let end = text[cursor.word.start..].find('\n').map_or(text.len(), |at| cursor.word.start + at);
    let completed = format!("{}{}{}", &text[..cursor.word.start], cursor.closing, &text[end..]);
    let removed = format!("{}{}", &text[..start], &text[end..]);
    let repaired = [Some(completed), Some(removed), last_good.map(ToOwned::to_owned)];
    let readings = repaired.into_iter().flatten().map(|text| {
        let mut texts = texts.to_vec();
        texts[index].1 = text;
        read(path, &texts)
    });
    readings.into_iter().find(|reading| reading.own().is_some()).unwrap_or(document)
}

/// The keys of a map; none if it is absent.
pub(crate) fn names(node: Option<&Arc<Node>>) -> Vec<&str> {
    node.map(|node| node.entries().iter().map(|entry| entry.key.as_str()).collect()).unwrap_or_default()
}

impl View<'_> {
    pub(crate) fn root(&self) -> Option<&Arc<Node>> {
        self.document.merged.as_ref()
    }

    /// Whether the file is a graph file: nodes without an experiment.
    pub(crate) fn is_graph_file(&self) -> bool {
        self.root().is_some_and(|root| root.get("nodes").is_some() && root.get("stages").is_none())
    }

    /// The keys of a cursor; the nodes of a graph file are those of a stage without a name.
    pub(crate) fn keys<'c>(&self, cursor: &'c Cursor) -> Vec<&'c str> {
        let keys = cursor.keys();
        match keys.first() {
            Some(&"nodes") if self.is_graph_file() => ["stages", ""].into_iter().chain(keys).collect(),
            _ => keys,
        }
    }

    /// A stage; the whole file, if it is a graph file.
    pub(crate) fn stage(&self, name: &str) -> Option<&Arc<Node>> {
        if name.is_empty() { self.root() } else { self.root()?.get("stages")?.get(name) }
    }

    pub(crate) fn node(&self, stage: &str, node: &str) -> Option<&Arc<Node>> {
        self.stage(stage)?.get("nodes")?.get(node)
    }

    pub(crate) fn source(&self, name: &str) -> Option<&Arc<Node>> {
        self.root()?.get("sources")?.get(name)
    }

    /// The input and output ports of a node: its own, or those of its kind where its parameters have errors.
    pub(crate) fn ports(&self, stage: &str, node: &str) -> (Vec<Port>, Vec<Port>) {
        let Some(node) = self.node(stage, node) else { return Default::default() };
        let kind = node.get("kind").and_then(|kind| self.registry.node_kind(kind.text()?));
        let Some(kind) = kind else { return Default::default() };
        let parameters = parameters(node, &kind.schema);
        let signature = kind.resolve(&parameters).ok().and_then(|resolved| kind.signature(&resolved).ok());
        match signature {
            Some(signature) => (signature.inputs, signature.outputs),
            None => (kind.declaration.inputs.clone(), kind.declaration.outputs.clone()),
        }
    }

    /// The output ports of a stage's source.
    pub(crate) fn source_ports(&self, stage: &str) -> Vec<Port> {
        let source = self.stage(stage).and_then(|stage| self.source(&stage.get("source")?.scalar_text()?));
        let first = source.and_then(|source| match &source.get("concat")?.value {
            Tree::List(items) => items.first(),
            _ => None,
        });
        let Some(source) = first.or(source) else { return Vec::new() };
        let kind = source.get("kind").and_then(|kind| self.registry.source_kind(kind.text()?));
        let Some(kind) = kind else { return Vec::new() };
        let outputs =
            kind.resolve(&parameters(source, &kind.schema)).ok().and_then(|resolved| kind.outputs(&resolved).ok());
        outputs.unwrap_or_else(|| kind.declaration.outputs.clone())
    }

    /// The schema of the parameters of a node or source.
    pub(crate) fn parameters_of(&self, node: &Node) -> Option<&Json> {
        let kind = node.get("kind")?.text()?.to_owned();
        let node = self.registry.node_kind(&kind).map(|kind| &kind.schema);
        node.or_else(|| self.registry.source_kind(&kind).map(|kind| &kind.schema))
    }

    /// The key of this name in one of the files, where the value with this anchor is written.
    fn key_place(&self, name: &str, anchor: &Place) -> Option<Place> {
        let around = self.document.keys_around(anchor);
        around.into_iter().rfind(|(key, _)| key == name).map(|(_, place)| place)
    }

    /// Where the entry at these keys of the merged experiment is defined: in the file that names its kind or source.
    pub(crate) fn definition(&self, keys: &[&str]) -> Option<Place> {
        let (last, above) = keys.split_last()?;
        let map = above.iter().try_fold(self.root()?, |node, key| node.get(key))?;
        let entry = map.entry(last)?;
        let anchor = ["kind", "concat", "source"].into_iter().find_map(|key| entry.value.entry(key));
        let anchored = anchor.and_then(|anchor| self.key_place(last, &anchor.key_place));
        Some(anchored.unwrap_or_else(|| entry.key_place.clone()))
    }
}
