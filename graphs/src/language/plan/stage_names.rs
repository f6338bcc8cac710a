//! What references are looked up in: the names of the stages and of what stands in them.

use std::collections::HashMap;
use std::sync::Arc;

use super::linked::LinkedSource;
use crate::contracts::{Port, Signature};
use crate::language::check::params::Parameters;
use crate::language::ids::StageNodeId;
use crate::registry::NodeKind;

/// The names and nodes of a stage, known before any wire is looked at.
pub(crate) struct StageNames<'r, 's> {
    pub(crate) name: &'s str,
    pub(crate) source: Option<Arc<LinkedSource>>,
    pub(crate) nodes: Vec<KnownNode<'r, 's>>,
    pub(crate) index: HashMap<&'s str, StageNodeId>,
}

/// What is known of a node by itself.
pub(crate) struct KnownNode<'r, 's> {
    pub(crate) name: &'s str,
    /// `None` if its kind is unknown.
    pub(crate) kind: Option<&'r NodeKind>,
    /// `None` if something is wrong with them.
    pub(crate) parameters: Option<Arc<Parameters>>,
    /// `None` if its kind is unknown, or the signature follows from parameters that are wrong.
    pub(crate) signature: Option<Arc<Signature>>,
}

impl KnownNode<'_, '_> {
    /// Its output ports, as far as they are known.
    pub(crate) fn outputs(&self) -> &[Port] {
        self.signature.as_ref().map_or(&[], |signature| &signature.outputs)
    }
}

impl StageNames<'_, '_> {
    pub(crate) fn node(&self, name: &str) -> Option<StageNodeId> {
        self.index.get(name).copied()
    }
}
