//! One variant with every name resolved: what the linker hands to sharing.

use std::path::PathBuf;
use std::sync::Arc;

use crate::contracts::{Port, Signature};
use crate::key::Key;
use crate::language::check::params::Parameters;
use crate::language::ids::{StageNode, StageNodeId};
use crate::language::text::source_file::Place;
use crate::language::text::word::Word;
use crate::plan::{PortId, SourcePart};
use crate::registry::NodeKind;

/// A variant's stages, in the order of the file.
pub(crate) struct Linked<'r> {
    pub(crate) stages: Vec<LinkedStage<'r>>,
}

/// A stage with its source and nodes.
pub(crate) struct LinkedStage<'r> {
    pub(crate) name: Word,
    /// `None` if something is wrong with it.
    pub(crate) source: Option<Arc<LinkedSource>>,
    /// In the order of the file, the scores last.
    pub(crate) nodes: Vec<LinkedNode<'r>>,
    /// Indices of nodes, each after all those it reads; empty where nodes go round in a circle.
    pub(crate) order: Vec<StageNodeId>,
    pub(crate) estimates: Vec<LinkedEstimate>,
}

/// A stage's source.
#[derive(Debug)]
pub(crate) struct LinkedSource {
    pub(crate) name: String,
    pub(crate) parts: Vec<SourcePart>,
    pub(crate) outputs: Vec<Port>,
}

/// A node whose references are resolved.
pub(crate) struct LinkedNode<'r> {
    pub(crate) name: Word,
    /// `None` if its kind is unknown.
    pub(crate) kind: Option<&'r NodeKind>,
    /// `None` if something is wrong with them.
    pub(crate) parameters: Option<Arc<Parameters>>,
    /// `None` if its kind is unknown, or the signature follows from parameters that are wrong.
    pub(crate) signature: Option<Arc<Signature>>,
    /// By input port of the signature; `None` where unwired, or wired wrongly.
    pub(crate) wires: Vec<Option<Wire>>,
    /// The nodes it reads, whether or not the wires fit.
    pub(crate) reads: Vec<(StageNode, Place)>,
    /// Whether it is one of the nodes that `score:` stands for.
    pub(crate) is_score: bool,
}

impl LinkedNode<'_> {
    /// Its output ports, as far as they are known.
    pub(crate) fn outputs(&self) -> &[Port] {
        self.signature.as_ref().map_or(&[], |signature| &signature.outputs)
    }
}

/// Where an input's value comes from.
#[derive(Clone, Debug)]
pub(crate) enum Wire {
    /// The stage's source.
    Source { port: PortId },
    /// A node of the same stage, or a once-value of an earlier one.
    Node { node: StageNode, port: PortId },
    /// A file.
    File {
        path: PathBuf,
        content: Key,
        /// As it stands in the file, if the environment is part of it.
        shown: Option<String>,
    },
}

/// An estimate of a stage's `score:`.
pub(crate) struct LinkedEstimate {
    pub(crate) name: Word,
    /// Its score node.
    pub(crate) node: StageNodeId,
}
