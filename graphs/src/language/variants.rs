//! `variants:` and `matrix:`: the same experiment with something changed.

use std::sync::Arc;

use super::change::Change;
use super::diagnostics::{Diagnostic, Report};
use super::matrix;
use super::names;
use super::source_file::Place;
use super::tree::{Node, Tree};

/// The most variants an experiment may have.
pub(super) const MOST: usize = 10_000;

/// The most changes of one variant.
const MOST_CHANGES: usize = 1000;

/// One variant: a name and what it changes.
#[derive(Clone, Debug)]
pub(super) struct Variant {
    pub(super) name: String,
    pub(super) place: Place,
    pub(super) changes: Vec<Change>,
}

/// The variants in the order of the file; one without a name if none is declared.
pub(super) fn read(root: &Node, report: &mut Report) -> Vec<Variant> {
    let declared = declared(root, report);
    let combinations = match root.entry("matrix") {
        Some(entry) => matrix::read(entry, report),
        None => Vec::new(),
    };
    match (declared.is_empty(), combinations.is_empty()) {
        (true, true) => vec![Variant { name: String::new(), place: root.place.clone(), changes: Vec::new() }],
        (false, true) => declared,
        (true, false) => combinations,
        (false, false) => {
            if declared.len().saturating_mul(combinations.len()) > MOST {
                report.push(too_many(&combinations[0].place, declared.len().saturating_mul(combinations.len())));
                return declared;
            }
            let mut product = Vec::with_capacity(declared.len() * combinations.len());
            for variant in &declared {
                for combination in &combinations {
                    let mut changes = variant.changes.clone();
                    changes.extend(combination.changes.iter().cloned());
                    let name = format!("{}+{}", variant.name, combination.name);
                    product.push(Variant { name, place: variant.place.clone(), changes });
                }
            }
            product
        }
    }
}

pub(super) fn too_many(place: &Place, count: usize) -> Diagnostic {
    Diagnostic::error(place, format!("{count} variants: more than {MOST}"))
        .help("split the experiment, or `exclude` combinations")
}

fn declared(root: &Node, report: &mut Report) -> Vec<Variant> {
    let Some(entry) = root.entry("variants") else { return Vec::new() };
    let entries = match &entry.value.value {
        Tree::Map(entries) => entries.as_slice(),
        Tree::Null => &[],
        _ => {
            let what = format!("`variants` wants a map from names to changes, not {}", entry.value.describe());
            report.push(
                Diagnostic::error(&entry.value.place, what)
                    .help("e.g. `variants: { full: {}, plain: { STAGE.NODE.with.X: 3 } }`"),
            );
            return Vec::new();
        }
    };
    if entries.len() > MOST {
        report.push(too_many(&entry.key_place, entries.len()));
        return Vec::new();
    }
    let mut variants = Vec::with_capacity(entries.len());
    for entry in entries {
        names::check(&entry.key, "a variant", &[], &entry.key_place, report);
        let Some(changes) = changes(&entry.value, &format!("variant `{}`", entry.key), report) else { continue };
        variants.push(Variant { name: entry.key.clone(), place: entry.key_place.clone(), changes });
    }
    variants
}

/// A map from paths to values.
pub(super) fn changes(node: &Arc<Node>, what: &str, report: &mut Report) -> Option<Vec<Change>> {
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
            let error = Diagnostic::error(
                &node.place,
                format!("{what} wants a map from paths to values, not {}", node.describe()),
            );
            report.push(error.help("e.g. `{ STAGE.NODE.with.X: 3 }`; `{}` changes nothing"));
            None
        }
    }
}
