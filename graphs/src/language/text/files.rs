//! Reads an experiment with the files it extends and its graph files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::diagnostics::{Diagnostic, Report};
use super::environment::{Lookup, substitute};
use super::merge::{Level, merged};
use super::names;
use super::parse;
use super::paths::{normal, normalized};
use super::source_file::{Place, SourceFile};
use super::tree::{Node, Tree, entry_mut};
use crate::regular_file;

/// The main file's name in a run folder.
pub(super) const MAIN: &str = "experiment.yaml";
const DEEPEST: usize = 16;
const MOST_FILES: usize = 64;

/// The most values that graph files may add; each use is a copy.
const MOST_PUT_IN: usize = 1_000_000;

pub(crate) struct Files<'a> {
    env: &'a Lookup<'a>,
    read: Vec<ReadFile>,
    texts: Vec<(PathBuf, String)>,
    /// Where a file names another, and the index of that file.
    named: Vec<(Place, usize)>,
    put_in: usize,
    /// A file could not be read: the experiment is incomplete, and other errors would mislead.
    broken: bool,
}

struct ReadFile {
    path: PathBuf,
    file: Arc<SourceFile>,
    /// Path from the main file's folder, for recordings.
    portable: String,
    document: Option<Arc<Node>>,
}

/// A file being read and those that lead to it, to detect circles.
struct Open<'a> {
    identity: PathBuf,
    outer: Option<&'a Self>,
    depth: usize,
}

impl<'a> Files<'a> {
    pub(crate) const fn new(env: &'a Lookup<'a>) -> Self {
        Self { env, read: Vec::new(), texts: Vec::new(), named: Vec::new(), put_in: 0, broken: false }
    }

    /// Uses this text instead of the file's content.
    pub(crate) fn add_text(&mut self, path: &Path, text: &str) {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        self.texts.push((path.to_owned(), text.to_owned()));
    }

    pub(crate) const fn is_broken(&self) -> bool {
        self.broken
    }

    /// The files, each with its own tree if it could be parsed; the main file first.
    pub(crate) fn documents(&self) -> impl Iterator<Item = (&Arc<SourceFile>, Option<&Arc<Node>>)> {
        self.read.iter().map(|read| (&read.file, read.document.as_ref()))
    }

    pub(crate) fn sources(&self) -> Vec<Arc<SourceFile>> {
        self.read.iter().map(|read| Arc::clone(&read.file)).collect()
    }

    pub(crate) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.read.iter().map(|read| read.path.as_path())
    }

    pub(crate) fn named(&self) -> impl Iterator<Item = (&Place, usize)> {
        self.named.iter().map(|(place, target)| (place, *target))
    }

    pub(crate) fn written(&self) -> Vec<(String, String)> {
        self.read.iter().map(|read| (read.portable.clone(), read.file.text.clone())).collect()
    }

    pub(crate) fn key_path(&self, place: &Place) -> Option<String> {
        let read = self.read.iter().find(|read| Arc::ptr_eq(&read.file, &place.file))?;
        read.document.as_ref()?.key_path(place)
    }

    pub(crate) fn experiment(&mut self, path: &Path, report: &mut Report) -> Option<Arc<Node>> {
        let portable = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let main = self.open(path, portable, None, report)?;
        let open = Open { identity: identity(path), outer: None, depth: 0 };
        Some(self.extended(&main, &open, report))
    }

    fn extended(&mut self, document: &Arc<Node>, open: &Open<'_>, report: &mut Report) -> Arc<Node> {
        let own = self.with_graphs(document, open, report);
        let Some(entry) = document.entry("extends") else { return own };
        let own = without(&own, "extends");
        let Some((base, inner)) = self.named_file(&entry.value, "extends", open, report) else {
            self.broken = true;
            return own;
        };
        merged(&self.extended(&base, &inner, report), &own, Level::Experiment)
    }

    /// Replaces `nodes: { graph: file }` of every stage by the nodes of that file.
    fn with_graphs(&mut self, document: &Arc<Node>, open: &Open<'_>, report: &mut Report) -> Arc<Node> {
        let mut new = Arc::clone(document);
        let Some(stages) = document.get("stages") else { return new };
        for (i, stage) in stages.entries().iter().enumerate() {
            let Some(nodes) = stage.value.get("nodes").filter(|nodes| nodes.get("graph").is_some()) else { continue };
            let nodes = self.graph(nodes, open, report);
            let place = entry_mut(&mut new, "stages").and_then(|stages| match &mut Arc::make_mut(stages).value {
                Tree::Map(entries) => entries.get_mut(i),
                _ => None,
            });
            if let Some(place) = place.and_then(|stage| entry_mut(&mut stage.value, "nodes")) {
                *place = nodes;
            }
        }
        new
    }

    fn graph(&mut self, nodes: &Arc<Node>, open: &Open<'_>, report: &mut Report) -> Arc<Node> {
        let Some(entry) = nodes.entry("graph") else { return Arc::clone(nodes) };
        let own = without(nodes, "graph");
        let Some(base) = self.graph_file(&entry.value, open, report) else {
            self.broken = true;
            return own;
        };
        self.put_in = self.put_in.saturating_add(base.size());
        if self.put_in > MOST_PUT_IN {
            let what = format!("the graph files of this experiment have more than {MOST_PUT_IN} values");
            let help = "every use of a graph file counts: use fewer stages, or smaller graph files";
            report.push(Diagnostic::error(&entry.value.place, what).help(help));
            self.broken = true;
            return own;
        }
        merged(&base, &own, Level::Nodes)
    }

    /// The nodes of a graph file.
    fn graph_file(&mut self, name: &Arc<Node>, open: &Open<'_>, report: &mut Report) -> Option<Arc<Node>> {
        let (document, inner) = self.named_file(name, "graph", open, report)?;
        for entry in document.entries().iter().filter(|e| !matches!(e.key.as_str(), "description" | "nodes")) {
            let help = names::renamed_key(entry, &["description"])
                .unwrap_or_else(|| "a graph file has the keys `nodes` and, optionally, `description`".to_owned());
            let error = Diagnostic::error(&entry.key_place, format!("unknown key `{}` in a graph file", entry.key));
            report.push(error.help(help));
        }
        let Some(nodes) = document.get("nodes") else {
            report.push(
                Diagnostic::error(&Place::start_of(&document.place.file), "the graph file has no `nodes`")
                    .help("write `nodes: { NAME: { kind: KIND, inputs: { ... } } }`, as in a stage"),
            );
            return None;
        };
        Some(self.graph(nodes, &inner, report))
    }

    /// Reads the file that a scalar names.
    fn named_file<'o>(
        &mut self,
        name: &Arc<Node>,
        key: &str,
        open: &'o Open<'o>,
        report: &mut Report,
    ) -> Option<(Arc<Node>, Open<'o>)> {
        let name = substitute(name, self.env, report);
        let Some(text) = name.text() else {
            let error = name.not_a(&format!("`{key}`"), "the path of a YAML file");
            report.push(error.help(format!("e.g. `{key}: base.yaml`")));
            return None;
        };
        let folder = match &name.written {
            Some(written) if written.leads => Path::new(""),
            _ => name.place.file.folder(),
        };
        let path = normal(&folder.join(text));
        let inner = Open { identity: identity(&path), outer: Some(open), depth: open.depth + 1 };
        let mut outer = Some(open);
        while let Some(file) = outer {
            if file.identity == inner.identity {
                let what = format!("`{key}` is circular: `{text}` leads back to itself");
                let help = format!("remove this `{key}`, or move what both files need into a third file");
                report.push(Diagnostic::error(&name.place, what).label("closes the circle").help(help));
                return None;
            }
            outer = file.outer;
        }
        if inner.depth > DEEPEST || self.read.len() >= MOST_FILES {
            let what =
                format!("the experiment reads more than {MOST_FILES} files, or more than {DEEPEST} in one chain");
            report.push(Diagnostic::error(&name.place, what).help("merge some of the files"));
            return None;
        }
        let portable = match name.text_with_variables() {
            // Recordings have the name of the variable.
            Some(written) => self.portable_name(&name.place.file, &written.replace("${", "").replace('}', "")),
            None => self.portable_name(&name.place.file, text),
        };
        let document = self.open(&path, portable, Some((&name.place, text)), report)?;
        if let Some(target) = self.read.iter().position(|read| read.path == path) {
            self.named.push((name.place.clone(), target));
        }
        Some((document, inner))
    }

    fn portable_name(&self, from: &Arc<SourceFile>, text: &str) -> String {
        let from = self.read.iter().find(|read| Arc::ptr_eq(&read.file, from));
        let folder = from.map_or("", |read| read.portable.rsplit_once('/').map_or("", |(folder, _)| folder));
        // Only a name in a recording, so links do not matter.
        normalized(&Path::new(folder).join(text), |_| true).to_string_lossy().replace('\\', "/")
    }

    fn open(
        &mut self,
        path: &Path,
        portable: String,
        from: Option<(&Place, &str)>,
        report: &mut Report,
    ) -> Option<Arc<Node>> {
        if let Some(read) = self.read.iter().find(|read| read.path == path) {
            return read.document.clone();
        }
        let folder = path.parent().unwrap_or_else(|| Path::new(""));
        let file = |text: String| Arc::new(SourceFile::new(path.to_string_lossy(), text, folder));
        let given = self.texts.iter().find(|(of, _)| of == path).map(|(_, text)| Ok(text.clone()));
        let text = match given.unwrap_or_else(|| read_text(path)) {
            Ok(text) => text,
            Err(what) => {
                let place = match from {
                    Some((place, _)) => place.clone(),
                    None => Place::start_of(&file(String::new())),
                };
                let error = Diagnostic::error(&place, format!("failed to read `{}`: {what}", path.display()));
                report.push(match from {
                    Some((_, text)) if Path::new(text).is_relative() => {
                        error.help("relative paths start at the folder of the file they are written in")
                    }
                    None if path.join(MAIN).is_file() => {
                        error.help(format!("the experiment of that run is `{}`", path.join(MAIN).display()))
                    }
                    _ => error,
                });
                return None;
            }
        };
        let file = file(text);
        let document = parse::document(&file, report).map(Arc::new);
        self.read.push(ReadFile { path: path.to_owned(), file, portable, document: document.clone() });
        let document = document?;
        if !document.is_map() {
            let what = format!("an experiment is a map, this file holds {}", document.describe());
            let help = "begin with `experiment: NAME`, `sources:` and `stages:`";
            report.push(Diagnostic::error(&document.place, what).help(help));
            return None;
        }
        Some(document)
    }
}

fn read_text(path: &Path) -> Result<String, String> {
    use std::io::ErrorKind;

    let most = parse::MOST_BYTES;
    let bytes = regular_file::read(path, most).map_err(|error| match error.kind() {
        ErrorKind::NotFound => "there is no such file".to_owned(),
        ErrorKind::PermissionDenied => "permission denied".to_owned(),
        ErrorKind::FileTooLarge => format!("it is larger than {} MiB, which no experiment needs", most >> 20),
        _ => error.to_string(),
    })?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        format!("it is not UTF-8 text (at byte {at})")
    })?;
    Ok(text.strip_prefix('\u{feff}').map_or_else(|| text.clone(), ToOwned::to_owned))
}

fn identity(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

fn without(node: &Arc<Node>, key: &str) -> Arc<Node> {
    let mut new = Arc::clone(node);
    if let Tree::Map(entries) = &mut Arc::make_mut(&mut new).value {
        entries.retain(|entry| entry.key != key);
    }
    new
}
