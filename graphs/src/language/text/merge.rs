//! Merges documents: maps by key, everything else is replaced. `null` removes a source, stage, node, variant or axis.

use std::collections::HashMap;
use std::sync::Arc;

use super::tree::{Entry, Node, Tree};

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Level {
    Experiment,
    Sources,
    Stages,
    Stage,
    Nodes,
    /// A source or node: replaced entirely if its kind changes.
    Instance,
    /// `matrix:`: its values replace each other entirely.
    Settings,
    Variants,
    Score,
    Estimates,
    Estimate,
    Plain,
}

impl Level {
    pub(crate) fn below(self, key: &str) -> Self {
        match (self, key) {
            (Self::Experiment, "sources") => Self::Sources,
            (Self::Experiment, "stages") => Self::Stages,
            (Self::Experiment, "matrix") => Self::Settings,
            (Self::Experiment, "variants") => Self::Variants,
            (Self::Stages, _) => Self::Stage,
            (Self::Stage, "nodes") => Self::Nodes,
            (Self::Stage, "score") => Self::Score,
            (Self::Score, "estimates") => Self::Estimates,
            (Self::Estimates, _) => Self::Estimate,
            (Self::Sources | Self::Nodes, _) => Self::Instance,
            _ => Self::Plain,
        }
    }

    /// Whether `null` removes an entry.
    pub(crate) const fn can_lose_entries(self) -> bool {
        matches!(self, Self::Sources | Self::Stages | Self::Nodes | Self::Settings | Self::Variants)
    }
}

pub(crate) fn merged(base: &Arc<Node>, over: &Arc<Node>, level: Level) -> Arc<Node> {
    let (Tree::Map(old), Tree::Map(new)) = (&base.value, &over.value) else { return Arc::clone(over) };
    if level == Level::Instance && replaces_base(base, over) {
        return Arc::clone(over);
    }
    let mut entries = old.clone();
    let index: HashMap<&str, usize> = old.iter().enumerate().map(|(i, entry)| (entry.key.as_str(), i)).collect();
    let mut added: Vec<(usize, &Entry)> = Vec::new();
    for (at, entry) in new.iter().enumerate() {
        match index.get(entry.key.as_str()) {
            Some(&i) => {
                let place = &mut entries[i];
                let value = match level {
                    Level::Settings => Arc::clone(&entry.value),
                    _ => merged(&place.value, &entry.value, level.below(&entry.key)),
                };
                *place = Entry { value, ..entry.clone() };
            }
            None => {
                // Stages run in the order of the file, so a new one may have to run before one of the base.
                let mut later = new[at + 1..].iter().filter(|_| level == Level::Stages);
                let next = later.find_map(|entry| index.get(entry.key.as_str()));
                added.push((next.copied().unwrap_or(old.len()), entry));
            }
        }
    }
    // From the last to the first, so that earlier places stay valid. The sort keeps the order of equal places.
    added.sort_by_key(|(place, _)| *place);
    for (place, entry) in added.into_iter().rev() {
        entries.insert(place, entry.clone());
    }
    if level.can_lose_entries() {
        let dropped = |key: &str| new.iter().any(|entry| entry.key == key && entry.value.is_null());
        entries.retain(|entry| !(index.contains_key(entry.key.as_str()) && dropped(&entry.key)));
    }
    Arc::new(Node::new(Tree::Map(entries), over.place.clone()))
}

/// Parameters and ports of another kind do not apply.
fn replaces_base(base: &Node, over: &Node) -> bool {
    let identity = |node: &Node| (node.get("kind").and_then(|kind| kind.scalar_text()), node.get("concat").is_some());
    let (old, new) = (identity(base), identity(over));
    (new.0.is_some() && new.0 != old.0) || (new.1 && !old.1) || (new.0.is_some() && old.1)
}
