//! Removes finished runs: a folder with a run's marker, under its lock, that contains only files of runs.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use depthloom_terminal::{CliError, ExitCode};

use super::lock::{Lock, Refused};
use super::marker::PathState;
use super::paths::{aside, failed, found, harm, normalize_lexically};
use crate::files::MARKER;

/// A run that is about to be removed; its lock keeps other processes from writing in it.
#[derive(Debug)]
pub struct Removal {
    folder: PathBuf,
    lock: Lock,
}

impl Removal {
    /// Locks a run's folder and checks whether it may be removed.
    ///
    /// # Errors
    /// If it is not a run's folder, is a link, is being written, contains the current folder, or contains foreign
    /// files.
    pub fn prepare(folder: &Path) -> Result<Self, CliError> {
        let folder = normalize_lexically(folder).map_err(may_not)?;
        let refuse = |why: &str, remedy: &str| {
            Err(CliError::usage(format!("{} is not removed: {why}", folder.display()), remedy))
        };
        match found(&folder).map_err(may_not)? {
            PathState::Run if folder.join(MARKER).exists() => {}
            PathState::Run => return refuse("it has no marker, for version 0.1.0 made it", "remove it yourself"),
            PathState::Other(what) => return refuse(&format!("it is {what}"), "only folders of runs can be removed"),
            PathState::Empty => return refuse("it is an empty folder", "only folders of runs can be removed"),
            PathState::Nothing => return refuse("it does not exist", "`depthloom runs` lists the runs"),
        }
        let lock = Lock::take(&folder).map_err(|refused| {
            let intent = format_args!("failed to lock {}", folder.display());
            match refused {
                Refused::System(error) => may_not(CliError::of_writing(ExitCode::Usage, intent, &error)),
                Refused::Busy => CliError::because(ExitCode::Usage, intent, &refused).remedy("wait until it is done"),
            }
        })?;
        match harm(&folder, &[]).map_err(may_not)? {
            None => Ok(Self { folder, lock }),
            Some(why) => refuse(&why, "move away what you want to keep, or remove the folder yourself"),
        }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Removes it. At every moment, its name belongs to the complete run or to nothing. What a kill leaves has another
    /// name, is still a run's folder, and can be removed as one.
    ///
    /// # Errors
    /// The error of the system.
    pub fn remove(self) -> Result<(), CliError> {
        let Self { folder, lock } = self;
        // Where folders with open files cannot be renamed the lock goes now.
        let lock = cfg!(unix).then_some(lock);
        let aside = aside(&folder);
        let failed =
            |error: &io::Error| may_not(CliError { exit: ExitCode::Engine, ..failed("remove", &folder, error) });
        depthloom_durable::rename(&folder, &aside).map_err(|error| failed(&error))?;
        remove_all(&aside)
            .map_err(|error| failed(&error).also(format!("what is left of it is {}", aside.display())))?;
        drop(lock);
        Ok(())
    }
}

const RIGHT: &str =
    "removing a run requires write permission for its folder and for the parent folder, on a writable disk";

/// A refusal of the system, with a remedy: choosing another folder does not help here.
fn may_not(stop: CliError) -> CliError {
    stop.remedy(RIGHT)
}

/// Removes a run's folder, the marker last. Links are removed, not followed.
fn remove_all(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name() == MARKER {
            continue;
        }
        if entry.file_type()?.is_dir() { fs::remove_dir_all(entry.path())? } else { fs::remove_file(entry.path())? }
    }
    fs::remove_file(folder.join(MARKER))?;
    fs::remove_dir(folder)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::super::PartialContent;
    use super::{MARKER, Removal};
    use crate::run_folder::RunFolder;
    use depthloom_terminal::ExitCode;

    fn run(out: &Path) {
        let folder = RunFolder::create(out, false, &[], |_| PartialContent::Other).unwrap();
        folder.write("scores.csv", "numbers").unwrap();
        folder.finish().unwrap();
    }

    fn refused(folder: &Path) -> String {
        let stop = Removal::prepare(folder).unwrap_err();
        assert_eq!(stop.exit, ExitCode::Usage);
        stop.message.what
    }

    #[test]
    fn a_run_is_removed_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        run(&out);
        fs::create_dir(out.join("models")).unwrap();
        fs::write(out.join("models/learn.train.onnx"), "network").unwrap();
        fs::write(out.join("models/trust.reliability.json"), "{}").unwrap();
        let removal = Removal::prepare(&out).unwrap();
        assert!(refused(&out).contains("another process is writing to it"), "a removal locks the folder");
        removal.remove().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(refused(&out).contains("it does not exist"));
    }

    #[test]
    fn an_interrupted_removal_can_be_repeated() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out.replaced-7");
        fs::create_dir(&out).unwrap();
        fs::write(out.join(MARKER), "").unwrap();
        Removal::prepare(&out).unwrap().remove().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn only_folders_of_runs_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        run(&out);
        // A foreign file, and a run in the run.
        fs::write(out.join("thesis"), "years").unwrap();
        assert!(refused(&out).contains("it contains thesis, which no run wrote"));
        fs::remove_file(out.join("thesis")).unwrap();
        run(&out.join("inner"));
        assert!(refused(&out).contains("it contains inner"));
        Removal::prepare(&out.join("inner")).unwrap().remove().unwrap();
        // Without the marker it is a foreign folder.
        let marker = fs::read(out.join(MARKER)).unwrap();
        fs::remove_file(out.join(MARKER)).unwrap();
        assert!(refused(&out).contains("not of a run"));
        for name in ["recording.mcap", "experiment.resolved.yaml"] {
            fs::write(out.join(name), "").unwrap();
        }
        assert!(refused(&out).contains("version 0.1.0 made it"));
        fs::write(out.join(MARKER), marker).unwrap();
        let live = RunFolder::create(&folder.path().join("live"), false, &[], |_| PartialContent::Other).unwrap();
        assert!(refused(&live.partial).contains("another process is writing to it"));
        Removal::prepare(&out).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn no_link_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (out, precious) = (folder.path().join("out"), folder.path().join("precious"));
        run(&out);
        fs::create_dir(&precious).unwrap();
        fs::write(precious.join("years.onnx"), "years").unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&out, &link).unwrap();
        assert!(refused(&link).contains("it is a symbolic link"));
        assert!(refused(&link.join("")).contains("it is a symbolic link"), "a trailing slash changes nothing");
        std::os::unix::fs::symlink(&precious, out.join("models")).unwrap();
        assert!(refused(&out).contains("it contains models, which no run wrote"));
        fs::remove_file(out.join("models")).unwrap();
        // A link that is created after the check is removed itself.
        let removal = Removal::prepare(&out).unwrap();
        std::os::unix::fs::symlink(&precious, out.join("models")).unwrap();
        removal.remove().unwrap();
        assert_eq!(fs::read_to_string(precious.join("years.onnx")).unwrap(), "years");
        assert!(!out.exists());
    }
}
