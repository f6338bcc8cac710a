//! Every parser of untrusted bytes, as a function of bytes.
//!
//! A [`Target`] is a file that a user may give to depthloom, with valid other files where it needs some. Whatever its
//! bytes are, it is read or refused with a message. Targets use public interfaces: a file of a data set is opened,
//! keyed and read through its source as the runner does it. `tests/parsers.rs` runs all targets over their seeds, over
//! earlier findings (`found/`) and over mutations of both; `fuzz/` passes them to cargo-fuzz.

mod arrow;
mod bags;
mod experiment;
mod files;
mod onnx;
mod recordings;
mod sources;

use std::path::Path;

/// Reads bytes as a file in a folder, or says why not.
type Read = dyn Fn(&[u8], &Path) -> Result<(), String>;

/// A parser and what it is given.
pub struct Target {
    /// Its name: of the fuzz target, and of the folder of what was found.
    pub name: &'static str,
    /// Valid inputs to begin from.
    pub seeds: Vec<Vec<u8>>,
    read: Box<Read>,
}

impl Target {
    fn new(
        name: &'static str,
        seeds: Vec<Vec<u8>>,
        read: impl Fn(&[u8], &Path) -> Result<(), String> + 'static,
    ) -> Self {
        Self { name, seeds, read: Box::new(read) }
    }
}

/// A target with a folder of its own to lay files in.
pub struct Reader {
    target: Target,
    folder: tempfile::TempDir,
}

impl Reader {
    /// The target of that name.
    ///
    /// # Panics
    /// If there is no such target, or no folder can be created.
    #[must_use]
    pub fn from_name(name: &str) -> Self {
        let target = targets().into_iter().find(|target| target.name == name);
        Self::new(target.unwrap_or_else(|| panic!("there is no target {name}")))
    }

    /// A reader of a target.
    ///
    /// # Panics
    /// If no folder can be made.
    #[must_use]
    pub fn new(target: Target) -> Self {
        // In memory where there is such a folder: thousands of files a second are written.
        let memory = Path::new("/dev/shm");
        let folder = tempfile::tempdir_in(memory).or_else(|_| tempfile::tempdir()).expect("a folder can be made");
        Self { target, folder }
    }

    /// What it reads.
    #[must_use]
    pub const fn target(&self) -> &Target {
        &self.target
    }

    /// Reads bytes as that file.
    ///
    /// # Errors
    /// Why they are refused, in words.
    ///
    /// # Panics
    /// If they are refused without a word; and if the parser panics.
    pub fn read(&self, bytes: &[u8]) -> Result<(), String> {
        let read = (self.target.read)(bytes, self.folder.path());
        if let Err(why) = &read {
            assert!(!why.trim().is_empty(), "refused without a word");
        }
        read
    }
}

/// All of them.
#[must_use]
pub fn targets() -> Vec<Target> {
    let mut targets = sources::targets();
    targets.extend(bags::targets());
    targets.push(arrow::target());
    targets.push(experiment::target());
    targets.push(onnx::target());
    targets.push(recordings::target());
    targets
}
