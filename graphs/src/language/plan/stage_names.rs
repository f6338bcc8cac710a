//! The names of stages and their nodes, in which references are looked up.

use std::collections::HashMap;
use std::sync::Arc;

use super::linked::{LinkedSource, NodeTypes};
use crate::language::ids::StageNodeId;

pub(crate) struct StageNames<'r, 's> {
    pub(crate) name: &'s str,
    pub(crate) source: Option<Arc<LinkedSource>>,
    pub(crate) nodes: Vec<(&'s str, NodeTypes<'r>)>,
    pub(crate) index: HashMap<&'s str, StageNodeId>,
}

impl StageNames<'_, '_> {
    pub(crate) fn node(&self, name: &str) -> Option<StageNodeId> {
        self.index.get(name).copied()
    }
}
