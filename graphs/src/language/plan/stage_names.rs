//! What references are looked up in: the names of the stages and of what stands in them.

use std::collections::HashMap;
use std::sync::Arc;

use super::linked::LinkedSource;
use crate::registry::NodeKind;

/// The names and kinds of a stage's nodes, known before any wire is looked at.
pub(crate) struct StageNames<'r, 's> {
    pub(crate) name: &'s str,
    pub(crate) source: Option<Arc<LinkedSource>>,
    pub(crate) nodes: Vec<(&'s str, Option<&'r NodeKind>)>,
    pub(crate) index: HashMap<&'s str, usize>,
}

impl StageNames<'_, '_> {
    pub(crate) fn node(&self, name: &str) -> Option<usize> {
        self.index.get(name).copied()
    }
}
