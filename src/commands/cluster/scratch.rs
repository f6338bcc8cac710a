//! Shards that are recorded on a disk of the job's machine, and copied when they are complete or interrupted.

use std::fs;
use std::io;
use std::path::Path;

use depthloom_durable::partial_name;
use depthloom_terminal::{CliError, ExitCode, say};

use crate::execution::shard::Computed;

/// Computes a shard in a folder of the machine, and copies it to `out`.
///
/// # Errors
/// As `compute`, or if the copy fails. What an interrupted computation has recorded is copied too.
pub(super) fn through(
    scratch: &Path,
    out: &Path,
    compute: impl FnOnce(&Path) -> Result<Computed, CliError>,
) -> Result<Computed, CliError> {
    if out.exists() {
        return compute(out);
    }
    let failed = |what: &str, path: &Path, error: &io::Error| {
        CliError::of_writing(ExitCode::Engine, format_args!("failed to {what} {}", path.display()), error)
            .also(format!("{} is the folder of --scratch", scratch.display()))
    };
    fs::create_dir_all(scratch).map_err(|error| failed("create", scratch, &error))?;
    let local = scratch.join(out.file_name().unwrap_or_default());
    let (local_partial, shared_partial) = (partial_name(&local), partial_name(out));
    // An earlier job on this machine was killed before it could copy: what another job has copied since is at least as
    // complete.
    for leftover in [&local, &local_partial] {
        if leftover.exists() && (leftover == &local || shared_partial.exists()) {
            fs::remove_dir_all(leftover).map_err(|error| failed("remove", leftover, &error))?;
        }
    }
    if shared_partial.exists() && !local_partial.exists() {
        copy(&shared_partial, &local_partial).map_err(|error| failed("copy to", &local_partial, &error))?;
    }
    match compute(&local) {
        Ok(computed) => {
            let copied = replace(&local, &shared_partial)
                .and_then(|()| depthloom_durable::sync_tree(&shared_partial))
                .and_then(|()| depthloom_durable::rename(&shared_partial, out));
            copied.map_err(|error| failed("copy to", out, &error))?;
            let _ = fs::remove_dir_all(&local);
            // Fails while other jobs use it.
            let _ = fs::remove_dir(scratch);
            Ok(Computed { out: out.to_owned(), ..computed })
        }
        Err(stop) => {
            if local_partial.exists() {
                match replace(&local_partial, &shared_partial) {
                    Ok(()) => {
                        let _ = fs::remove_dir_all(&local_partial);
                        let _ = fs::remove_dir(scratch);
                    }
                    Err(error) => say(format_args!("warning: failed to copy to {}: {error}", shared_partial.display())),
                }
            }
            Err(stop.also(format!("it recorded in {}, the folder of --scratch", scratch.display())))
        }
    }
}

/// Copies a folder over another one.
fn replace(from: &Path, to: &Path) -> io::Result<()> {
    if to.exists() {
        fs::remove_dir_all(to)?;
    }
    copy(from, to)
}

fn copy(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}
