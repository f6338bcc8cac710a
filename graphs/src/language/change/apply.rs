//! A change to an experiment: a path and a value, as variants, matrices and `--set` write them.
//!
//! `stage.node.with.x`, `stage.node.kind`, `stage.node.inputs.port`, `stage.source`, `stage.score.x`,
//! `sources.name.with.x`; on the command line also `record`, `only`, and `variants.name.` and `matrix.` before one of
//! these. A map is merged by key; any other value, also `null`, replaces the old one. On the command line `null`
//! removes a stage, node, source, variant or axis. A new `kind` drops the old `with`.

use std::sync::Arc;

use super::parameter::at;
use super::path::{self, Scope};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::merge::{Level, merged};
use crate::language::text::names;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};

#[derive(Clone, Debug)]
pub(crate) struct Change {
    pub(crate) path: String,
    pub(crate) place: Place,
    pub(crate) value: Arc<Node>,
}

pub(crate) fn apply(root: &Arc<Node>, changes: &[Change], scope: Scope, report: &mut Report) -> Arc<Node> {
    let mut new = Arc::clone(root);
    let mut located = Vec::with_capacity(changes.len());
    for change in changes {
        let takes_away = scope == Scope::CommandLine && change.value.is_null();
        if takes_away && root.get("stages").is_some_and(|stages| stages.get(&change.path).is_some()) {
            located.push((vec!["stages".to_owned(), change.path.clone()], change));
            continue;
        }
        match path::located(root, &change.path, scope) {
            Ok(keys) => located.push((keys, change)),
            Err(unknown) => {
                let place = change.place.part(&change.path, unknown.range);
                report.push(Diagnostic::error(&place, unknown.what).label("unknown name").maybe_help(unknown.help));
            }
        }
    }
    // Kinds first: a new kind drops the old parameters, not those set beside it.
    located.sort_by_key(|(keys, _)| instance_of_kind(keys).is_none());
    for (keys, change) in located {
        if let Some(instance) = instance_of_kind(&keys) {
            drop_parameters_of_another_kind(&mut new, instance, &change.value);
        }
        if scope == Scope::CommandLine && change.value.is_null() && can_be_taken_away(&keys) {
            // `located` has checked all others.
            if keys[0] == "matrix" && at(&new, &keys).is_none() {
                let what = format!("`matrix` has no axis `{}` to remove", keys[keys.len() - 1]);
                let axes = path::keys_of(new.get("matrix"));
                let help = names::suggestion(&keys[keys.len() - 1], "its axes", &axes);
                report.push(Diagnostic::error(&change.place, what).label("no such axis").maybe_help(help));
            }
            take_away(&mut new, &keys);
            continue;
        }
        let keys = values_of_axis(&new, keys, &change.value);
        if let Err(what) = set(&mut new, &keys, Level::Experiment, change) {
            report.push(Diagnostic::error(&change.place, what).label("unknown name"));
        }
    }
    new
}

fn can_be_taken_away(keys: &[String]) -> bool {
    let Some((_, above)) = keys.split_last() else { return false };
    level_of(above).can_lose_entries() || matches!(above, [matrix, _] if matrix == "matrix")
}

fn take_away(root: &mut Arc<Node>, keys: &[String]) {
    let Some((last, above)) = keys.split_last() else { return };
    if let Some(node) = at_mut(root, above)
        && let Tree::Map(entries) = &mut Arc::make_mut(node).value
    {
        entries.retain(|entry| entry.key != *last);
    }
}

/// The value at the end of keys and indices, to be changed.
fn at_mut<'n>(root: &'n mut Arc<Node>, keys: &[String]) -> Option<&'n mut Arc<Node>> {
    keys.iter().try_fold(root, |node, key| match &mut Arc::make_mut(node).value {
        Tree::Map(entries) => entries.iter_mut().find(|entry| entry.key == *key).map(|entry| &mut entry.value),
        Tree::List(items) => items.get_mut(key.parse::<usize>().ok()?),
        Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => None,
    })
}

/// New values of an axis that is written as a map replace its `values`.
fn values_of_axis(root: &Node, mut keys: Vec<String>, value: &Node) -> Vec<String> {
    let is_axis = keys.first().is_some_and(|section| section == "matrix");
    let axis = if is_axis { at(root, &keys) } else { None };
    let has = |node: &Node| ["paths", "values", "when"].iter().any(|key| node.get(key).is_some());
    if axis.is_some_and(|axis| has(axis)) && !has(value) {
        keys.push("values".to_owned());
    }
    keys
}

fn drop_parameters_of_another_kind(root: &mut Arc<Node>, instance: &[String], kind: &Node) {
    let Some(node) = at_mut(root, instance) else { return };
    let old = node.get("kind").and_then(|kind| kind.scalar_text());
    if old != kind.scalar_text()
        && let Tree::Map(entries) = &mut Arc::make_mut(node).value
    {
        entries.retain(|entry| entry.key != "with");
    }
}

fn level_of(keys: &[String]) -> Level {
    keys.iter().fold(Level::Experiment, |level, key| level.below(key))
}

fn instance_of_kind(keys: &[String]) -> Option<&[String]> {
    let (last, instance) = keys.split_last()?;
    (last == "kind" && level_of(instance) == Level::Instance).then_some(instance)
}

fn set(node: &mut Arc<Node>, keys: &[String], level: Level, change: &Change) -> Result<(), String> {
    let Some((key, rest)) = keys.split_first() else {
        *node = merged(node, &change.value, level);
        return Ok(());
    };
    let below = level.below(key);
    let key_place = || match change.path.rfind(key.as_str()) {
        Some(start) if rest.is_empty() => change.place.part(&change.path, start..start + key.len()),
        _ => change.place.clone(),
    };
    let inner = Arc::make_mut(node);
    match &mut inner.value {
        Tree::List(items) => {
            let length = items.len();
            match key.parse::<usize>().ok().and_then(|index| items.get_mut(index)) {
                Some(item) => set(item, rest, below, change),
                None => Err(format!("`{key}` is not an index of a list of {length}")),
            }
        }
        Tree::Text(from) if level == Level::Estimate => {
            // `name: node/port` is short for `name: { from: node/port }`.
            let from = Arc::new(Node::new(Tree::Text(std::mem::take(from)), inner.place.clone()));
            let entry = Entry { key: "from".to_owned(), key_place: inner.place.clone(), value: from };
            inner.value = Tree::Map(vec![entry]);
            set(node, keys, level, change)
        }
        Tree::Null => {
            inner.value = Tree::Map(Vec::new());
            set(node, keys, level, change)
        }
        Tree::Map(entries) => match entries.iter_mut().find(|entry| &entry.key == key) {
            Some(entry) => {
                if rest.is_empty() {
                    entry.key_place = key_place();
                }
                set(&mut entry.value, rest, below, change)
            }
            None => {
                let mut value = Arc::clone(&change.value);
                if !rest.is_empty() {
                    value = Arc::new(Node::new(Tree::Map(Vec::new()), change.place.clone()));
                    set(&mut value, rest, below, change)?;
                }
                entries.push(Entry { key: key.clone(), key_place: key_place(), value });
                Ok(())
            }
        },
        Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => {
            Err(format!("`{}` goes on beyond a single value", change.path))
        }
    }
}
