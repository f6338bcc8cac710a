//! What lies in a folder that no kind knows.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The files below a folder by folder and ending, the most first; of the first forty.
pub fn contents(root: &Path) -> Vec<(String, String, usize)> {
    let mut counts: BTreeMap<(PathBuf, String), usize> = BTreeMap::new();
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
    let mut found: Vec<_> =
        counts.into_iter().map(|((folder, ending), count)| (shown(&folder), ending, count)).collect();
    found.sort_by(|a, b| b.2.cmp(&a.2).then_with(|| a.cmp(b)));
    found.truncate(40);
    found
}
