//! An experiment in an editor: its trees and what its names mean, also where it has errors.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value as Json;

use super::change::parameter::Parameters;
use super::change::path::{self, Scope};
use super::check::with_schema;
use super::text::diagnostics::Report;
use super::text::environment;
use super::text::files::Files;
use super::text::paths::Anywhere;
use super::text::source_file::{Place, SourceFile};
use super::text::tree::Node;
use crate::registry::Registry;

/// The parameters of a node or source as its kind reads them: paths lead from the working directory.
pub fn parameters(instance: &Node, schema: &Json) -> Json {
    let with = instance.get("with").filter(|with| with.is_map());
    let located = with.map(|with| with_schema::parameters(with, schema, &mut Anywhere::default()));
    located.unwrap_or_else(|| Json::Object(serde_json::Map::new()))
}

/// An experiment file with the files that it extends and its graph files.
#[derive(Clone, Debug, Default)]
pub struct Document {
    /// The experiment with `extends`, graph files and the environment applied; `None` if its file is not YAML.
    pub merged: Option<Arc<Node>>,
    /// The files, each with its own tree if it is YAML; the file itself first.
    pub files: Vec<(Arc<SourceFile>, Option<Arc<Node>>)>,
}

impl Document {
    /// Reads an experiment as far as it can be read. `open_texts` replace files on disk, by path.
    pub fn read(path: &Path, open_texts: &[(PathBuf, String)], env: &dyn Fn(&str) -> Option<String>) -> Self {
        let mut report = Report::default();
        let mut files = Files::new(env);
        open_texts.iter().for_each(|(path, text)| files.add_text(path, text));
        let merged = files.experiment(path, &mut report);
        let merged = merged.map(|merged| environment::substitute(&merged, env, &mut report));
        let files = files.documents().map(|(file, tree)| (Arc::clone(file), tree.cloned())).collect();
        Self { merged, files }
    }

    /// The file's own tree.
    pub fn own(&self) -> Option<&Arc<Node>> {
        self.files.first().and_then(|(_, tree)| tree.as_ref())
    }

    /// The keys from the root to the value that a variant changes with this path.
    pub fn keys_of_change(&self, path: &str) -> Option<Vec<String>> {
        path::located(self.merged.as_ref()?, path, Scope::Variant).ok()
    }

    /// The schema of the parameter that a variant changes with this path.
    pub fn schema_of_change<'a>(&'a self, path: &str, registry: &'a Registry) -> Option<&'a Json> {
        let root = self.merged.as_ref()?;
        Parameters { root, registry }.schema(path)
    }

    /// The entries of all files whose value has this place within it, from the outermost to the innermost, each with
    /// its key and the place of its key.
    pub fn keys_around(&self, place: &Place) -> Vec<(String, Place)> {
        let tree = self.files.iter().find(|(file, _)| place.is_in(file)).and_then(|(_, tree)| tree.as_ref());
        let mut found = Vec::new();
        let mut node = tree;
        while let Some(inner) = node {
            let entry = inner
                .entries()
                .iter()
                .find(|entry| entry.key_place.contains(place) || entry.value.place.contains(place));
            node = entry.map(|entry| &entry.value);
            found.extend(entry.map(|entry| (entry.key.clone(), entry.key_place.clone())));
        }
        found
    }
}
