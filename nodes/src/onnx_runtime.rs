//! ONNX Runtime: where this machine has it.
//!
//! Looked at, in this order: `ORT_DYLIB_PATH`; the program's own folder and the system's library folders; Python environments (`VIRTUAL_ENV`,
//! `CONDA_PREFIX`, then `.venv`, `venv` and `target/venv*` in the working folder and those above it); what `python3` imports as `onnxruntime`.
//! The first library that loads and is new enough is taken.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use ort::logging::LogLevel;

use crate::onnx_engine::Engine;

pub(crate) const REMEDY: &str = "install it with `pip install onnxruntime` in a virtual environment that is active or named .venv, or set ORT_DYLIB_PATH to libonnxruntime.so of version 1.24 or newer";

/// Why there is no ONNX Runtime.
pub(crate) enum Missing {
    /// `ORT_DYLIB_PATH` names one that cannot be used.
    Named(String),
    /// None was found that loads.
    NoneFound(String),
}

impl Missing {
    pub(crate) fn into_text(self) -> String {
        match self {
            Self::Named(what) | Self::NoneFound(what) => what,
        }
    }
}

/// The ONNX Runtime of this machine.
pub(crate) fn load() -> Result<Engine, Missing> {
    if let Some(path) = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()) {
        // Asked for by name: another one in its place would surprise.
        let named = |what| Missing::Named(format!("ORT_DYLIB_PATH: {what}"));
        return open(PathBuf::from(path), "ORT_DYLIB_PATH").map_err(named);
    }
    let mut refused = Vec::new();
    for (found_by, paths) in places() {
        for path in paths() {
            match open(path, found_by) {
                Ok(engine) => return Ok(engine),
                Err(what) => refused.push(what),
            }
        }
    }
    let looked = "this machine has no ONNX Runtime: neither beside the program, in the system's library folders nor in a Python environment";
    Err(Missing::NoneFound(if refused.is_empty() {
        looked.to_owned()
    } else {
        format!("{looked} is one that loads ({})", refused.join("; "))
    }))
}

fn open(path: PathBuf, found_by: &'static str) -> Result<Engine, String> {
    if !path.is_file() {
        return Err(format!("there is no file {}", path.display()));
    }
    let environment = ort::init_from(&path).map_err(|error| error.to_string())?;
    let environment = environment.with_name("depthloom").with_telemetry(false).build().map_err(|e| e.to_string())?;
    // What it has to say to its developers would tear progress bars apart; failures come back as errors.
    environment.set_log_level(LogLevel::Error);
    let version = version(&path, ort::info());
    Ok(Engine::of_library(path, found_by, version, environment))
}

/// From the file's name (`libonnxruntime.so.1.31.1`), links followed, or the branch it was built from (`rel-1.31.1`).
fn version(path: &Path, build: &str) -> String {
    let file = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let file = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let named = file.split_once(".so.").map(|(_, version)| version.to_owned());
    let branch = || build.split_once("git-branch=rel-").and_then(|(_, rest)| rest.split(',').next()).map(str::to_owned);
    named.or_else(branch).unwrap_or_else(|| "unknown".to_owned())
}

type Places = Vec<(&'static str, Box<dyn FnOnce() -> Vec<PathBuf>>)>;

/// Where to look, in order; each place is only searched when those before it had nothing.
fn places() -> Places {
    let environment = |name: &'static str| -> (&'static str, Box<dyn FnOnce() -> Vec<PathBuf>>) {
        (name, Box::new(move || std::env::var_os(name).map(|root| in_python(Path::new(&root))).unwrap_or_default()))
    };
    vec![
        ("program's folder", Box::new(beside_program)),
        ("system", Box::new(in_system)),
        environment("VIRTUAL_ENV"),
        environment("CONDA_PREFIX"),
        ("virtual environment", Box::new(in_working_folder)),
        ("python3", Box::new(imported_by_python)),
    ]
}

fn beside_program() -> Vec<PathBuf> {
    let program = std::env::current_exe().ok();
    program.and_then(|program| program.parent().map(libraries)).unwrap_or_default()
}

fn in_system() -> Vec<PathBuf> {
    let folders = [
        "/usr/local/lib",
        "/usr/lib",
        "/usr/lib64",
        "/usr/lib/x86_64-linux-gnu",
        "/usr/lib/aarch64-linux-gnu",
        "/opt/onnxruntime/lib",
        "/opt/homebrew/lib",
    ];
    folders.iter().flat_map(|folder| libraries(Path::new(folder))).collect()
}

fn in_working_folder() -> Vec<PathBuf> {
    let here = std::env::current_dir().unwrap_or_default();
    let mut found = Vec::new();
    for folder in here.ancestors() {
        found.extend([".venv", "venv"].iter().flat_map(|name| in_python(&folder.join(name))));
        let named_venv =
            |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("venv"));
        found.extend(entries(&folder.join("target")).into_iter().filter(named_venv).flat_map(|root| in_python(&root)));
    }
    found
}

fn imported_by_python() -> Vec<PathBuf> {
    let script = "import importlib.util as u; s = u.find_spec('onnxruntime'); print(s.submodule_search_locations[0] if s else '')";
    let output = Command::new("python3").args(["-c", script]).stdin(Stdio::null()).stderr(Stdio::null()).output();
    let Ok(output) = output else { return Vec::new() };
    let package = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    if package.is_empty() { Vec::new() } else { libraries(&Path::new(&package).join("capi")) }
}

/// The wheel inside a Python environment.
fn in_python(root: &Path) -> Vec<PathBuf> {
    let mut found = libraries(&root.join("Lib/site-packages/onnxruntime/capi"));
    for python in entries(&root.join("lib")) {
        found.extend(libraries(&python.join("site-packages/onnxruntime/capi")));
    }
    found
}

/// ONNX Runtime's libraries in a folder, by name; the provider plug-ins beside it are none.
fn libraries(folder: &Path) -> Vec<PathBuf> {
    let is_library = |path: &PathBuf| {
        let name = path.file_name().and_then(OsStr::to_str).unwrap_or_default();
        let versioned = |prefix: &str, suffix: &str| {
            name.strip_prefix(prefix)
                .and_then(|rest| rest.strip_suffix(suffix))
                .is_some_and(|rest| rest.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.'))
        };
        name == "onnxruntime.dll" || versioned("libonnxruntime.so", "") || versioned("libonnxruntime", ".dylib")
    };
    entries(folder).into_iter().filter(is_library).collect()
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let Ok(listing) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = listing.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::{in_python, version};

    #[test]
    fn a_wheel_is_found_in_a_python_environment_without_its_plug_ins() {
        let root = tempfile::tempdir().unwrap();
        let capi = root.path().join("lib/python3.12/site-packages/onnxruntime/capi");
        fs::create_dir_all(&capi).unwrap();
        for name in ["libonnxruntime.so.1.31.1", "libonnxruntime_providers_shared.so", "__init__.py"] {
            fs::write(capi.join(name), "").unwrap();
        }
        assert_eq!(in_python(root.path()), [capi.join("libonnxruntime.so.1.31.1")]);
    }

    #[test]
    fn the_version_is_told_by_the_file_or_the_branch() {
        let build = "ORT Build Info: git-branch=rel-1.30.2, git-commit-id=abc";
        assert_eq!(version(Path::new("/none/libonnxruntime.so.1.31.1"), build), "1.31.1");
        assert_eq!(version(Path::new("/none/libonnxruntime.so"), build), "1.30.2");
        assert_eq!(version(Path::new("/none/onnxruntime.dll"), ""), "unknown");
    }
}
