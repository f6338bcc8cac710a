//! Where this machine has ONNX Runtime: `ORT_DYLIB_PATH`, the system's folders, active Python environments, and those
//! whose
//! programs are on the PATH. No other folder is searched and no program is run, because an experiment may come from a
//! stranger. The first library that loads and is new enough is used.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use ort::logging::LogLevel;

use super::engine::Engine;
use super::library;

pub(crate) const REMEDY: &str = "activate a Python environment that has it (`pip install onnxruntime`), or set ORT_DYLIB_PATH to libonnxruntime.so of version 1.24 or newer";

#[cfg(feature = "tract")]
pub(crate) const REMEDY_IF_NAMED: &str = "unset ORT_DYLIB_PATH for what this machine has, let it name libonnxruntime.so of version 1.24 or newer, or set DEPTHLOOM_ONNX_ENGINE=tract for the engine inside this program";
#[cfg(not(feature = "tract"))]
pub(crate) const REMEDY_IF_NAMED: &str =
    "unset ORT_DYLIB_PATH for what this machine has, or let it name libonnxruntime.so of version 1.24 or newer";

pub(crate) enum Missing {
    /// `ORT_DYLIB_PATH` names a library that cannot be used.
    Named(String),
    /// The message, and why each library that was found cannot be used.
    NoneFound(String, Vec<String>),
}

pub(crate) fn load() -> Result<Engine, Missing> {
    if let Some(path) = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()) {
        // Named explicitly: another one would surprise.
        let named = |what| Missing::Named(format!("ORT_DYLIB_PATH: {what}"));
        let path = std::path::absolute(path).map_err(|error| named(error.to_string()))?;
        if path.is_dir() {
            return Err(named(format!("{} is a folder, not the library in it", path.display())));
        }
        if !path.is_file() {
            return Err(named(format!("there is no file {}", path.display())));
        }
        library::check(&path).map_err(named)?;
        return open(path, "ORT_DYLIB_PATH", Vec::new()).map_err(named);
    }
    let mut refused: Vec<String> = Vec::new();
    for (found_by, folder) in places() {
        for path in libraries(&folder) {
            match library::check(&path) {
                // `ort` loads one library per process: its result for this one is final.
                Ok(()) => match open(path, found_by, refused.clone()) {
                    Ok(engine) => return Ok(engine),
                    Err(what) => {
                        refused.push(what);
                        return Err(none_found(refused));
                    }
                },
                Err(what) => refused.push(what),
            }
        }
    }
    Err(none_found(refused))
}

fn none_found(refused: Vec<String>) -> Missing {
    let looked =
        "this machine has no ONNX Runtime: neither in the system's library folders nor in an active Python environment";
    let text = match refused.as_slice() {
        [] => looked.to_owned(),
        refused => format!("{looked} is one that can be used ({})", refused.join("; ")),
    };
    Missing::NoneFound(text, refused)
}

/// Folders searched when no library is named, each with what led to it.
pub(crate) fn places() -> Vec<(&'static str, PathBuf)> {
    let variable = |name: &'static str| std::env::var_os(name).unwrap_or_default();
    // A relative path would depend on the working directory.
    let loader = if cfg!(target_os = "macos") { "DYLD_LIBRARY_PATH" } else { "LD_LIBRARY_PATH" };
    let of_loader: Vec<PathBuf> = std::env::split_paths(&variable(loader)).filter(|path| path.is_absolute()).collect();
    let system = [
        "/usr/local/lib",
        "/usr/lib",
        "/usr/lib64",
        "/usr/lib/x86_64-linux-gnu",
        "/usr/lib/aarch64-linux-gnu",
        "/opt/onnxruntime/lib",
        "/opt/homebrew/lib",
    ];
    let mut places: Vec<(&'static str, PathBuf)> = of_loader.into_iter().map(|folder| (loader, folder)).collect();
    places.extend(system.map(|folder| ("system", PathBuf::from(folder))));
    for name in ["VIRTUAL_ENV", "CONDA_PREFIX"] {
        let root = PathBuf::from(variable(name));
        if root.is_absolute() {
            places.extend(in_python(&root).into_iter().map(|folder| (name, folder)));
        }
    }
    let of_path = environments_of(&variable("PATH"));
    places.extend(of_path.iter().flat_map(|root| in_python(root)).map(|folder| ("PATH", folder)));
    places
}

/// Python environments (`pyvenv.cfg`) whose programs are on `path`.
fn environments_of(path: &OsStr) -> Vec<PathBuf> {
    let folders = std::env::split_paths(path).filter(|folder| folder.is_absolute());
    let roots = folders.filter_map(|folder| folder.parent().map(Path::to_owned));
    roots.filter(|root| root.join("pyvenv.cfg").is_file()).collect()
}

fn open(path: PathBuf, found_by: &'static str, refused: Vec<String>) -> Result<Engine, String> {
    let environment = ort::init_from(&path).map_err(|error| error.to_string())?;
    let environment = environment.with_name("depthloom").with_telemetry(false).build().map_err(|e| e.to_string())?;
    // Its log messages for developers would disturb progress bars; failures are returned as errors.
    environment.set_log_level(LogLevel::Error);
    let version = version(&path, ort::info());
    Ok(Engine::of_library(path, found_by, version, environment, refused))
}

/// From the file's name (`libonnxruntime.so.1.31.1`, links followed) or the branch of the build (`rel-1.31.1`).
fn version(path: &Path, build: &str) -> String {
    let file = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let file = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let named = file.split_once(".so.").map(|(_, version)| version.to_owned());
    let branch = || build.split_once("git-branch=rel-").and_then(|(_, rest)| rest.split(',').next()).map(str::to_owned);
    named.or_else(branch).unwrap_or_else(|| "unknown".to_owned())
}

fn in_python(root: &Path) -> Vec<PathBuf> {
    let package = "site-packages/onnxruntime/capi";
    let is_python = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("python"));
    let versions = entries(&root.join("lib")).into_iter().filter(is_python).map(|python| python.join(package));
    std::iter::once(root.join("Lib").join(package)).chain(versions).filter(|folder| folder.is_dir()).collect()
}

/// Without the provider plug-ins in its folder.
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

    use super::{environments_of, in_python, libraries, version};

    #[test]
    fn a_virtual_environment_on_the_path_is_one_to_look_in() {
        let root = tempfile::tempdir().unwrap();
        for name in ["venv/bin", "other/bin"] {
            fs::create_dir_all(root.path().join(name)).unwrap();
        }
        fs::write(root.path().join("venv/pyvenv.cfg"), "").unwrap();
        let path =
            std::env::join_paths([root.path().join("other/bin"), "venv/bin".into(), root.path().join("venv/bin")]);
        assert_eq!(environments_of(&path.unwrap()), [root.path().join("venv")]);
    }

    #[test]
    fn a_wheel_is_found_in_a_python_environment_without_its_plug_ins() {
        let root = tempfile::tempdir().unwrap();
        let capi = root.path().join("lib/python3.12/site-packages/onnxruntime/capi");
        fs::create_dir_all(&capi).unwrap();
        for name in ["libonnxruntime.so.1.31.1", "libonnxruntime_providers_shared.so", "__init__.py"] {
            fs::write(capi.join(name), "").unwrap();
        }
        assert_eq!(in_python(root.path()), [capi.as_path()]);
        assert_eq!(libraries(&capi), [capi.join("libonnxruntime.so.1.31.1")]);
    }

    #[test]
    fn the_version_comes_from_the_file_or_the_branch() {
        let build = "ORT Build Info: git-branch=rel-1.30.2, git-commit-id=abc";
        assert_eq!(version(Path::new("/none/libonnxruntime.so.1.31.1"), build), "1.31.1");
        assert_eq!(version(Path::new("/none/libonnxruntime.so"), build), "1.30.2");
        assert_eq!(version(Path::new("/none/onnxruntime.dll"), ""), "unknown");
    }
}
