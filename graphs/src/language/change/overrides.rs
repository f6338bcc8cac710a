//! `--set path=value` and `--variant name` on the command line.

use std::path::Path;
use std::sync::Arc;

use super::apply::Change;
use crate::language::text::diagnostics::Report;
use crate::language::text::parse;
use crate::language::text::source_file::{Place, SourceFile};
use crate::language::text::tree::{Entry, Node, Tree};

/// The name that arguments have among files.
pub(crate) const NAME: &str = "--set";
/// The name that the names of variants have there.
pub(crate) const ONLY: &str = "--variant";

/// An argument as a file that holds all of it.
pub(crate) fn argument(path: &str, value: &str) -> SourceFile {
    SourceFile::new(NAME, format!("{path}={value}"), Path::new(""))
}

/// The changes asked for; values are YAML, so that `frames=[3, 7]` is a list and `view=true` a truth value.
///
/// Relative paths in them start at the working directory: that is where they were typed.
pub(crate) fn changes(set: &[(String, String)], report: &mut Report) -> (Vec<Change>, Vec<Arc<SourceFile>>) {
    let (mut changes, mut files) = (Vec::new(), Vec::new());
    for (path, value) in set {
        // One file holds the whole argument, and one padded alike the value alone: equal offsets.
        let file = Arc::new(argument(path, value));
        let start = path.len() + 1;
        let place = Place::new(&file, &(0..path.len()));
        let padded = Arc::new(SourceFile::new(NAME, format!("{}{value}", " ".repeat(start)), Path::new("")));
        let whole = Place::new(&file, &(start..start + value.len()));
        let value = if value.contains('\n') {
            Some(Node::new(Tree::Text(value.clone()), whole))
        } else if value.trim().is_empty() {
            Some(Node::new(Tree::Null, whole))
        } else {
            let before = report.len();
            let node = parse::document(&padded, report);
            for diagnostic in report.since(before) {
                diagnostic.file = Arc::clone(&file);
                if let Some(related) = &mut diagnostic.related {
                    related.file = Arc::clone(&file);
                }
            }
            node.map(|node| moved(node, &file))
        };
        files.push(file);
        if let Some(value) = value {
            changes.push(Change { path: path.clone(), place, value: Arc::new(value) });
        }
    }
    (changes, files)
}

/// The same tree with its places in another file of equal offsets.
fn moved(node: Node, file: &Arc<SourceFile>) -> Node {
    let place = Place::new(file, &node.place.span);
    let value = match node.value {
        Tree::List(items) => {
            Tree::List(items.into_iter().map(|item| Arc::new(moved(Arc::unwrap_or_clone(item), file))).collect())
        }
        Tree::Map(mut entries) => {
            for entry in &mut entries {
                entry.key_place = Place::new(file, &entry.key_place.span);
                entry.value = Arc::new(moved((*entry.value).clone(), file));
            }
            Tree::Map(entries)
        }
        scalar => scalar,
    };
    Node { value, place, written: node.written }
}

/// What `only` is to be, of the names given to `--variant`; nothing where there are none.
pub(crate) fn only(names: &[String]) -> (Option<Node>, Vec<Arc<SourceFile>>) {
    let file = |name: &String| Arc::new(SourceFile::new(ONLY, name.clone(), Path::new("")));
    let files: Vec<Arc<SourceFile>> = names.iter().map(file).collect();
    let item = |file: &Arc<SourceFile>| Arc::new(Node::new(Tree::Text(file.text.clone()), Place::whole(file)));
    let only = files.first().map(|first| Node::new(Tree::List(files.iter().map(item).collect()), Place::whole(first)));
    (only, files)
}

/// Puts `only` into an experiment, in the place of its own.
pub(crate) fn choose(root: &mut Arc<Node>, only: &Node) {
    let value = Arc::new(only.clone());
    let Tree::Map(entries) = &mut Arc::make_mut(root).value else { return };
    entries.retain(|entry| entry.key != "only");
    entries.push(Entry { key: "only".to_owned(), key_place: only.place.clone(), value });
}

/// The arguments as they were typed, with their options.
pub(crate) fn typed(set: &[(String, String)], only: Option<&Node>) -> Vec<(&'static str, String)> {
    let set = set.iter().map(|(path, value)| (NAME, format!("{path}={value}")));
    let only = match only.map(|only| &only.value) {
        Some(Tree::List(names)) => names.as_slice(),
        _ => &[],
    };
    set.chain(only.iter().filter_map(|name| Some((ONLY, name.text()?.to_owned())))).collect()
}
