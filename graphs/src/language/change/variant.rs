//! One variant: a name and what it changes.

use std::sync::Arc;

use super::apply::Change;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Node, Tree};
use crate::plan::Factor;

pub(crate) const MOST: usize = 10_000;

const MOST_CHANGES: usize = 1000;

#[derive(Clone, Debug)]
pub(crate) struct Variant {
    pub(crate) name: String,
    pub(crate) place: Place,
    pub(crate) changes: Vec<Change>,
    pub(crate) factors: Vec<Factor>,
}

impl Variant {
    /// The experiment itself.
    pub(crate) fn unnamed(root: &Node) -> Self {
        Self { name: String::new(), place: root.place.clone(), changes: Vec::new(), factors: Vec::new() }
    }
}

pub(crate) fn too_many(place: &Place, count: usize) -> Diagnostic {
    Diagnostic::error(place, format!("{count} variants: more than {MOST}")).help(
        "`sample: { count: 1000 }` in `matrix` draws some of them; or split the experiment, or `exclude` combinations",
    )
}

pub(crate) fn changes(node: &Arc<Node>, what: &str, report: &mut Report) -> Option<Vec<Change>> {
    match &node.value {
        Tree::Null => Some(Vec::new()),
        Tree::Map(entries) if entries.len() > MOST_CHANGES => {
            let error = Diagnostic::error(&node.place, format!("{what} changes more than {MOST_CHANGES} paths"));
            report.push(error.help("another experiment with `extends` changes whole maps"));
            None
        }
        Tree::Map(entries) => Some(
            entries
                .iter()
                .map(|e| Change { path: e.key.clone(), place: e.key_place.clone(), value: Arc::clone(&e.value) })
                .collect(),
        ),
        _ => {
            let error = node.not_a(what, "a map from paths to values");
            report.push(error.help("e.g. `{ STAGE.NODE.with.X: 3 }`; `{}` changes nothing"));
            None
        }
    }
}
