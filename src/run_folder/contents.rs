//! What a run's folder holds: whatever else lies there is somebody's, and keeps the folder from being replaced.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::Path;

use super::marker::MARKER;

/// The files that a run and its reports write.
const FILES: [&str; 18] = [
    MARKER,
    "recording.mcap",
    "experiment.yaml",
    "experiment.resolved.yaml",
    "environment.json",
    "timings.parquet",
    "scores.csv",
    "table.csv",
    "table.md",
    "table.tex",
    "table.parquet",
    "error_vs_distance.csv",
    "error_vs_distance.parquet",
    "error_vs_distance.svg",
    "true_distances.csv",
    "learning_curves.csv",
    "learning_curves.parquet",
    "learning_curves.svg",
];
/// The folders, and the endings of what they hold.
const FOLDERS: [(&str, &[&str]); 2] = [("experiment", &["yaml", "yml"]), ("models", &["onnx"])];

/// What lies in the folder that no run wrote there, if anything; of several the first by name.
pub fn foreign(folder: &Path) -> io::Result<Option<OsString>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let (name, kind) = (entry.file_name(), entry.file_type()?);
        let endings = FOLDERS.iter().find(|(folder, _)| name == *folder).map(|(_, endings)| *endings);
        let is_ours = match endings {
            Some(endings) => kind.is_dir() && holds_only(&entry.path(), endings)?,
            None => kind.is_file() && is_file_of_a_run(&name.to_string_lossy()),
        };
        if !is_ours {
            names.push(name);
        }
    }
    Ok(names.into_iter().min())
}

/// Also one that was never whole: `<name>.partial`, `<name>.1.partial`.
fn is_file_of_a_run(name: &str) -> bool {
    let written = name.strip_suffix(depthloom_durable::PARTIAL).and_then(|name| name.strip_suffix('.'));
    let of = |written: &str| FILES.iter().any(|file| written == *file || is_numbered(written, file));
    FILES.contains(&name) || written.is_some_and(of)
}

fn is_numbered(name: &str, file: &str) -> bool {
    let number = name.strip_prefix(file).and_then(|rest| rest.strip_prefix('.'));
    number.is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()))
}

/// Whether all files in a folder, and in those in it, have one of these endings, or are about to.
fn holds_only(folder: &Path, endings: &[&str]) -> io::Result<bool> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let (path, kind) = (entry.path(), entry.file_type()?);
        let has_ending = || {
            let ending = path.extension().and_then(|ending| ending.to_str());
            ending.is_some_and(|ending| endings.contains(&ending) || ending == depthloom_durable::PARTIAL)
        };
        let is_ours = if kind.is_dir() { holds_only(&path, endings)? } else { kind.is_file() && has_ending() };
        if !is_ours {
            return Ok(false);
        }
    }
    Ok(true)
}
