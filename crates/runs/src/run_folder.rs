//! A run's folder: written as `<out>.partial`, renamed when complete, and replaced only on request.
//!
//! At every moment, the final name belongs to a complete run or to nothing: an old run is moved aside before the new
//! one takes its name, and is removed afterwards.

mod contents;
mod lock;
mod marker;
mod paths;
mod remove;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

pub use contents::{in_the_way_of_a_report, mark_for_reports};
use depthloom_terminal::{CliError, ExitCode, say};
pub use lock::{Lock, Refused, is_held};
pub use marker::PathState;
pub use remove::Removal;

use paths::{aside, failed, failed_to, found, harm, normalize_lexically};

/// The folder beside runs with the checkpoints of trainings.
pub const CHECKPOINTS: &str = "checkpoints";

/// The folder a run writes to, not yet under its final name.
pub struct RunFolder {
    /// Where files are written: `<out>.partial`.
    pub partial: PathBuf,
    /// The final name.
    pub out: PathBuf,
    /// Locked as long as the run writes.
    lock: Lock,
    /// The finished run with the final name, locked, if it is to be replaced.
    replaced: Option<Lock>,
    /// Whether the run resumes one that an earlier process started.
    pub resumes: bool,
}

/// The content of a partial folder, for a run that would write there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PartialContent {
    /// Frames of the same experiment, by an earlier process.
    This,
    /// Nothing of value.
    Nothing,
    /// Frames of another run, or unknown content.
    Other,
    /// A recording that cannot be read, and why.
    Unreadable(String),
}

impl RunFolder {
    /// Creates `<out>.partial`.
    ///
    /// A run under either name is replaced only with `overwrite`, and only if it has finished and contains none of the
    /// files and folders `read`. An empty partial folder is left of a run that ended at its start, and is replaced. If
    /// it has content, `begun` classifies it.
    ///
    /// # Errors
    /// If something that must not be replaced has either name, another process writes there, or the system refuses.
    pub fn create(
        out: &Path,
        overwrite: bool,
        read: &[PathBuf],
        begun: impl FnOnce(&Path) -> PartialContent,
    ) -> Result<Self, CliError> {
        let out = &normalize_lexically(out)?;
        let partial = partial_name(out)?;
        make_parent(out)?;
        // A name that is too long would be refused only at the end of the run.
        found(&aside(out))?;
        for path in [out, &partial] {
            match found(path)? {
                PathState::Nothing => {}
                PathState::Empty if path == &partial => {
                    fs::remove_dir(path).map_err(|error| failed("remove", path, &error))?;
                }
                PathState::Empty => return Err(no_run(path, "a folder, but not of a run")),
                PathState::Other(what) => return Err(no_run(path, what)),
                // It may be the same run, interrupted.
                PathState::Run if path == &partial => {}
                PathState::Run if overwrite => keep_from_harm(path, read)?,
                PathState::Run => return Err(exists(path)),
            }
        }
        let replaced = (found(out)? == PathState::Run).then(|| lock(out)).transpose()?;
        if found(&partial)? == PathState::Run {
            let old = lock(&partial)?;
            match begun(&partial) {
                PartialContent::This => {
                    contents::remove_abandoned(&partial);
                    contents::remove_reports(&partial)
                        .map_err(|error| failed("remove the reports in", &partial, &error))?;
                    return Ok(Self { partial, out: out.clone(), lock: old, replaced, resumes: true });
                }
                PartialContent::Other if !overwrite => {
                    let what = format!("{} contains frames that this run cannot resume", partial.display());
                    let why = "they are of another experiment or other parameters, or --fresh was requested";
                    return Err(CliError::usage(
                        format!("{what}: {why}"),
                        "choose another --out, or replace it with --overwrite; an interrupted run with --fresh resumes without --fresh",
                    ));
                }
                PartialContent::Unreadable(why) if !overwrite => {
                    let what = format!("failed to resume {}: {why}", partial.display());
                    return Err(CliError::usage(what, "choose another --out, or replace it with --overwrite"));
                }
                PartialContent::Nothing | PartialContent::Other | PartialContent::Unreadable(_) => {}
            }
            keep_from_harm(&partial, read)?;
            let aside = aside(&partial);
            fs::rename(&partial, &aside).map_err(|error| failed("move aside", &partial, &error))?;
            fs::remove_dir_all(&aside).map_err(|error| failed("remove", &aside, &error))?;
        }
        fs::create_dir(&partial).map_err(|error| failed("create", &partial, &error))?;
        let folder = Self::marked(partial, out, replaced)?;
        if folder.replaced.is_none() && found(out)? != PathState::Nothing {
            // Another run took the name in the meantime.
            folder.discard();
            return Err(exists(out));
        }
        Ok(folder)
    }

    /// Creates `<parent>/<name>.partial`, or `<name>-2` and so on: the first that is free.
    ///
    /// # Errors
    /// If the folder cannot be created or marked.
    pub fn create_new(parent: &Path, name: &str) -> Result<Self, CliError> {
        let mut number = 1_u32;
        loop {
            let out = parent.join(if number == 1 { name.to_owned() } else { format!("{name}-{number}") });
            number += 1;
            let partial = partial_name(&out)?;
            make_parent(&out)?;
            match fs::create_dir(&partial) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                made => made.map_err(|error| failed("create", &partial, &error))?,
            }
            // Checked only now: the process that had the partial name may just have renamed its folder.
            if found(&out)? == PathState::Nothing {
                return Self::marked(partial, &out, None);
            }
            fs::remove_dir(&partial).map_err(|error| failed("remove", &partial, &error))?;
        }
    }

    fn marked(partial: PathBuf, out: &Path, replaced: Option<Lock>) -> Result<Self, CliError> {
        match Lock::mark(&partial) {
            Ok(lock) => Ok(Self { partial, out: out.to_owned(), lock, replaced, resumes: false }),
            Err(error) => {
                // Removes only the folder, not its content: that needs a file descriptor, which may not be available,
                // and files in it now were written by others.
                let _ = fs::remove_dir(&partial);
                let intent = format_args!("failed to mark {}", partial.display());
                Err(match error {
                    Refused::System(error) => failed_to(intent, &error),
                    busy @ Refused::Busy => CliError::because(ExitCode::Usage, intent, &busy),
                })
            }
        }
    }

    /// A file in the folder while it is partial.
    pub fn file(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Writes a small file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, name: &str, content: &str) -> Result<(), CliError> {
        let path = self.file(name);
        depthloom_durable::write(&path, content.as_bytes()).map_err(|error| {
            CliError::of_writing(ExitCode::Engine, format_args!("failed to write {}", path.display()), &error)
        })
    }

    /// The folder for checkpoints of trainings: beside the run, so that the next run finds them.
    pub fn checkpoints(&self) -> PathBuf {
        self.out.with_file_name(CHECKPOINTS)
    }

    /// Removes the folder, whose content is not needed.
    pub fn discard(self) {
        if let Err(error) = fs::remove_dir_all(&self.partial) {
            say(format_args!("warning: failed to remove {}: {error}", self.partial.display()));
        }
    }

    /// Gives the folder its final name, once its content is on the disk.
    ///
    /// # Errors
    /// If the name was taken in the meantime, or the system refuses to rename: the run is complete under its partial
    /// name.
    pub fn finish(self) -> Result<PathBuf, CliError> {
        let Self { partial, out, lock, replaced, .. } = self;
        let unnamed = |what: String| {
            CliError::new(ExitCode::Engine, what)
                .remedy(format!("the run is complete in {}: rename it", partial.display()))
        };
        let rename = |from: &Path, to: &Path| {
            depthloom_durable::rename(from, to)
                .map_err(|error| unnamed(format!("failed to rename {} to {}: {error}", from.display(), to.display())))
        };
        // Where folders with open files cannot be renamed, the lock is released now; otherwise after the rename.
        let lock = cfg!(unix).then_some(lock);
        depthloom_durable::sync_tree(&partial)
            .map_err(|error| unnamed(format!("failed to synchronise {}: {error}", partial.display())))?;
        let old = match fs::symlink_metadata(&out) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            _ if replaced.as_ref().is_some_and(|replaced| replaced.is_of(&out)) => {
                drop(replaced);
                let aside = aside(&out);
                rename(&out, &aside)?;
                Some(aside)
            }
            _ => return Err(unnamed(format!("{} was created by another program during the run", out.display()))),
        };
        if let Err(stop) = rename(&partial, &out) {
            if let Some(old) = &old {
                let _ = depthloom_durable::rename(old, &out);
            }
            return Err(stop);
        }
        drop(lock);
        if let Some(old) = old
            && let Err(error) = fs::remove_dir_all(&old)
        {
            say(format_args!("warning: failed to remove the replaced run {}: {error}", old.display()));
        }
        Ok(out)
    }
}

/// The run's folder at a path or around it.
pub fn around(path: &Path) -> Option<PathBuf> {
    let folder = path.ancestors().find_map(|folder| {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        fs::canonicalize(folder).ok()
    })?;
    folder
        .ancestors()
        .find(|folder| PathState::at(folder).is_ok_and(|found| found == PathState::Run))
        .map(Path::to_owned)
}

/// The lock of a run's folder, to write more into it, or `None` if the folder is not a run's.
///
/// # Errors
/// If another process writes there, or the system refuses.
pub fn lock_if_run(folder: &Path) -> Result<Option<Lock>, CliError> {
    if found(folder)? != PathState::Run {
        return Ok(None);
    }
    let lock = lock(folder)?;
    contents::remove_abandoned(folder);
    Ok(Some(lock))
}

fn lock(folder: &Path) -> Result<Lock, CliError> {
    Lock::take(folder).map_err(|refused| {
        let intent = format!("failed to lock {}", folder.display());
        match refused {
            Refused::Busy => CliError::because(ExitCode::Usage, intent, &refused)
                .remedy("wait until it is done, or write to another folder (--out)"),
            Refused::System(error) => failed_to(intent, &error),
        }
    })
}

fn partial_name(out: &Path) -> Result<PathBuf, CliError> {
    let name = out.file_name().ok_or_else(|| {
        CliError::usage(
            format!("the output folder `{}` has no name", out.display()),
            "name a folder that is not there yet, such as runs/first",
        )
    })?;
    if Path::new(name).extension().is_some_and(|extension| extension == depthloom_durable::PARTIAL) {
        let what = format!("{}: a folder with this extension is an unfinished run", out.display());
        return Err(CliError::usage(what, "choose another --out"));
    }
    if name == CHECKPOINTS {
        let what = format!("{}: a folder `{CHECKPOINTS}` is where trainings store their checkpoints", out.display());
        return Err(CliError::usage(what, "choose another --out"));
    }
    Ok(depthloom_durable::partial_name(out))
}

fn make_parent(out: &Path) -> Result<(), CliError> {
    match out.parent() {
        Some(parent) => fs::create_dir_all(parent).map_err(|error| failed("create", parent, &error)),
        None => Ok(()),
    }
}

/// Refuses to replace the current folder, inputs of the run, or foreign files.
fn keep_from_harm(path: &Path, read: &[PathBuf]) -> Result<(), CliError> {
    if let Some(mark) = crate::notes::mark(path) {
        let what = format!("{} is not replaced: {mark}", path.display());
        let remedy =
            "choose another --out, or remove tags and note with `depthloom runs tag` and `depthloom runs note`";
        return Err(CliError::usage(what, remedy));
    }
    match harm(path, read)? {
        None => Ok(()),
        Some(why) => {
            let what = format!("{} is not replaced: {why}", path.display());
            Err(CliError::usage(what, "choose another --out"))
        }
    }
}

fn no_run(path: &Path, what: &str) -> CliError {
    CliError::usage(
        format!("{} is {what}: only runs are replaced", path.display()),
        "choose another --out, or remove it yourself",
    )
}

fn exists(path: &Path) -> CliError {
    let is_partial = path.extension().is_some_and(|extension| extension == depthloom_durable::PARTIAL);
    let what = if is_partial { ": a run that is running, or was interrupted" } else { "" };
    CliError::usage(
        format!("{} exists already{what}", path.display()),
        "choose another --out, or replace it with --overwrite",
    )
}

#[cfg(test)]
mod tests;
