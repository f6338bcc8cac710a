//! The files of a folder that no kind of source recognises.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Serialize;

/// Files of one ending in a folder.
#[derive(JsonSchema, Serialize)]
pub(super) struct Contents {
    pub folder: String,
    pub ending: String,
    pub files: u64,
}

/// The files below a folder by folder and ending, the most first; of the first forty.
pub(super) fn contents(root: &Path) -> Vec<Contents> {
    let mut counts: BTreeMap<(PathBuf, String), u64> = BTreeMap::new();
    let mut folders = vec![(root.to_owned(), 0)];
    let mut left = 100_000_usize;
    while let Some((folder, deep)) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let Some(rest) = left.checked_sub(1) else { break };
            left = rest;
            let Ok(kind) = entry.file_type() else { continue };
            let path = entry.path();
            if kind.is_dir() {
                if deep < 6 {
                    folders.push((path, deep + 1));
                }
                continue;
            }
            let ending =
                path.extension().map_or_else(|| "files".to_owned(), |ending| format!(".{}", ending.to_string_lossy()));
            *counts.entry((folder.clone(), ending)).or_default() += 1;
        }
    }
    let shown = |folder: &Path| match folder.strip_prefix(root) {
        Ok(rest) if rest.as_os_str().is_empty() => "the folder itself".to_owned(),
        Ok(rest) => rest.to_string_lossy().into_owned(),
        Err(_) => folder.to_string_lossy().into_owned(),
    };
    let mut found: Vec<Contents> = counts
        .into_iter()
        .map(|((folder, ending), files)| Contents { folder: shown(&folder), ending, files })
        .collect();
    found.sort_by(|a, b| b.files.cmp(&a.files).then_with(|| (&a.folder, &a.ending).cmp(&(&b.folder, &b.ending))));
    found.truncate(40);
    found
}
