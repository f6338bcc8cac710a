//! Lichtblick, Foxglove's open fork: its code, run by Node.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use crate::python::output_of;
use crate::{target, workspace};

/// A command that reads a recording with Lichtblick's code: `tests/lichtblick/check.mjs` and its first argument.
///
/// The first test that needs it installs the npm packages to `target/lichtblick-tests`. Lichtblick itself is not in a
/// registry: `DEPTHLOOM_LICHTBLICK` names a checkout. `None` if that is not set, or without Node or a registry: the
/// test is then reported as skipped.
#[must_use]
pub fn lichtblick(test: &str) -> Option<Command> {
    if !crate::full(test) {
        return None;
    }
    static INSTALLED: OnceLock<Result<(PathBuf, PathBuf), String>> = OnceLock::new();
    match INSTALLED.get_or_init(installed) {
        Ok((checkout, script)) => {
            let mut command = Command::new("node");
            command.arg(script).arg(checkout);
            Some(command)
        }
        Err(why) => {
            crate::skipped(test, why);
            None
        }
    }
}

fn installed() -> Result<(PathBuf, PathBuf), String> {
    let checkout = std::env::var_os("DEPTHLOOM_LICHTBLICK").map(PathBuf::from);
    let checkout = checkout
        .ok_or("Lichtblick's decoders are in no npm package, and DEPTHLOOM_LICHTBLICK names no checkout of it")?;
    let folder = target().join("lichtblick-tests");
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    fs::create_dir_all(&folder).map_err(failed)?;
    let lock = fs::File::create(folder.with_extension("lock")).map_err(failed)?;
    lock.lock().map_err(failed)?;
    for name in ["package.json", "package-lock.json", "check.mjs"] {
        fs::copy(workspace().join("tests/lichtblick").join(name), folder.join(name)).map_err(failed)?;
    }
    let lockfile = fs::read_to_string(folder.join("package-lock.json")).map_err(failed)?;
    let done = folder.join("installed.json");
    if !fs::read_to_string(&done).is_ok_and(|installed| installed == lockfile) {
        output_of(Command::new("npm").current_dir(&folder).args([
            "ci",
            "--no-audit",
            "--no-fund",
            "--ignore-scripts",
        ]))?;
        fs::write(&done, lockfile).map_err(failed)?;
    }
    Ok((checkout, folder.join("check.mjs")))
}
