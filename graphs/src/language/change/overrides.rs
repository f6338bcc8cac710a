//! `--set path=value`, `--matrix path=[values]` and `--variant name` on the command line.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::apply::Change;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::parse;
use crate::language::text::source_file::{Place, SourceFile};
use crate::language::text::tree::{Entry, Node, Tree};

pub(crate) const SET: &str = "--set";
const MATRIX: &str = "--matrix";
pub(crate) const ONLY: &str = "--variant";

#[derive(Clone, Debug)]
pub(crate) struct Argument {
    option: &'static str,
    path: String,
    value: String,
}

impl Argument {
    pub(crate) fn all(set: &[(String, String)], matrix: &[(String, String)]) -> Vec<Self> {
        let options =
            set.iter().map(|argument| (SET, argument)).chain(matrix.iter().map(|argument| (MATRIX, argument)));
        options.map(|(option, (path, value))| Self { option, path: path.clone(), value: value.clone() }).collect()
    }

    pub(crate) fn file(&self) -> SourceFile {
        SourceFile::new(self.option, format!("{}={}", self.path, self.value), Path::new(""))
    }

    fn changed(&self) -> String {
        if self.option == MATRIX { format!("matrix.{}", self.path) } else { self.path.clone() }
    }
}

pub(crate) fn is_argument(file: &SourceFile) -> bool {
    [SET, MATRIX].contains(&file.name.as_str())
}

pub(crate) fn changes(arguments: &[Argument], report: &mut Report) -> (Vec<Change>, Vec<Arc<SourceFile>>) {
    let (mut changes, mut files) = (Vec::new(), Vec::new());
    let mut axes: HashMap<String, (&str, Place)> = HashMap::new();
    for argument in arguments {
        let Argument { option, path, value } = argument;
        // The value is parsed from a padded copy of the argument, so that its offsets are those of the argument.
        let file = Arc::new(argument.file());
        let start = path.len() + 1;
        let place = Place::new(&file, &(0..path.len()));
        let padded = Arc::new(SourceFile::new(*option, format!("{}{value}", " ".repeat(start)), Path::new("")));
        let whole = Place::new(&file, &(start..start + value.len()));
        if *option == MATRIX && value.trim().is_empty() {
            report.push(
                Diagnostic::error(&place, format!("`--matrix {path}=` has no values"))
                    .label("takes nothing")
                    .help(format!("write them in brackets: `--matrix '{path}=[3, 5]'`")),
            );
            files.push(file);
            continue;
        }
        let changed = argument.changed();
        if changed.starts_with("matrix.")
            && let Some((other, first)) = axes.insert(changed.clone(), (option, place.clone()))
            && [*option, other].contains(&MATRIX)
        {
            report.push(
                Diagnostic::error(&place, format!("the values of `{path}` are given twice"))
                    .label("given again")
                    .help("give all values at once, e.g. `[3, 5, 9]`")
                    .related(&first, "first here"),
            );
        }
        let value = if value.contains('\n') {
            Some(Node::new(Tree::Text(value.clone()), whole))
        } else if value.trim().is_empty() {
            Some(Node::new(Tree::Null, whole))
        } else {
            let before = report.len();
            let node = parse::document(&padded, report);
            for diagnostic in report.since(before) {
                diagnostic.place.file = Arc::clone(&file);
                if let Some(related) = &mut diagnostic.related {
                    related.place.file = Arc::clone(&file);
                }
            }
            node.map(|node| moved(node, &file))
        };
        files.push(file);
        if let Some(value) = value {
            changes.push(Change { path: changed, place, value: Arc::new(value) });
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

pub(crate) fn only(names: &[String]) -> (Option<Node>, Vec<Arc<SourceFile>>) {
    let file = |name: &String| Arc::new(SourceFile::new(ONLY, name.clone(), Path::new("")));
    let files: Vec<Arc<SourceFile>> = names.iter().map(file).collect();
    let item = |file: &Arc<SourceFile>| Arc::new(Node::new(Tree::Text(file.text.clone()), Place::whole(file)));
    let only = files.first().map(|first| Node::new(Tree::List(files.iter().map(item).collect()), Place::whole(first)));
    (only, files)
}

pub(crate) fn choose(root: &mut Arc<Node>, only: &Node) {
    let value = Arc::new(only.clone());
    let Tree::Map(entries) = &mut Arc::make_mut(root).value else { return };
    entries.retain(|entry| entry.key != "only");
    entries.push(Entry { key: "only".to_owned(), key_place: only.place.clone(), value });
}

pub(crate) fn typed(arguments: &[Argument], only: Option<&Node>) -> Vec<(&'static str, String)> {
    let set = arguments.iter().map(|argument| (argument.option, argument.file().text));
    let only = match only.map(|only| &only.value) {
        Some(Tree::List(names)) => names.as_slice(),
        _ => &[],
    };
    set.chain(only.iter().filter_map(|name| Some((ONLY, name.text()?.to_owned())))).collect()
}
