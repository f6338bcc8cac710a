//! Paths in parameters: a relative path starts at the folder of the file it is written in.
//!
//! Two exceptions, where the path stands in no file: what comes out of the environment and what `--set` gives start at the working
//! directory, as they would in any other command.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::files::normal;
use super::source_file::Place;
use super::tree::Node;

/// The path a scalar names, from the working directory.
pub(crate) fn located(node: &Node, text: &str) -> PathBuf {
    match &node.written {
        _ if text.is_empty() => PathBuf::new(),
        Some(written) if written.leads => normal(Path::new(text)),
        _ => normal(&node.place.file.folder().join(text)),
    }
}

/// Where in its files an experiment names paths, each with the text that leads there from any folder of this machine.
#[derive(Default)]
pub(crate) struct Anywhere(HashMap<(usize, usize), (Place, String)>);

impl Anywhere {
    /// Remembers a path, unless its text leads there from anywhere already: it is absolute, or begins with a variable.
    pub(crate) fn add(&mut self, node: &Node, text: &str) {
        let written = match &node.written {
            Some(written) if written.leads => return,
            Some(written) => written.text.as_str(),
            None => text,
        };
        if text.is_empty() || Path::new(text).is_absolute() {
            return;
        }
        let folder = std::path::absolute(node.place.file.folder().join("."));
        if let Some(folder) = folder.ok().as_deref().and_then(Path::to_str) {
            let folder = folder.trim_end_matches('/').replace("${", "$${");
            let place = node.place.clone();
            self.0.insert(Self::key(&place), (place, format!("{folder}/{written}")));
        }
    }

    /// The text for what stands at a place.
    pub(crate) fn of(&self, place: &Place) -> Option<&str> {
        self.0.get(&Self::key(place)).map(|(_, text)| text.as_str())
    }

    /// The file, which the place keeps where it is, and the offset in it.
    fn key(place: &Place) -> (usize, usize) {
        (Arc::as_ptr(&place.file).addr(), place.span.start)
    }

    /// All places with their texts.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&Place, &str)> {
        self.0.values().map(|(place, text)| (place, text.as_str()))
    }
}
