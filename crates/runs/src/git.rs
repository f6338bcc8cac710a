//! The git commit that an experiment's files belong to.
//!
//! Reads the files of `.git` and starts no program: git would run filters and hooks that a repository configures. What
//! cannot be read is unknown, and never an error.

use std::fs;
use std::path::{Path, PathBuf};

use depthloom_graphs::regular_file;
use schemars::JsonSchema;
use serde::Serialize;
use sha1_smol::Sha1;

/// The most bytes that are read of `HEAD`, a reference, `.git` or `commondir`; of `packed-refs`; and of an index.
const MOST_OF_A_NAME: u64 = 4 << 10;
const MOST_OF_REFERENCES: u64 = 32 << 20;
const MOST_OF_AN_INDEX: u64 = 128 << 20;
/// The most folders above an experiment that are searched, and the most references that lead to another one.
const MOST_FOLDERS: usize = 64;
const MOST_REFERENCES: usize = 5;

/// The state of the git repository of an experiment when the run began.
#[derive(Clone, Debug, PartialEq, Eq, JsonSchema, Serialize)]
pub struct GitState {
    /// The hash of the commit that was checked out.
    pub commit: String,
    /// Whether a file of the experiment differs from git's index, or is not in it. Null: unknown. Other files are not
    /// compared.
    pub modified: Option<bool>,
}

/// A work tree and where git stores its state.
struct WorkTree {
    /// The folder that the paths in the index are relative to.
    root: PathBuf,
    /// The folder of `HEAD` and `index`.
    git: PathBuf,
    /// The folder of references that all work trees of a repository share.
    common: PathBuf,
}

impl GitState {
    /// The state of the repository of the first file, given the texts that all files of the experiment had when it was
    /// loaded. `None` if there is no repository, or no commit in it.
    #[must_use]
    pub fn of_files<'a>(files: impl IntoIterator<Item = (&'a Path, &'a str)>) -> Option<Self> {
        let files = files.into_iter().map(|(path, text)| (fs::canonicalize(path).ok(), text));
        let files: Vec<(Option<PathBuf>, &str)> = files.collect();
        let tree = WorkTree::around(files.first()?.0.as_deref()?)?;
        let commit = tree.commit()?;
        let index = (commit.len() == 40).then(|| Index::read(&tree.git.join("index"))).flatten();
        let is_modified = |(path, text): &(Option<PathBuf>, &str)| -> Option<bool> {
            let path = path.as_deref()?.strip_prefix(&tree.root).ok()?;
            let name = path.iter().map(|part| part.to_str()).collect::<Option<Vec<_>>>()?.join("/");
            index.as_ref()?.is_modified(name.as_bytes(), text)
        };
        let states: Vec<Option<bool>> = files.iter().map(is_modified).collect();
        let modified = match states.contains(&Some(true)) {
            true => Some(true),
            false => states.into_iter().collect::<Option<Vec<bool>>>().map(|_| false),
        };
        Some(Self { commit, modified })
    }
}

impl WorkTree {
    /// The innermost work tree that contains a file.
    fn around(file: &Path) -> Option<Self> {
        for root in file.ancestors().skip(1).take(MOST_FOLDERS) {
            let git = root.join(".git");
            // A link is not followed: git writes a folder, or a file that names one.
            let Ok(metadata) = fs::symlink_metadata(&git) else { continue };
            let git = if metadata.is_dir() {
                git
            } else if metadata.is_file() {
                root.join(line(&git)?.strip_prefix("gitdir:")?.trim())
            } else {
                return None;
            };
            let common = line(&git.join("commondir")).map_or_else(|| git.clone(), |common| git.join(common));
            return Some(Self { root: root.to_owned(), git, common });
        }
        None
    }

    /// The hash of the commit that is checked out.
    fn commit(&self) -> Option<String> {
        let mut value = line(&self.git.join("HEAD"))?;
        for _ in 0..MOST_REFERENCES {
            let Some(name) = value.strip_prefix("ref:").map(str::trim) else { return hash(&value) };
            if !is_reference(name) {
                return None;
            }
            // A work tree may have references of its own.
            let loose = [&self.git, &self.common].into_iter().find_map(|folder| line(&folder.join(name)));
            value = loose.or_else(|| self.packed(name))?;
        }
        None
    }

    /// A reference from `packed-refs`.
    fn packed(&self, name: &str) -> Option<String> {
        let bytes = regular_file::read(&self.common.join("packed-refs"), MOST_OF_REFERENCES).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        text.lines().find_map(|line| {
            let (hash, found) = line.split_once(' ')?;
            (found.trim_end() == name).then(|| hash.to_owned())
        })
    }
}

/// The first line of a small file.
fn line(path: &Path) -> Option<String> {
    let text = String::from_utf8(regular_file::read(path, MOST_OF_A_NAME).ok()?).ok()?;
    text.lines().next().map(|line| line.trim().to_owned())
}

/// A hash of SHA-1 or SHA-256, in hexadecimal digits.
fn hash(text: &str) -> Option<String> {
    let is_hash = [40, 64].contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_hash.then(|| text.to_ascii_lowercase())
}

/// Whether a name is that of a file below `refs`.
fn is_reference(name: &str) -> bool {
    let is_part = |part: &str| !part.is_empty() && !part.starts_with('.') && !part.contains(['\\', ':', '\0']);
    name.starts_with("refs/") && name.split('/').all(is_part)
}

/// The names and hashes of an index.
struct Index {
    /// Sorted by name, with the stage of a merge.
    entries: Vec<Entry>,
}

struct Entry {
    name: Vec<u8>,
    hash: [u8; 20],
    is_merged: bool,
}

impl Index {
    /// Reads an index of version 2, 3 or 4. `None` if it cannot be read, or depends on other files.
    fn read(path: &Path) -> Option<Self> {
        Self::parse(&regular_file::read(path, MOST_OF_AN_INDEX).ok()?)
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        // The checksum at the end.
        let mut rest = bytes.get(..bytes.len().checked_sub(20)?)?;
        if take(&mut rest, 4)? != b"DIRC" {
            return None;
        }
        let version = number(&mut rest)?;
        if !(2..=4).contains(&version) {
            return None;
        }
        let count = number(&mut rest)?;
        let mut entries: Vec<Entry> = Vec::new();
        for _ in 0..count {
            let start = rest.len();
            // Times, device, inode, mode, owner, size.
            take(&mut rest, 40)?;
            let hash: [u8; 20] = take(&mut rest, 20)?.try_into().ok()?;
            let flags = u16::from_be_bytes(take(&mut rest, 2)?.try_into().ok()?);
            if version >= 3 && flags & 0x4000 != 0 {
                take(&mut rest, 2)?;
            }
            let name = if version == 4 {
                let before = entries.last().map_or(&[][..], |entry| &entry.name);
                let stays = before.len().checked_sub(offset(&mut rest)?)?;
                [&before[..stays], text(&mut rest)?].concat()
            } else {
                let name = text(&mut rest)?.to_vec();
                // Zeros up to a multiple of eight bytes, of which the name has one.
                let size = start - rest.len();
                take(&mut rest, size.next_multiple_of(8) - size)?;
                name
            };
            entries.push(Entry { name, hash, is_merged: flags & 0x3000 == 0 });
        }
        while !rest.is_empty() {
            let signature = take(&mut rest, 4)?;
            let size = number(&mut rest)?;
            take(&mut rest, size as usize)?;
            // Without knowing such an extension, the entries alone mean nothing: a split or a sparse index.
            if !signature[0].is_ascii_uppercase() {
                return None;
            }
        }
        Some(Self { entries })
    }

    /// Whether a file has another content than in the index, or is not in it; `None` during a merge.
    fn is_modified(&self, name: &[u8], text: &str) -> Option<bool> {
        let mut own = self.entries.iter().filter(|entry| entry.name == name);
        let Some(entry) = own.next() else { return Some(true) };
        if !entry.is_merged {
            return None;
        }
        // As git stores it on systems that end lines differently, and with the byte order mark that loading removes.
        let unix = text.replace("\r\n", "\n");
        let contents = [text, unix.as_str()].map(|text| [text.to_owned(), format!("\u{feff}{text}")]);
        Some(!contents.iter().flatten().any(|content| blob(content) == entry.hash))
    }
}

/// The hash of a file's content.
fn blob(content: &str) -> [u8; 20] {
    let mut sum = Sha1::from(format!("blob {}\0", content.len()));
    sum.update(content.as_bytes());
    sum.digest().bytes()
}

fn take<'a>(rest: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (taken, behind) = rest.split_at_checked(count)?;
    *rest = behind;
    Some(taken)
}

fn number(rest: &mut &[u8]) -> Option<u32> {
    Some(u32::from_be_bytes(take(rest, 4)?.try_into().ok()?))
}

/// The bytes before a zero, which is skipped.
fn text<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let end = rest.iter().position(|byte| *byte == 0)?;
    let name = take(rest, end)?;
    take(rest, 1)?;
    Some(name)
}

/// A number of variable length, as in packs: each continued byte adds one.
fn offset(rest: &mut &[u8]) -> Option<usize> {
    let mut byte = take(rest, 1)?[0];
    let mut value = usize::from(byte & 0x7f);
    while byte & 0x80 != 0 {
        byte = take(rest, 1)?[0];
        value = value.checked_add(1)?.checked_mul(128)?.checked_add(usize::from(byte & 0x7f))?;
    }
    Some(value)
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;
    use std::process::Command;

    use depthloom_test_needs::skipped;

    use super::*;

    const TEXT: &str = "experiment: x\n";

    /// A repository with committed files, made by git; `None` without git.
    struct Repository(tempfile::TempDir);

    impl Repository {
        fn new(test: &str) -> Option<Self> {
            let repository = Self(tempfile::tempdir().unwrap());
            if Command::new("git").arg("--version").output().is_err() {
                skipped(test, "the program git is not installed");
                return None;
            }
            repository.git(["init", "--quiet", "--initial-branch=main"]);
            fs::create_dir(repository.path("deep")).unwrap();
            for name in ["a.yaml", "deep/base.yaml", "deep/other.yaml"] {
                fs::write(repository.path(name), TEXT).unwrap();
            }
            repository.git(["add", "."]);
            repository.git(["commit", "--quiet", "--message=one"]);
            Some(repository)
        }

        fn path(&self, name: &str) -> PathBuf {
            self.0.path().join(name)
        }

        fn git(&self, arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> String {
            let mut command = Command::new("git");
            // No configuration of this machine.
            command.env("GIT_CONFIG_GLOBAL", "/dev/null").env("GIT_CONFIG_SYSTEM", "/dev/null");
            for who in ["AUTHOR", "COMMITTER"] {
                command.env(format!("GIT_{who}_NAME"), "n").env(format!("GIT_{who}_EMAIL"), "n@example.com");
            }
            for variable in ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"] {
                command.env_remove(variable);
            }
            let output = command.arg("-C").arg(self.0.path()).args(arguments).output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            String::from_utf8(output.stdout).unwrap().trim().to_owned()
        }

        fn head(&self) -> String {
            self.git(["rev-parse", "HEAD"])
        }

        /// The state of files with these texts.
        fn state(&self, files: &[(&str, &str)]) -> Option<GitState> {
            let files: Vec<(PathBuf, &str)> = files.iter().map(|(name, text)| (self.path(name), *text)).collect();
            GitState::of_files(files.iter().map(|(path, text)| (path.as_path(), *text)))
        }
    }

    #[test]
    fn the_commit_is_that_of_git_and_files_are_compared_with_the_index() {
        let Some(repository) = Repository::new("the_commit_is_that_of_git_and_files_are_compared_with_the_index")
        else {
            return;
        };
        let state = |modified| Some(GitState { commit: repository.head(), modified: Some(modified) });
        for version in ["2", "3", "4"] {
            repository.git(["update-index", "--index-version", version]);
            assert_eq!(repository.state(&[("a.yaml", TEXT), ("deep/other.yaml", TEXT)]), state(false), "{version}");
            assert_eq!(repository.state(&[("a.yaml", TEXT), ("deep/base.yaml", "x")]), state(true), "{version}");
        }
        assert_eq!(repository.state(&[("a.yaml", "experiment: x\r\n")]), state(false));
        fs::write(repository.path("new.yaml"), TEXT).unwrap();
        assert_eq!(repository.state(&[("new.yaml", TEXT)]), state(true), "not in the index");
        // An entry with extended flags is of version 3 or later.
        repository.git(["add", "--intent-to-add", "new.yaml"]);
        repository.git(["update-index", "--index-version", "3"]);
        assert_eq!(repository.state(&[("deep/other.yaml", TEXT)]), state(false));
        repository.git(["pack-refs", "--all"]);
        assert_eq!(repository.state(&[("a.yaml", TEXT)]), state(false));
        repository.git(["checkout", "--quiet", "--detach"]);
        assert_eq!(repository.state(&[("a.yaml", TEXT)]), state(false));
    }

    #[test]
    fn another_work_tree_has_its_own_commit_and_index() {
        let Some(repository) = Repository::new("another_work_tree_has_its_own_commit_and_index") else { return };
        repository.git(["worktree", "add", "--quiet", "-b", "side/branch", "tree"]);
        fs::write(repository.path("a.yaml"), "changed").unwrap();
        repository.git(["commit", "--quiet", "--all", "--message=two"]);
        let before = repository.git(["rev-parse", "HEAD~1"]);
        let state = |commit: &str, modified| Some(GitState { commit: commit.to_owned(), modified: Some(modified) });
        assert_eq!(repository.state(&[("tree/a.yaml", TEXT)]), state(&before, false));
        assert_eq!(repository.state(&[("a.yaml", TEXT)]), state(&repository.head(), true));
    }

    #[test]
    fn what_cannot_be_read_is_unknown() {
        let Some(repository) = Repository::new("what_cannot_be_read_is_unknown") else { return };
        let unknown = Some(GitState { commit: repository.head(), modified: None });
        let index = repository.path(".git/index");
        let bytes = fs::read(&index).unwrap();
        for length in 0..bytes.len() {
            fs::write(&index, &bytes[..length]).unwrap();
            // An index without its last extension is complete.
            let modified = repository.state(&[("a.yaml", TEXT)]).unwrap().modified;
            assert!(modified == Some(false) || modified.is_none(), "{length} bytes of the index");
        }
        fs::write(&index, &bytes[..bytes.len() / 2]).unwrap();
        assert_eq!(repository.state(&[("a.yaml", TEXT)]), unknown);
        repository.git(["read-tree", "HEAD"]);
        repository.git(["update-index", "--split-index"]);
        assert_eq!(repository.state(&[("a.yaml", TEXT)]), unknown, "an index in two files");
        fs::write(repository.path(".git/HEAD"), "ref: refs/heads/../../HEAD\n").unwrap();
        assert_eq!(repository.state(&[("a.yaml", TEXT)]), None);
        fs::write(repository.path(".git/HEAD"), "ref: refs/heads/none\n").unwrap();
        assert_eq!(repository.state(&[("a.yaml", TEXT)]), None, "no commit yet");
    }

    #[test]
    fn a_file_outside_of_a_repository_has_no_commit() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.yaml");
        assert_eq!(GitState::of_files([(file.as_path(), TEXT)]), None, "a file that does not exist");
        fs::write(&file, TEXT).unwrap();
        fs::write(folder.path().join(".git"), "gitdir: nowhere\n").unwrap();
        assert_eq!(GitState::of_files([(file.as_path(), TEXT)]), None, "a folder that does not exist");
        assert_eq!(GitState::of_files([]), None);
    }
}
