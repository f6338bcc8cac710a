//! Recognises a run's folder by the marker file in it. Only such a folder is ever replaced.

use std::fs;
use std::io;
use std::path::Path;

use crate::files::MARKER;

/// What exists at a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathState {
    /// Nothing.
    Nothing,
    /// A run's folder, finished or still being written.
    Run,
    /// An empty folder.
    Empty,
    /// Something else, in words.
    Other(&'static str),
}

impl PathState {
    /// Examines a path; symbolic links are not followed.
    ///
    /// # Errors
    /// The error of the system.
    pub fn at(path: &Path) -> io::Result<Self> {
        let kind = match fs::symlink_metadata(path) {
            Ok(metadata) => metadata.file_type(),
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::Nothing),
            Err(error) => return Err(error),
        };
        Ok(match () {
            () if kind.is_symlink() => Self::Other("a symbolic link"),
            () if kind.is_file() => Self::Other("a file"),
            () if !kind.is_dir() => Self::Other("neither file nor folder"),
            () if has_file(path, MARKER) || is_of_0_1_0(path) => Self::Run,
            () if fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none()) => Self::Empty,
            () => Self::Other("a folder, but not of a run"),
        })
    }
}

/// Whether it is a complete run's folder of version 0.1.0: without a marker, but with both of these files.
pub(super) fn is_of_0_1_0(folder: &Path) -> bool {
    has_file(folder, "recording.mcap") && has_file(folder, "experiment.resolved.yaml")
}

fn has_file(folder: &Path, name: &str) -> bool {
    fs::symlink_metadata(folder.join(name)).is_ok_and(|metadata| metadata.is_file())
}

#[cfg(test)]
mod tests {
    use super::{MARKER, PathState};
    use std::fs;

    #[test]
    fn only_a_marked_folder_or_one_of_0_1_0_is_a_run() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        assert_eq!(PathState::at(&path).unwrap(), PathState::Nothing);
        fs::create_dir(&path).unwrap();
        fs::write(path.join("recording.mcap"), "").unwrap();
        assert!(matches!(PathState::at(&path).unwrap(), PathState::Other(_)));
        fs::write(path.join("experiment.resolved.yaml"), "").unwrap();
        assert_eq!(PathState::at(&path).unwrap(), PathState::Run);
        let marked = folder.path().join("marked");
        fs::create_dir(&marked).unwrap();
        fs::write(marked.join(MARKER), "").unwrap();
        assert_eq!(PathState::at(&marked).unwrap(), PathState::Run);
        assert!(matches!(PathState::at(&marked.join(MARKER)).unwrap(), PathState::Other("a file")));
    }

    #[cfg(unix)]
    #[test]
    fn a_symbolic_link_is_not_a_run() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(folder.path().join("nowhere"), &link).unwrap();
        assert_eq!(PathState::at(&link).unwrap(), PathState::Other("a symbolic link"));
    }
}
