//! `variants:` and `matrix:`: the same experiment with something changed.

use super::matrix;
use super::variant::{MOST, Variant, changes, too_many};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::tree::{Node, Tree};
use crate::plan::Factor;

/// The variants in the order of the file; one without a name if none is declared.
pub(crate) fn read(root: &Node, report: &mut Report) -> Vec<Variant> {
    let declared = declared(root, report);
    let combinations = match root.entry("matrix") {
        Some(entry) => matrix::read(entry, report),
        None => Vec::new(),
    };
    match (declared.is_empty(), combinations.is_empty()) {
        (true, true) => {
            vec![Variant { name: String::new(), place: root.place.clone(), changes: Vec::new(), factors: Vec::new() }]
        }
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
                    let own = Factor { axis: Factor::VARIANT.to_owned(), value: variant.name.clone() };
                    let factors = std::iter::once(own).chain(combination.factors.iter().cloned()).collect();
                    product.push(Variant { name, place: variant.place.clone(), changes, factors });
                }
            }
            product
        }
    }
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
        let (name, place) = (entry.key.clone(), entry.key_place.clone());
        variants.push(Variant { name, place, changes, factors: Vec::new() });
    }
    variants
}
