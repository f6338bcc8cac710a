//! The export folder: its owner, and files that are complete or absent.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use depthloom_terminal::{CliError, ExitCode};
use depthloom_threads::locked;

use depthloom_runs::run_folder;

/// The file that marks a folder as made by an export: its content may be exported again.
const MARKER: &str = ".depthloom-export";

/// The folder that is exported to.
pub struct Folder {
    path: PathBuf,
    /// Whether an existing file may be replaced.
    replaces: bool,
    /// Folders in it that were seen, and rid of what a killed export left.
    seen: Mutex<BTreeSet<PathBuf>>,
}

impl Folder {
    /// Looks whether the folder may be written to; makes nothing.
    ///
    /// # Errors
    /// If it is not a folder, or is inside the folder of a run.
    pub fn at(path: &Path, overwrite: bool) -> Result<Self, CliError> {
        let cannot = |what: String| CliError::usage(what, "choose another --out");
        let failed = |error: &io::Error| {
            CliError::because(ExitCode::Usage, format_args!("failed to look at {}", path.display()), error)
        };
        if let Some(run) = run_folder::around(path) {
            let run = run.display();
            return Err(cannot(format!("{run} is a run's folder, and holds what the run wrote and nothing else")));
        }
        let is_ours = match fs::metadata(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                if fs::symlink_metadata(path).is_ok() {
                    return Err(cannot(format!("{} is a link that leads nowhere", path.display())));
                }
                true
            }
            Err(error) => return Err(failed(&error)),
            Ok(there) if !there.is_dir() => return Err(cannot(format!("{} is not a folder", path.display()))),
            Ok(_) => {
                let is_empty = fs::read_dir(path).map_err(|error| failed(&error))?.next().is_none();
                is_empty || fs::symlink_metadata(path.join(MARKER)).is_ok_and(|marker| marker.is_file())
            }
        };
        Ok(Self { path: path.to_owned(), replaces: is_ours || overwrite, seen: Mutex::default() })
    }

    /// Fails if one of these files exists and may not be replaced.
    ///
    /// # Errors
    /// The first file that exists already.
    pub fn check(&self, files: impl IntoIterator<Item = PathBuf>) -> Result<(), CliError> {
        if self.replaces {
            return Ok(());
        }
        let mut there = files.into_iter().map(|file| self.path.join(file));
        match there.find(|path| fs::symlink_metadata(path).is_ok()) {
            None => Ok(()),
            Some(path) => {
                let what = format!("{} exists already, in a folder that no export made", path.display());
                Err(CliError::usage(what, "choose another --out, or replace what is there with --overwrite"))
            }
        }
    }

    /// Makes the folder, and marks it if nothing is in it.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn create(&self) -> Result<(), CliError> {
        let made = fs::create_dir_all(&self.path).and_then(|()| {
            let is_empty = fs::read_dir(&self.path)?.next().is_none();
            depthloom_durable::remove_abandoned(&self.path);
            if is_empty { depthloom_durable::write(&self.path.join(MARKER), b"") } else { Ok(()) }
        });
        made.map_err(|error| {
            CliError::of_writing(ExitCode::Usage, format_args!("failed to create {}", self.path.display()), &error)
        })
    }

    /// Writes a file completely or not at all, and creates the folders below; a link on the way is not
    /// followed.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, file: &Path, bytes: &[u8]) -> Result<(), CliError> {
        let path = self.path.join(file);
        let made = self.make(file.parent().unwrap_or(Path::new("")));
        made.and_then(|()| depthloom_durable::write(&path, bytes)).map_err(|error| {
            CliError::of_writing(ExitCode::Engine, format_args!("failed to write {}", path.display()), &error)
        })
    }

    fn make(&self, below: &Path) -> io::Result<()> {
        let mut folder = self.path.clone();
        for part in below.components() {
            folder.push(part);
            depthloom_durable::create_folder(&folder)?;
            if locked(&self.seen).insert(folder.clone()) {
                depthloom_durable::remove_abandoned(&folder);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    use super::Folder;

    #[test]
    fn files_not_from_an_export_are_replaced_only_with_overwrite() {
        let folder = tempfile::tempdir().unwrap();
        let (out, file) = (folder.path().join("out"), Path::new("look/depth/0.png"));
        let export = |overwrite| {
            let folder = Folder::at(&out, overwrite)?;
            folder.check([PathBuf::from(file)])?;
            folder.create()?;
            folder.write(file, b"new")
        };
        export(false).unwrap();
        export(false).unwrap();
        fs::remove_file(out.join(super::MARKER)).unwrap();
        fs::write(out.join(file), "mine").unwrap();
        let refused = export(false).unwrap_err();
        assert!(refused.message.what.contains("0.png exists already"), "{}", refused.message.what);
        assert_eq!(fs::read(out.join(file)).unwrap(), b"mine");
        export(true).unwrap();
        assert_eq!(fs::read(out.join(file)).unwrap(), b"new");
        // Without files of the same names, a folder with other files can be used.
        fs::remove_dir_all(out.join("look")).unwrap();
        fs::write(out.join("notes.txt"), "mine").unwrap();
        export(false).unwrap();
        assert!(!out.join(super::MARKER).exists(), "the folder is not marked as depthloom's");
    }

    #[test]
    fn a_runs_folder_takes_no_export() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(depthloom_runs::MARKER), "").unwrap();
        for out in [folder.path().to_owned(), folder.path().join("a/b")] {
            assert!(Folder::at(&out, true).err().unwrap().message.what.contains("is a run's folder"));
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_below_are_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (out, elsewhere) = (folder.path().join("out"), folder.path().join("elsewhere"));
        fs::create_dir(&elsewhere).unwrap();
        let export = Folder::at(&out, false).unwrap();
        export.create().unwrap();
        std::os::unix::fs::symlink(&elsewhere, out.join("look")).unwrap();
        assert!(export.write(Path::new("look/0.png"), b"new").unwrap_err().message.what.contains("not a folder"));
        assert_eq!(fs::read_dir(&elsewhere).unwrap().count(), 0);
    }
}
