//! Reports `--set` that has no effect in variants that set the same path themselves.

use std::sync::Arc;

use super::apply::Change;
use super::matrix;
use super::parameter::at;
use super::path;
use super::variant::Variant;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::tree::{Node, Tree};
use crate::plan::VariantId;

pub(crate) struct Outlasted<'a>(Vec<Set<'a>>);

struct Set<'a> {
    change: &'a Change,
    keys: Vec<String>,
    /// The variants with a value of their own.
    variants: Vec<VariantId>,
}

impl<'a> Outlasted<'a> {
    /// Changes of `variants` and `matrix` themselves are left out.
    pub(crate) fn new(root: &Node, changes: &'a [Change]) -> Self {
        let of_base = |change: &'a Change| {
            let keys = path::keys(root, &change.path)?;
            let is_base = matches!(keys.first().map(String::as_str), Some("stages" | "sources"));
            is_base.then(|| Set { change, keys, variants: Vec::new() })
        };
        Self(changes.iter().filter_map(of_base).collect())
    }

    pub(crate) fn look(&mut self, variant: VariantId, root: &Node, of_variant: &Node) {
        for set in &mut self.0 {
            if !stays(&set.change.value, at(root, &set.keys), at(of_variant, &set.keys)) {
                set.variants.push(variant);
            }
        }
    }

    pub(crate) fn report(self, root: &Node, variants: &[Variant], report: &mut Report) {
        for Set { change, variants: own, .. } in self.0.into_iter().filter(|set| !set.variants.is_empty()) {
            let path = &change.path;
            let value = change.value.place.text();
            let names: Vec<&str> = own.iter().map(|&index| variants[index].name.as_str()).collect();
            let by = cause(root, &variants[own[0]], path);
            let of_matrix = matrix::axis_of(root, by.map_or(path, |by| &by.path));
            let remedy = match of_matrix {
                Some(axis) => format!("`--matrix '{axis}=[{value}]'` sets the values that the matrix takes"),
                None => {
                    let name = declared(root, names[0]);
                    format!("`--set 'variants.{name}.{path}={value}'` sets it in a variant")
                }
            };
            let diagnostic = if own.len() == variants.len() {
                let every = if of_matrix.is_some() { "the matrix" } else { "every variant" };
                let what = format!("`--set {path}={value}` has no effect: {every} sets it");
                Diagnostic::error(&change.place, what).label("set by all variants themselves")
            } else {
                let (keep, their) =
                    if names.len() == 1 { ("variant", "keeps its") } else { ("variants", "keep their") };
                let what = format!("{keep} {} {their} own value of `{path}`", names::listed(&names));
                Diagnostic::warning(&change.place, what).label("is set for the other variants")
            };
            let diagnostic = diagnostic.help(remedy);
            report.push(match by {
                Some(by) => diagnostic.related(&by.place, "here"),
                None => diagnostic,
            });
        }
    }
}

fn stays(set: &Node, before: Option<&Arc<Node>>, now: Option<&Arc<Node>>) -> bool {
    match (&set.value, before, now) {
        (Tree::Map(entries), Some(before), Some(now)) if now.is_map() => {
            entries.iter().all(|entry| stays(&entry.value, before.get(&entry.key), now.get(&entry.key)))
        }
        (_, Some(before), Some(now)) => before.to_json() == now.to_json(),
        (_, before, now) => before.is_none() && now.is_none(),
    }
}

/// The variant's change of the same path, or of one above or below it.
fn cause<'v>(root: &Node, variant: &'v Variant, path: &str) -> Option<&'v Change> {
    let keys = path::keys(root, path)?;
    variant.changes.iter().find(|change| {
        let own = path::keys(root, &change.path).unwrap_or_default();
        // A new kind drops the parameters of the old one.
        let own = own.strip_suffix(&["kind".to_owned()]).unwrap_or(&own);
        own.iter().zip(&keys).all(|(a, b)| a == b)
    })
}

fn declared<'n>(root: &Node, name: &'n str) -> &'n str {
    let has = |name: &str| root.get("variants").is_some_and(|variants| variants.get(name).is_some());
    if has(name) { name } else { name.split_once('+').map_or(name, |(declared, _)| declared) }
}
