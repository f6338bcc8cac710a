//! The names of stages and their nodes, in which references are looked up.

use std::collections::HashMap;
use std::sync::Arc;

use super::linked::LinkedSource;
use crate::contracts::{Port, Signature};
use crate::language::check::params::Parameters;
use crate::language::ids::StageNodeId;
use crate::registry::NodeKind;

pub(crate) struct StageNames<'r, 's> {
    pub(crate) name: &'s str,
    pub(crate) source: Option<Arc<LinkedSource>>,
    pub(crate) nodes: Vec<KnownNode<'r, 's>>,
    pub(crate) index: HashMap<&'s str, StageNodeId>,
}

pub(crate) struct KnownNode<'r, 's> {
    pub(crate) name: &'s str,
    /// The names and nodes of a stage, known before any wire is looked at.
    pub(crate) kind: Option<&'r NodeKind>,
    /// `None` if they are invalid.
    pub(crate) parameters: Option<Arc<Parameters>>,
    /// `None` if the kind is unknown, or if it follows from invalid parameters.
    pub(crate) signature: Option<Arc<Signature>>,
}

impl KnownNode<'_, '_> {
    pub(crate) fn outputs(&self) -> &[Port] {
        self.signature.as_ref().map_or(&[], |signature| &signature.outputs)
    }
}

impl StageNames<'_, '_> {
    pub(crate) fn node(&self, name: &str) -> Option<StageNodeId> {
        self.index.get(name).copied()
    }
}
