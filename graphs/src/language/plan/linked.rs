//! One variant with every name resolved: what the linker hands to sharing.

use std::path::PathBuf;
use std::sync::Arc;

use crate::contracts::{Port, Signature, SwitchedOff};
use crate::key::Key;
use crate::language::check::params::Parameters;
use crate::language::ids::{StageNode, StageNodeId};
use crate::language::text::source_file::Place;
use crate::language::text::word::Word;
use crate::plan::{PortId, SourcePart};
use crate::registry::NodeKind;

pub(crate) struct Linked<'r> {
    pub(crate) stages: Vec<LinkedStage<'r>>,
}

pub(crate) struct LinkedStage<'r> {
    pub(crate) name: Word,
    /// `None` if something is wrong with it.
    pub(crate) source: Option<Arc<LinkedSource>>,
    /// In the order of the file, then the scores.
    pub(crate) nodes: Vec<LinkedNode<'r>>,
    /// Each after all nodes it reads; empty if they read each other in a circle.
    pub(crate) order: Vec<StageNodeId>,
    pub(crate) estimates: Vec<LinkedEstimate>,
}

#[derive(Debug)]
pub(crate) struct LinkedSource {
    pub(crate) name: String,
    pub(crate) parts: Vec<SourcePart>,
    pub(crate) outputs: Vec<Port>,
    /// Outputs without a value on any frame of any part.
    pub(crate) switched_off: Vec<SwitchedOff>,
}

pub(crate) struct LinkedNode<'r> {
    pub(crate) name: Word,
    pub(crate) types: NodeTypes<'r>,
    /// By input port; `None` where unwired or wrong.
    pub(crate) wires: Vec<Option<Wire>>,
    /// Also where the wire does not fit.
    pub(crate) reads: Vec<(StageNode, Place)>,
    pub(crate) is_score: bool,
}

/// The kind of a node, its parameters and its signature, as far as they are valid.
#[derive(Clone)]
pub(crate) struct NodeTypes<'r> {
    pub(crate) kind: Option<&'r NodeKind>,
    pub(crate) parameters: Option<Arc<Parameters>>,
    pub(crate) signature: Option<Arc<Signature>>,
}

impl NodeTypes<'_> {
    pub(crate) fn outputs(&self) -> &[Port] {
        self.signature.as_ref().map_or(&[], |signature| &signature.outputs)
    }
}

#[derive(Clone, Debug)]
pub(crate) enum Wire {
    Source {
        port: PortId,
    },
    Node {
        node: StageNode,
        port: PortId,
    },
    File {
        path: PathBuf,
        content: Key,
        /// As written, if it contains a variable.
        shown: Option<String>,
    },
}

pub(crate) struct LinkedEstimate {
    pub(crate) name: Word,
    pub(crate) node: StageNodeId,
}
