//! A change to an experiment: a path and a value, as variants, matrices and `--set` write them.
//!
//! `stage.node.with.x`, `stage.node.kind`, `stage.node.inputs.port`, `stage.source`, `stage.score.x`, `sources.name.with.x`; of the
//! command line alone also `record`, and `variants.name.` and `matrix.` before one of these.
//! A map as value is merged by key; anything else, `null` too, stands there as if it had been written there: no cap, an
//! optional input not wired. A new `kind` drops the old `with`.

use std::ops::Range;
use std::sync::Arc;

use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::merge::{Level, merged};
use crate::language::text::names;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree, entry_mut};

/// How many keys a path may have: parameters are nested no deeper.
const DEEPEST: usize = 32;

/// A path and the value it is to have.
#[derive(Clone, Debug)]
pub(crate) struct Change {
    pub(crate) path: String,
    pub(crate) place: Place,
    pub(crate) value: Arc<Node>,
}

/// Who asks for a change.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scope {
    /// A variant or a matrix: the science.
    Variant,
    /// `--set`: also what is recorded.
    CommandLine,
}

impl Scope {
    const fn describe(self) -> &'static str {
        match self {
            Self::Variant => "a variant",
            Self::CommandLine => "`--set`",
        }
    }
}

/// A path that names nothing: which part of it, and what to do.
struct Unknown {
    range: Range<usize>,
    what: String,
    help: Option<String>,
}

/// The experiment with the changes made; those whose path names nothing are reported and left out.
pub(crate) fn apply(root: &Arc<Node>, changes: &[Change], scope: Scope, report: &mut Report) -> Arc<Node> {
    let mut new = Arc::clone(root);
    let mut located = Vec::with_capacity(changes.len());
    for change in changes {
        match locate(root, &change.path, scope) {
            Ok(keys) => located.push((keys, change)),
            Err(unknown) => {
                let place = change.place.part(&change.path, unknown.range);
                report.push(Diagnostic::error(&place, unknown.what).label("names nothing").maybe_help(unknown.help));
            }
        }
    }
    // Kinds first: a new kind drops the old parameters, not those set beside it.
    located.sort_by_key(|(keys, _)| keys.last().is_none_or(|key| key != "kind"));
    for (keys, change) in located {
        if keys.last().is_some_and(|key| key == "kind") {
            drop_parameters_of_another_kind(&mut new, &keys[..keys.len() - 1], &change.value);
        }
        if matches!(keys.as_slice(), [section, _] if section == "variants") && change.value.is_null() {
            drop_variant(&mut new, &keys[1]);
            continue;
        }
        if let Err(what) = set(&mut new, &keys, 0, change) {
            report.push(Diagnostic::error(&change.place, what).label("names nothing"));
        }
    }
    new
}

/// The keys from the document's root that a path stands for, if it names something.
pub(crate) fn keys(root: &Node, path: &str) -> Option<Vec<String>> {
    locate(root, path, Scope::CommandLine).ok()
}

/// The keys from the document's root that a path stands for.
fn locate(root: &Node, path: &str, scope: Scope) -> Result<Vec<String>, Unknown> {
    let mut segments = Vec::new();
    let mut at = 0;
    for segment in path.split('.') {
        segments.push((segment, at..at + segment.len()));
        at += segment.len() + 1;
    }
    if segments.len() > DEEPEST {
        let what = format!("the path is deeper than {DEEPEST} keys, and no experiment is");
        return Err(Unknown { range: 0..path.len(), what, help: None });
    }
    let unknown = |index: usize, what: String, help: Option<String>| {
        let range = segments.get(index).map_or(0..path.len(), |(_, range)| range.clone());
        Unknown { range, what, help }
    };
    let owned = |keys: &[&str]| keys.iter().map(|&key| key.to_owned()).collect::<Vec<_>>();
    let rest = |from: usize| segments[from..].iter().map(|(s, _)| (*s).to_owned()).collect::<Vec<_>>();
    let keys_of = |node: Option<&Arc<Node>>| -> Vec<String> {
        node.map(|node| node.entries().iter().map(|entry| entry.key.clone()).collect()).unwrap_or_default()
    };
    let refs = |names: &[String]| -> Vec<String> { names.to_vec() };

    if let Some(empty) = segments.iter().position(|(segment, _)| segment.trim().is_empty()) {
        let what = "a path is keys joined by dots, and one of these is empty".to_owned();
        return Err(unknown(empty, what, Some(format!("e.g. `{}`", example(root)))));
    }
    let first = segments[0].0;
    let second = segments.get(1).map(|(s, _)| *s);
    match first {
        "record" if scope == Scope::CommandLine => return Ok(rest(0)),
        "variants" | "matrix" if scope == Scope::CommandLine && segments.len() > 1 && !is_stage(root, first) => {
            let known = keys_of(root.get(first));
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            // What is changed is itself a path: one key, with its dots.
            let (name, inner) = match first {
                "variants" => (segments[1].0, segments.get(2).map(|(_, range)| path[range.start..].to_owned())),
                _ => (&path[segments[1].1.start..], None),
            };
            if !known.contains(&name) {
                let what = format!("`{first}` has no `{name}`");
                return Err(unknown(1, what, names::suggestion(name, &format!("`{first}` has"), &known)));
            }
            return Ok([owned(&[first, name]), inner.into_iter().collect()].concat());
        }
        "sources" => {
            let sources = keys_of(root.get("sources"));
            let Some(name) = second.filter(|name| sources.iter().any(|s| s == name)) else {
                let names = refs(&sources);
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                let Some(name) = second else {
                    let what = format!("{} changes one source at a time, not all `sources`", scope.describe());
                    let help = format!("e.g. `sources.{}.with.PARAMETER`", names.first().unwrap_or(&"NAME"));
                    return Err(unknown(0, what, Some(help)));
                };
                let what = format!("there is no source `{name}`");
                return Err(unknown(1, what, names::suggestion(name, "sources", &names)));
            };
            let mut keys = owned(&["sources", name]);
            match segments.get(2).map(|(s, _)| *s) {
                None | Some("kind" | "with" | "join") => keys.extend(rest(2)),
                Some(other) => {
                    let what = format!("a source has no `{other}`");
                    let help = format!("did you mean `sources.{name}.with.{other}`?");
                    return Err(unknown(2, what, Some(help)));
                }
            }
            return Ok(keys);
        }
        _ => {}
    }
    let stages = keys_of(root.get("stages"));
    if !stages.iter().any(|stage| stage == first) {
        if first == "stages" {
            let Some((_, rest)) = segments.get(1) else {
                let what = format!("{} changes one node at a time, not all `stages`", scope.describe());
                return Err(unknown(0, what, Some(format!("e.g. `{}`", example(root)))));
            };
            let what = "a path begins with the name of a stage itself".to_owned();
            return Err(unknown(0, what, Some(format!("leave out `stages.`: `{}`", &path[rest.start..]))));
        }
        if names::EXPERIMENT_KEYS.contains(&first) {
            let what = format!("{} cannot change `{first}`", scope.describe());
            let record = if scope == Scope::CommandLine { ", `sources` and `record`" } else { " and `sources`" };
            let help = format!(
                "it changes stages{record}, e.g. `{}`; another experiment that `extends` this one changes all",
                example(root)
            );
            return Err(unknown(0, what, Some(help)));
        }
        let mut names: Vec<&str> = stages.iter().map(String::as_str).collect();
        names.push("sources");
        if scope == Scope::CommandLine {
            names.push("record");
        }
        let help = names::suggestion(first, "a path begins with one of", &names);
        return Err(unknown(0, format!("there is no stage `{first}`"), help));
    }
    let stage = root.get("stages").and_then(|stages| stages.get(first));
    let nodes = keys_of(stage.and_then(|stage| stage.get("nodes")));
    let Some(name) = second else {
        let what = format!("`{first}` is a whole stage: the path ends too early");
        let node = nodes.first().map_or("NODE", String::as_str);
        return Err(unknown(0, what, Some(format!("e.g. `{first}.{node}.with.PARAMETER`"))));
    };
    if nodes.iter().any(|node| node == name) {
        let mut keys = owned(&["stages", first, "nodes", name]);
        match segments.get(2).map(|(s, _)| *s) {
            None | Some("with") => {}
            Some("kind") if segments.len() == 3 => {}
            Some("inputs") if segments.len() <= 4 => {}
            Some("kind" | "inputs") => {
                return Err(unknown(segments.len() - 1, "the path goes too deep".to_owned(), None));
            }
            Some(other) => {
                let what = format!("a node has no `{other}`");
                let near = names::nearest(other, ["kind", "inputs", "with"]);
                let help = match near {
                    Some(near) => format!("did you mean `{first}.{name}.{near}`?"),
                    None => format!("did you mean `{first}.{name}.with.{other}`?"),
                };
                return Err(unknown(2, what, Some(help)));
            }
        }
        keys.extend(rest(2));
        return Ok(keys);
    }
    let score = stage.and_then(|stage| stage.get("score"));
    match (name, score) {
        ("source", _) if segments.len() == 2 => return Ok(owned(&["stages", first, "source"])),
        ("score", Some(score)) => {
            if segments.get(2).is_some_and(|(s, _)| *s == "estimates") {
                let estimates = keys_of(score.get("estimates"));
                if let Some((estimate, _)) = segments.get(3).filter(|(s, _)| !estimates.iter().any(|e| e == s)) {
                    let names: Vec<&str> = estimates.iter().map(String::as_str).collect();
                    let help = names::suggestion(estimate, "estimates", &names);
                    return Err(unknown(3, format!("stage `{first}` has no estimate `{estimate}`"), help));
                }
            }
            let mut keys = owned(&["stages", first]);
            keys.extend(rest(1));
            return Ok(keys);
        }
        _ => {}
    }
    let mut candidates: Vec<&str> = nodes.iter().map(String::as_str).collect();
    candidates.push("source");
    if score.is_some() {
        candidates.push("score");
    }
    let help = match segments.get(2) {
        Some((_, rest)) if name == "nodes" => Some(format!("leave out `nodes.`: `{first}.{}`", &path[rest.start..])),
        _ => names::suggestion(name, "nodes of the stage", &candidates),
    };
    Err(unknown(1, format!("stage `{first}` has no node `{name}`"), help))
}

/// A path that would name something in this experiment.
fn example(root: &Node) -> String {
    let stage = root.get("stages").and_then(|stages| stages.entries().first());
    let node = stage.and_then(|stage| stage.value.get("nodes")?.entries().first());
    let name = |entry: Option<&Entry>, other: &str| entry.map_or_else(|| other.to_owned(), |entry| entry.key.clone());
    format!("{}.{}.with.PARAMETER", name(stage, "STAGE"), name(node, "NODE"))
}

/// As `null` in a file that extends another does.
fn drop_variant(root: &mut Arc<Node>, name: &str) {
    if let Some(variants) = entry_mut(root, "variants")
        && let Tree::Map(entries) = &mut Arc::make_mut(variants).value
    {
        entries.retain(|entry| entry.key != name);
    }
}

fn is_stage(root: &Node, name: &str) -> bool {
    root.get("stages").is_some_and(|stages| stages.get(name).is_some())
}

fn drop_parameters_of_another_kind(root: &mut Arc<Node>, instance: &[String], kind: &Node) {
    let mut node = root;
    for key in instance {
        match entry_mut(node, key) {
            Some(inner) => node = inner,
            None => return,
        }
    }
    let old = node.get("kind").and_then(|kind| kind.scalar_text());
    if old != kind.scalar_text()
        && let Tree::Map(entries) = &mut Arc::make_mut(node).value
    {
        entries.retain(|entry| entry.key != "with");
    }
}

fn set(node: &mut Arc<Node>, keys: &[String], at: usize, change: &Change) -> Result<(), String> {
    let Some(key) = keys.get(at) else {
        let level = if matches!(keys.first().map(String::as_str), Some("sources")) && keys.len() == 2 || keys.len() == 4
        {
            Level::Instance
        } else {
            Level::Plain
        };
        *node = merged(node, &change.value, level);
        return Ok(());
    };
    let last = at + 1 == keys.len();
    let key_place = || match change.path.rfind(key.as_str()) {
        Some(start) if last => change.place.part(&change.path, start..start + key.len()),
        _ => change.place.clone(),
    };
    let inner = Arc::make_mut(node);
    match &mut inner.value {
        Tree::List(items) => {
            let length = items.len();
            match key.parse::<usize>().ok().and_then(|index| items.get_mut(index)) {
                Some(item) => set(item, keys, at + 1, change),
                None => Err(format!("`{key}` is no index of a list of {length}")),
            }
        }
        Tree::Text(from)
            if keys.get(at.wrapping_sub(1)).is_some_and(|_| keys.get(3).is_some_and(|k| k == "estimates")) =>
        {
            // `name: node/port` is short for `name: { from: node/port }`.
            let from = Arc::new(Node::new(Tree::Text(std::mem::take(from)), inner.place.clone()));
            let entry = Entry { key: "from".to_owned(), key_place: inner.place.clone(), value: from };
            inner.value = Tree::Map(vec![entry]);
            set(node, keys, at, change)
        }
        Tree::Null => {
            inner.value = Tree::Map(Vec::new());
            set(node, keys, at, change)
        }
        Tree::Map(entries) => match entries.iter_mut().find(|entry| &entry.key == key) {
            Some(entry) => {
                if last {
                    entry.key_place = key_place();
                }
                set(&mut entry.value, keys, at + 1, change)
            }
            None => {
                let empty = Node::new(Tree::Map(Vec::new()), change.place.clone());
                let mut value = if last { Arc::clone(&change.value) } else { Arc::new(empty) };
                if !last {
                    set(&mut value, keys, at + 1, change)?;
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
