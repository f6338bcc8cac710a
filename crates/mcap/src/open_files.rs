//! Many files of which only some are open.

use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::SystemTime;

use depthloom_graphs::regular_file;
use depthloom_threads::locked;

/// A file while it is open.
type Slot = Arc<Mutex<Option<Arc<File>>>>;

/// Files that are opened when they are read. A limited number stays open, and the one that was opened first is closed
/// first.
#[derive(Debug)]
pub struct OpenFiles {
    most: usize,
    open: Mutex<VecDeque<Slot>>,
}

impl OpenFiles {
    /// No files yet, of which at most `most` will stay open. A thread that reads has one more open.
    #[must_use]
    pub const fn new(most: usize) -> Self {
        Self { most, open: Mutex::new(VecDeque::new()) }
    }

    /// Keeps a file open, and closes another one if too many are open.
    fn keep(&self, file: &Slot) {
        let closed = {
            let mut open = locked(&self.open);
            open.push_back(Arc::clone(file));
            if open.len() > self.most { open.pop_front() } else { None }
        };
        if let Some(closed) = closed {
            locked(&closed).take();
        }
    }
}

/// One of many files: open or not, but always the same file.
#[derive(Debug)]
pub(crate) struct FileOnDemand {
    files: Arc<OpenFiles>,
    identity: Identity,
    /// Where the file is if it is no longer at its path.
    moved: Option<PathBuf>,
    file: Slot,
}

impl FileOnDemand {
    pub(crate) fn new(file: File, files: &Arc<OpenFiles>, moved: Option<PathBuf>) -> io::Result<Self> {
        let identity = identity(&file)?;
        let file = Arc::new(Mutex::new(Some(Arc::new(file))));
        files.keep(&file);
        Ok(Self { files: Arc::clone(files), identity, moved, file })
    }

    /// The file, opened if it is closed.
    pub(crate) fn get(&self, path: &Path) -> io::Result<Arc<File>> {
        if let Some(file) = &*locked(&self.file) {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(self.reopen(path)?);
        let is_first = {
            let mut slot = locked(&self.file);
            let is_first = slot.is_none();
            slot.get_or_insert_with(|| Arc::clone(&file));
            is_first
        };
        // Otherwise another thread has opened it meanwhile.
        if is_first {
            self.files.keep(&self.file);
        }
        Ok(file)
    }

    fn reopen(&self, path: &Path) -> io::Result<File> {
        let mut failure = None;
        for path in std::iter::once(path).chain(self.moved.as_deref()) {
            match regular_file::open(path).and_then(|file| Ok((identity(&file)?, file))) {
                Ok((found, file)) if found == self.identity => return Ok(file),
                Ok(_) => {}
                Err(error) => failure = failure.or(Some(error)),
            }
        }
        Err(failure.unwrap_or_else(|| io::Error::new(io::ErrorKind::NotFound, "another file has replaced it")))
    }
}

/// What differs between two files that one path has had: number of the file system and of the file, and the time of
/// creation, because numbers are used again.
type Identity = ((u64, u64), Option<SystemTime>);

fn identity(file: &File) -> io::Result<Identity> {
    let metadata = file.metadata()?;
    #[cfg(unix)]
    let numbers = (std::os::unix::fs::MetadataExt::dev(&metadata), std::os::unix::fs::MetadataExt::ino(&metadata));
    #[cfg(not(unix))]
    let numbers = (0, 0);
    Ok((numbers, metadata.created().ok()))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::fs;
    use std::path::Path;
    use std::sync::Arc;

    use super::OpenFiles;
    use crate::PositionedFile;

    fn open_in(folder: &Path) -> usize {
        let all = fs::read_dir("/proc/self/fd").expect("a Linux").flatten();
        all.filter(|file| fs::read_link(file.path()).is_ok_and(|path| path.starts_with(folder))).count()
    }

    fn read(file: &PositionedFile) -> Result<[u8; 3], crate::FileError> {
        let mut bytes = [0; 3];
        file.read_exact(&mut bytes, 0).map(|()| bytes)
    }

    #[test]
    fn few_of_many_files_are_open_and_each_can_be_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |number: usize| folder.path().join(format!("{number:03}"));
        let files = Arc::new(OpenFiles::new(5));
        let all: Vec<PositionedFile> = (0..100)
            .map(|number| {
                fs::write(path(number), format!("{number:03}")).expect("written");
                PositionedFile::open_on_demand(&path(number), &files, None).expect("opened")
            })
            .collect();
        assert_eq!(open_in(folder.path()), 5);
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let all = &all;
                scope.spawn(move || {
                    for turn in 0..1000 {
                        let number = (turn * 37 + thread * turn) % 100;
                        assert_eq!(read(&all[number]).expect("read"), format!("{number:03}").as_bytes());
                    }
                });
            }
        });
        assert_eq!(open_in(folder.path()), 5);
    }

    #[test]
    fn a_closed_file_that_was_moved_or_replaced_is_never_another_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        for name in ["moved", "replaced", "removed", "other"] {
            fs::write(path(name), "old").expect("written");
        }
        let files = Arc::new(OpenFiles::new(1));
        let open = |name: &str| PositionedFile::open_on_demand(&path(name), &files, Some(path("new"))).expect("opened");
        let [moved, replaced, removed, _other] = ["moved", "replaced", "removed", "other"].map(open);
        fs::rename(path("moved"), path("new")).expect("renamed");
        fs::rename(path("replaced"), path("kept")).expect("renamed");
        fs::write(path("replaced"), "new").expect("written");
        fs::remove_file(path("removed")).expect("removed");
        assert_eq!(&read(&moved).expect("the moved file"), b"old");
        for missing in [replaced, removed] {
            let error = read(&missing).expect_err("another file");
            assert!(error.to_string().starts_with("failed to read "), "{error}");
        }
    }
}
