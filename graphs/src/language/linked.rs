//! One variant with every name resolved: what the linker hands to sharing.

use std::path::PathBuf;
use std::sync::Arc;

use super::params::Parameters;
use super::source_file::Place;
use super::spec::Word;
use crate::contracts::Port;
use crate::key::Key;
use crate::plan::SourcePart;
use crate::registry::NodeKind;

/// A variant's stages, in the order of the file.
pub(super) struct Linked<'r> {
    pub(super) stages: Vec<LinkedStage<'r>>,
}

/// A stage with its source and nodes.
pub(super) struct LinkedStage<'r> {
    pub(super) name: Word,
    /// `None` if something is wrong with it.
    pub(super) source: Option<Arc<LinkedSource>>,
    /// In the order of the file, the scores last.
    pub(super) nodes: Vec<LinkedNode<'r>>,
    /// Indices of nodes, each after all those it reads; empty where nodes go round in a circle.
    pub(super) order: Vec<usize>,
    pub(super) estimates: Vec<LinkedEstimate>,
}

/// A stage's source.
#[derive(Debug)]
pub(super) struct LinkedSource {
    pub(super) name: String,
    pub(super) parts: Vec<SourcePart>,
    pub(super) outputs: Vec<Port>,
}

/// A node whose references are resolved.
pub(super) struct LinkedNode<'r> {
    pub(super) name: Word,
    /// `None` if its kind is unknown.
    pub(super) kind: Option<&'r NodeKind>,
    /// `None` if something is wrong with them.
    pub(super) parameters: Option<Arc<Parameters>>,
    /// By input port of the declaration; `None` where unwired, or wired wrongly.
    pub(super) wires: Vec<Option<Wire>>,
    /// The nodes it reads, as (stage, node), whether or not the wires fit.
    pub(super) reads: Vec<(usize, usize, Place)>,
    /// Whether it is one of the nodes that `score:` stands for.
    pub(super) is_score: bool,
}

/// Where an input's value comes from.
#[derive(Clone, Debug)]
pub(super) enum Wire {
    /// The stage's source.
    Source { port: usize },
    /// A node of the same stage, or a once-value of an earlier one.
    Node { stage: usize, node: usize, port: usize },
    /// A file.
    File { path: PathBuf, content: Key },
}

/// An estimate of a stage's `score:`.
pub(super) struct LinkedEstimate {
    pub(super) name: Word,
    /// Index of its score node.
    pub(super) node: usize,
}
