//! Files that determine what a program computes.

use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Fault;
use crate::key::Key;
use crate::language::glob;
use crate::regular_file;

/// A file, a folder (all files below it) or a pattern (`lib/*.py`, `lib/**/*.py`) whose content enters cache keys.
/// Folders `__pycache__` and hidden names are left out. Relative to the folder of the YAML file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct CodePath(pub PathBuf);

const MOST_FILES: usize = 10_000;
const MOST_DEPTH: usize = 64;

impl CodePath {
    /// The path or pattern.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The files, sorted.
    ///
    /// # Errors
    /// If there is no such file, a folder cannot be read, or a pattern or folder has no file.
    pub fn files(&self) -> Result<Vec<PathBuf>, Fault> {
        let path = &self.0;
        let found = match path.metadata() {
            Ok(metadata) if metadata.is_file() => return Ok(vec![path.clone()]),
            Ok(metadata) if metadata.is_dir() => {
                let mut found = Vec::new();
                walk(path, 0, &mut found).map(|()| found)
            }
            Ok(_) => return Err(named(path, ", which is not a regular file")),
            Err(_) if is_pattern(path) => expand(path),
            Err(error) => return Err(named(path, &format!(": {error}"))),
        };
        let mut files = found.map_err(|what| named(path, &format!(": {what}")))?;
        files.sort_unstable();
        files.dedup();
        match files.len() {
            0 if is_pattern(path) => Err(named(path, ", which matches no file")),
            0 => Err(named(path, ", a folder without files")),
            count if count > MOST_FILES => Err(named(path, &format!(", which has more than {MOST_FILES} files"))),
            _ => Ok(files),
        }
    }

    /// A hash of the content: of a file its bytes; otherwise names and bytes of all files.
    ///
    /// # Errors
    /// As [`CodePath::files`], or the file that cannot be read.
    pub fn content(&self) -> Result<Key, Fault> {
        let hash = |file: &Path| {
            let hash = regular_file::open(file).and_then(Key::of_reader);
            hash.map_err(|error| {
                Fault::new(format!("failed to read {}, which `code` names", file.display())).because(error)
            })
        };
        let files = self.files()?;
        if let [only] = files.as_slice()
            && *only == self.0
        {
            return hash(only);
        }
        let folder = literal_folder(&self.0);
        let mut key = Key::build("code").number(files.len() as u64);
        for file in &files {
            let name = file.strip_prefix(&folder).unwrap_or(file);
            key = key.text(&name.to_string_lossy()).key(&hash(file)?);
        }
        Ok(key.finish())
    }
}

inline_schema!(CodePath, { "type": "string", "format": "code" });

fn named(path: &Path, what: &str) -> Fault {
    Fault::new(format!("`code` names {}{what}", path.display()))
        .remedy("`code` takes files, folders and patterns (`lib/*.py`); or declare a `version`")
}

fn is_pattern(path: &Path) -> bool {
    path.to_string_lossy().contains('*')
}

fn literal_folder(path: &Path) -> PathBuf {
    path.components().take_while(|part| !part.as_os_str().to_string_lossy().contains('*')).collect()
}

fn entries(folder: &Path) -> Result<Vec<(String, PathBuf)>, String> {
    let unread = |error: std::io::Error| format!("failed to read the folder {}: {error}", folder.display());
    let folder_or_here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder_or_here).map_err(unread)? {
        let name = entry.map_err(unread)?.file_name();
        let text = name.to_string_lossy().into_owned();
        if !text.starts_with('.') && text != "__pycache__" {
            entries.push((text, folder.join(name)));
        }
    }
    Ok(entries)
}

fn walk(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<(), String> {
    if depth > MOST_DEPTH {
        return Err(format!("{} is nested more than {MOST_DEPTH} folders deep", folder.display()));
    }
    for (_, path) in entries(folder)? {
        if path.is_dir() {
            walk(&path, depth + 1, found)?;
        } else if path.is_file() {
            found.push(path);
        }
        if found.len() > MOST_FILES {
            break;
        }
    }
    Ok(())
}

fn expand(pattern: &Path) -> Result<Vec<PathBuf>, String> {
    let mut folders = vec![PathBuf::new()];
    let parts: Vec<Component<'_>> = pattern.components().collect();
    for (at, part) in parts.iter().enumerate() {
        let text = part.as_os_str().to_string_lossy();
        let mut next = Vec::new();
        for folder in &folders {
            if text == "**" {
                below(folder, 0, &mut next)?;
            } else if text.contains('*') {
                let matching = entries(folder)?.into_iter().filter(|(name, _)| glob(&text, name));
                next.extend(matching.map(|(_, path)| path));
            } else {
                next.push(folder.join(part));
            }
        }
        let is_last = at + 1 == parts.len();
        if text.contains('*') {
            next.retain(|path| if is_last && text != "**" { path.is_file() } else { path.is_dir() });
        }
        folders = next;
        if folders.len() > MOST_FILES {
            break;
        }
    }
    let mut files = Vec::new();
    for path in folders {
        if path.is_dir() {
            walk(&path, 0, &mut files)?;
        } else if path.is_file() {
            files.push(path);
        }
    }
    Ok(files)
}

fn below(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<(), String> {
    found.push(folder.to_owned());
    if depth > MOST_DEPTH || found.len() > MOST_FILES {
        return Err(format!("{} has too many folders", folder.display()));
    }
    for (_, path) in entries(folder)? {
        if path.is_dir() {
            below(&path, depth + 1, found)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::CodePath;

    fn names(root: &Path, code: &str) -> Result<Vec<String>, String> {
        let files = CodePath(root.join(code)).files().map_err(|fault| fault.to_string())?;
        let name = |file: &std::path::PathBuf| file.strip_prefix(root).expect("in it").to_string_lossy().into_owned();
        Ok(files.iter().map(name).collect())
    }

    #[test]
    fn files_folders_and_patterns_stand_for_sorted_files_without_caches_and_hidden_ones() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path();
        for file in ["lib/b.py", "lib/a.py", "lib/deep/c.py", "lib/__pycache__/a.pyc", "lib/.hidden.py", "lib/n.txt"] {
            let path = root.join(file);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            std::fs::write(path, file).expect("written");
        }
        let is = |code: &str, expected: &[&str]| assert_eq!(names(root, code).expect("found"), expected, "{code}");
        is("lib/b.py", &["lib/b.py"]);
        is("lib", &["lib/a.py", "lib/b.py", "lib/deep/c.py", "lib/n.txt"]);
        is("lib/*.py", &["lib/a.py", "lib/b.py"]);
        is("lib/**/*.py", &["lib/a.py", "lib/b.py", "lib/deep/c.py"]);
        is("*/a.*", &["lib/a.py"]);
        for (code, part) in [("lib/*.rs", "matches no file"), ("lib/x.py", "lib/x.py"), ("lib/x/*.py", "lib/x")] {
            let error = names(root, code).expect_err(code);
            assert!(error.contains(part), "{code}: {error}");
        }
        let hash = |code: &str| CodePath(root.join(code)).content().expect("hashed");
        let (all, some) = (hash("lib"), hash("lib/*.py"));
        std::fs::write(root.join("lib/__pycache__/a.pyc"), "other").expect("written");
        assert_eq!((all, some), (hash("lib"), hash("lib/*.py")));
        std::fs::rename(root.join("lib/b.py"), root.join("lib/d.py")).expect("renamed");
        assert!(all != hash("lib") && some != hash("lib/*.py"));
        assert_eq!(hash("lib/a.py"), crate::Key::of_content(b"lib/a.py"));
    }
}
