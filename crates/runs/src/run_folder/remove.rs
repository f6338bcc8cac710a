//! Removing a run that is over: a folder with a run's marker, under its lock, that holds nothing but what runs write.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use depthloom_terminal::{CliError, ExitCode};

use super::lock::{Lock, Refused};
use super::marker::PathState;
use super::paths::{aside, failed, found, harm, normalize_lexically};
use crate::files::MARKER;

/// A run that is about to be removed: nobody else writes in it, or can begin to.
#[derive(Debug)]
pub struct Removal {
    folder: PathBuf,
    lock: Lock,
}

impl Removal {
    /// Locks a run's folder and looks whether it may be removed.
    ///
    /// # Errors
    /// If it is no run's folder, a link, of a run that goes on, where the person stands, or holds what no run wrote.
    pub fn of(folder: &Path) -> Result<Self, CliError> {
        let folder = normalize_lexically(folder).map_err(may_not)?;
        let refuse = |why: &str, remedy: &str| {
            Err(CliError::usage(format!("{} is not removed: {why}", folder.display()), remedy))
        };
        match found(&folder).map_err(may_not)? {
            PathState::Run if folder.join(MARKER).exists() => {}
            PathState::Run => return refuse("it has no marker, for version 0.1.0 made it", "remove it yourself"),
            PathState::Other(what) => return refuse(&format!("it is {what}"), "only folders of runs are removed"),
            PathState::Empty => return refuse("it is an empty folder", "only folders of runs are removed"),
            PathState::Nothing => return refuse("there is nothing", "`depthloom runs` lists the runs there are"),
        }
        let lock = Lock::take(&folder).map_err(|refused| {
            let stop =
                CliError::because(ExitCode::Usage, format_args!("failed to lock {}", folder.display()), &refused);
            stop.remedy(if matches!(refused, Refused::Busy) { "wait until it is done" } else { RIGHT })
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

    /// Removes it. Nothing is left under its name at any moment but the whole run; what a kill leaves, under another
    /// name, is a run's folder still, and can be removed as one.
    ///
    /// # Errors
    /// What the system gave.
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
    "removing a run takes the right to write in its folder and in the one around it, on a disk that takes writes";

/// What the system refuses, with a remedy for who removes: another folder to write is none.
fn may_not(stop: CliError) -> CliError {
    stop.remedy(RIGHT)
}

/// Removes a run's folder, the marker last. Links are removed, and never followed.
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
        let stop = Removal::of(folder).unwrap_err();
        assert_eq!(stop.exit, ExitCode::Usage);
        stop.message.what
    }

    #[test]
    fn a_run_is_removed_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        run(&out);
        fs::create_dir(out.join("models")).unwrap();
        fs::write(out.join("models/learn.teacher.onnx"), "network").unwrap();
        let removal = Removal::of(&out).unwrap();
        assert!(refused(&out).contains("another process is writing to it"), "who removes it has it alone");
        removal.remove().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(refused(&out).contains("there is nothing"));
    }

    #[test]
    fn what_a_kill_left_of_a_removal_is_removed_as_a_run() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out.replaced-7");
        fs::create_dir(&out).unwrap();
        fs::write(out.join(MARKER), "").unwrap();
        Removal::of(&out).unwrap().remove().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn nothing_is_removed_that_is_not_a_runs() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        run(&out);
        // Somebody's file, and a run in the run.
        fs::write(out.join("thesis"), "years").unwrap();
        assert!(refused(&out).contains("it holds thesis, which no run wrote"));
        fs::remove_file(out.join("thesis")).unwrap();
        run(&out.join("inner"));
        assert!(refused(&out).contains("it holds inner"));
        Removal::of(&out.join("inner")).unwrap().remove().unwrap();
        // Without the marker it is nobody's.
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
        Removal::of(&out).unwrap();
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
        assert!(refused(&link.join("")).contains("it is a symbolic link"), "a slash behind it changes nothing");
        std::os::unix::fs::symlink(&precious, out.join("models")).unwrap();
        assert!(refused(&out).contains("it holds models, which no run wrote"));
        fs::remove_file(out.join("models")).unwrap();
        // One that comes behind the look is removed itself.
        let removal = Removal::of(&out).unwrap();
        std::os::unix::fs::symlink(&precious, out.join("models")).unwrap();
        removal.remove().unwrap();
        assert_eq!(fs::read_to_string(precious.join("years.onnx")).unwrap(), "years");
        assert!(!out.exists());
    }
}
