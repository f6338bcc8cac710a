//! Paths in parameters: relative to the folder of their file.
//!
//! Paths from the environment and from `--set` are relative to the working directory, as in any other command.

use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use super::source_file::Place;
use super::tree::Node;

/// The path that a scalar names, from the working directory.
pub(crate) fn located(node: &Node, text: &str) -> PathBuf {
    match &node.written {
        _ if text.is_empty() => PathBuf::new(),
        Some(written) if written.leads => normal(Path::new(text)),
        _ => normal(&node.place.file.folder().join(text)),
    }
}

/// The paths in an experiment, each with the text that leads there from any folder of this machine.
#[derive(Default)]
pub(crate) struct Anywhere(HashMap<(usize, usize), (Place, String)>);

impl Anywhere {
    /// Ignores a path that is absolute or begins with a variable.
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

    pub(crate) fn replacement(&self, place: &Place) -> Option<&str> {
        self.0.get(&Self::key(place)).map(|(_, text)| text.as_str())
    }

    fn key(place: &Place) -> (usize, usize) {
        (Arc::as_ptr(&place.file).addr(), place.span.start)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (&Place, &str)> {
        self.0.values().map(|(place, text)| (place, text.as_str()))
    }
}

/// Removes `.` and `folder/..`, except where `folder` is a symbolic link. An empty result is `.`.
pub(crate) fn normal(path: &Path) -> PathBuf {
    normalized(path, |folder| !folder.is_symlink())
}

pub(super) fn normalized(path: &Path, is_plain: impl Fn(&Path) -> bool) -> PathBuf {
    let mut new = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir
                if matches!(new.components().next_back(), Some(Component::Normal(_))) && is_plain(&new) =>
            {
                new.pop();
            }
            part => new.push(part),
        }
    }
    let is_folder_itself = new.as_os_str().is_empty() && !path.as_os_str().is_empty();
    if is_folder_itself { PathBuf::from(".") } else { new }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::normal;

    #[test]
    fn fault_18_the_folder_itself_is_a_path() {
        for (path, expected) in
            [(".", "."), ("./.", "."), ("a/..", "."), ("", ""), ("./a/./b", "a/b"), ("a/../b", "b"), ("../a", "../a")]
        {
            assert_eq!(normal(Path::new(path)), PathBuf::from(expected), "{path}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn fault_18_a_folder_behind_a_link_is_not_left_by_the_text() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |path: &str| folder.path().join(path);
        std::fs::create_dir_all(at("far/away")).expect("folders");
        std::fs::create_dir(at("plain")).expect("a folder");
        std::os::unix::fs::symlink(at("far/away"), at("link")).expect("a link");
        assert_eq!(normal(&at("link/../data")), at("link/../data"), "which is far/data");
        assert_eq!(normal(&at("plain/../data")), at("data"));
    }
}
