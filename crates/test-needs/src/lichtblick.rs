//! Lichtblick, Foxglove's open fork: its code, run by Node.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use crate::python::output_of;
use crate::{target, workspace};

/// A command that looks at a recording with Lichtblick's code: `tests/lichtblick/check.mjs` and its first argument.
/// What it needs of npm lies in `target/lichtblick-tests`, which the first test that asks makes. Lichtblick itself is
/// in no registry: `DEPTHLOOM_LICHTBLICK` names a checkout. `None`, and the test is skipped, where that is not set, or
/// there is no Node or no registry.
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
    let wanted = fs::read_to_string(folder.join("package-lock.json")).map_err(failed)?;
    let done = folder.join("installed.json");
    if !fs::read_to_string(&done).is_ok_and(|have| have == wanted) {
        output_of(Command::new("npm").current_dir(&folder).args([
            "ci",
            "--no-audit",
            "--no-fund",
            "--ignore-scripts",
        ]))?;
        fs::write(&done, wanted).map_err(failed)?;
    }
    Ok((checkout, folder.join("check.mjs")))
}
