//! Rerun, in a separate Python environment, and a Vulkan driver without a graphics card for its viewer.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::python::{Shared, environment, get_or_create, output_of};
use crate::target;

const SYSTEM_DRIVERS: [&str; 2] = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"];

/// Rerun's program.
pub struct Rerun {
    program: PathBuf,
}

/// Rerun in the version of `tests/python/requirements-rerun.txt`, in `target/rerun-tests`, which the first test that
/// needs it creates. `None` without Python or a package index: the test is then reported as skipped.
///
/// # Panics
/// If it cannot be created and `DEPTHLOOM_REQUIRE_PYTHON` is set.
#[must_use]
pub fn rerun(test: &str) -> Option<Rerun> {
    static PYTHON: Shared<PathBuf> = OnceLock::new();
    let python = get_or_create(test, &PYTHON, || environment("rerun-tests", "requirements-rerun.txt"))?;
    Some(Rerun { program: python.with_file_name("rerun") })
}

impl Rerun {
    /// Its program in a folder, with telemetry disabled.
    #[must_use]
    pub fn command(&self, folder: &Path) -> Command {
        let mut command = Command::new(&self.program);
        command.current_dir(folder).env("CI", "1").env("NO_COLOR", "1").env_remove("RUST_LOG");
        command
    }

    /// Its viewer without a window: on the system's Vulkan, or on Mesa's for machines without a card, which is fetched
    /// into `target/vulkan-tests` with Debian's tools. `None`, and the test is skipped, where there is neither.
    ///
    /// # Panics
    /// Never.
    #[must_use]
    pub fn viewer(&self, test: &str, folder: &Path) -> Option<Command> {
        static VULKAN: OnceLock<Result<Option<PathBuf>, String>> = OnceLock::new();
        let mut command = self.command(folder);
        command.args(["--headless", "--window-size", "1600x900"]);
        match VULKAN.get_or_init(vulkan) {
            Ok(None) => {}
            Ok(Some(root)) => {
                let libraries = root.join("usr/lib").join(format!("{}-linux-gnu", std::env::consts::ARCH));
                command.env("LD_LIBRARY_PATH", libraries).env("VK_DRIVER_FILES", root.join("lvp.json"));
                command.env("VK_ICD_FILENAMES", root.join("lvp.json"));
            }
            Err(why) => {
                crate::skipped(test, &format!("Rerun's viewer needs Vulkan: {why}"));
                return None;
            }
        }
        command.env("WGPU_BACKEND", "vulkan");
        Some(command)
    }
}

fn vulkan() -> Result<Option<PathBuf>, String> {
    let has_driver = |folder: &&str| fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
    if SYSTEM_DRIVERS.iter().any(has_driver) {
        return Ok(None);
    }
    let root = target().join("vulkan-tests");
    let failed = |error: std::io::Error| format!("{}: {error}", root.display());
    let lock = File::create(root.with_extension("lock")).map_err(failed)?;
    lock.lock().map_err(failed)?;
    let manifest = root.join("lvp.json");
    if manifest.exists() {
        return Ok(Some(root));
    }
    fs::create_dir_all(&root).map_err(failed)?;
    let depends = output_of(Command::new("apt-cache").args(["depends", "mesa-vulkan-drivers"]))?;
    let depends = String::from_utf8_lossy(&depends.stdout).into_owned();
    // The driver compiles shaders with LLVM.
    let llvm = depends.split_whitespace().find(|word| word.starts_with("libllvm")).map(str::to_owned);
    let packages = ["mesa-vulkan-drivers", "libvulkan1"].map(str::to_owned).into_iter().chain(llvm);
    output_of(Command::new("apt-get").current_dir(&root).arg("download").args(packages))?;
    for entry in fs::read_dir(&root).map_err(failed)?.flatten() {
        if entry.path().extension().is_some_and(|extension| extension == "deb") {
            output_of(Command::new("dpkg").current_dir(&root).arg("-x").arg(entry.path()).arg("."))?;
        }
    }
    let system_manifest = root.join("usr/share/vulkan/icd.d").join(format!("lvp_icd.{}.json", std::env::consts::ARCH));
    let text = fs::read_to_string(&system_manifest).map_err(failed)?;
    // The manifest contains the library's name or its path in a system; here it is in `root`.
    let library = root.join("usr/lib").join(format!("{}-linux-gnu", std::env::consts::ARCH)).join("libvulkan_lvp.so");
    let line = |line: &str| match line.contains("\"library_path\"") {
        true => {
            let comma = if line.trim_end().ends_with(',') { "," } else { "" };
            format!("\"library_path\": \"{}\"{comma}\n", library.display())
        }
        false => format!("{line}\n"),
    };
    fs::write(&manifest, text.lines().map(line).collect::<String>()).map_err(failed)?;
    Ok(Some(root))
}
