//! Paths of run folders: what is there, and whether it may be removed.

use std::ffi::OsString;
use std::fmt::Display;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use depthloom_terminal::{CliError, ExitCode};

use super::contents;
use super::marker::PathState;

/// A name beside `path` that only this process uses.
pub(super) fn aside(path: &Path) -> PathBuf {
    let mut name = path.file_name().map(OsString::from).unwrap_or_default();
    name.push(format!(".replaced-{}", std::process::id()));
    path.with_file_name(name)
}

pub(super) fn found(path: &Path) -> Result<PathState, CliError> {
    PathState::at(path).map_err(|error| failed("look at", path, &error))
}

/// The path without `..`, because a folder that is moved aside must not be part of its own path; and without a trailing
/// slash, which would follow a link.
pub(super) fn normalize_lexically(out: &Path) -> Result<PathBuf, CliError> {
    if !out.components().any(|part| part == Component::ParentDir) {
        return Ok(out.components().collect());
    }
    let (Some(parent), Some(name)) = (out.parent(), out.file_name()) else { return Ok(out.to_owned()) };
    // Folders that do not exist yet are created later. The path cannot be resolved if `..` follows them.
    let existing = parent.ancestors().find(|path| path.exists()).unwrap_or(parent);
    let missing = parent.strip_prefix(existing).unwrap_or(Path::new(""));
    let (existing, missing) = match missing.components().any(|part| part == Component::ParentDir) {
        true => (parent, Path::new("")),
        false => (existing, missing),
    };
    let real = fs::canonicalize(existing).map_err(|error| failed("find", existing, &error))?;
    Ok(real.join(missing).join(name))
}

/// Why a run's folder must not be removed: it is or contains the current folder, contains a file that is `read`, or a
/// foreign file.
pub(super) fn harm(path: &Path, read: &[PathBuf]) -> Result<Option<String>, CliError> {
    let real = fs::canonicalize(path).map_err(|error| failed("look at", path, &error))?;
    if std::env::current_dir().is_ok_and(|here| here.starts_with(&real)) {
        return Ok(Some("it is the current folder, or contains it".to_owned()));
    }
    if let Some(file) = read.iter().find(|file| fs::canonicalize(file).is_ok_and(|file| file.starts_with(&real))) {
        return Ok(Some(format!("it contains {}, which this run reads", file.display())));
    }
    let foreign = contents::foreign(path).map_err(|error| failed("look into", path, &error))?;
    Ok(foreign.map(|name| format!("it contains {}, which no run wrote", Path::new(&name).display())))
}

pub(super) fn failed(to: &str, path: &Path, error: &io::Error) -> CliError {
    failed_to(format_args!("failed to {to} {}", path.display()), error)
}

/// Before the first frame, whatever the error is.
pub(super) fn failed_to(intent: impl Display, error: &io::Error) -> CliError {
    CliError::of_writing(ExitCode::Usage, intent, error)
}
