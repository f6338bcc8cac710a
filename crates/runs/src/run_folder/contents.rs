//! The content of a run's folder. Any other file prevents that the folder is replaced.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::Path;

use depthloom_analysis::{PAGE, SAMPLES};

use crate::files::{LIVE, MARKER, MODELS, NOTES, OUTDATED, RECORDING, TIMINGS, is_outdated};

const FILES: [&str; 10] = [
    MARKER,
    RECORDING,
    OUTDATED,
    "experiment.yaml",
    "experiment.resolved.yaml",
    "environment.json",
    TIMINGS,
    LIVE,
    NOTES,
    "programs.log",
];
const REPORT: [&str; 15] = [
    "scores.csv",
    "scores.parquet",
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
    SAMPLES,
    PAGE,
];
/// The folders, and the extensions of the files in them.
const FOLDERS: [(&str, &[&str]); 2] = [("experiment", &["yaml", "yml"]), (MODELS, &["onnx", "json"])];

/// Marks a folder that is not a run's, but has a report that depthloom wrote and may replace.
const REPORT_MARKER: &str = ".depthloom-report";

/// A file or folder with a name of a report's, in a folder without the marker: it is foreign.
pub fn in_the_way_of_a_report(folder: &Path) -> Option<&'static str> {
    let is_there = |name: &str| fs::symlink_metadata(folder.join(name));
    if is_there(REPORT_MARKER).is_ok_and(|marker| marker.is_file()) {
        return None;
    }
    // `report` does not write samples.
    let names = REPORT.into_iter().filter(|name| *name != SAMPLES);
    names.chain([MODELS]).find(|name| is_there(name).is_ok())
}

/// Marks a folder in which nothing was [in the way of a report](in_the_way_of_a_report).
///
/// # Errors
/// If the marker cannot be written.
pub fn mark_for_reports(folder: &Path) -> io::Result<()> {
    depthloom_durable::write(&folder.join(REPORT_MARKER), b"")
}

/// Removes what killed writers left in a run's folder, which the caller has locked.
pub(super) fn remove_abandoned(folder: &Path) {
    let folders = FOLDERS.iter().map(|(below, _)| folder.join(below));
    for folder in folders.filter(|folder| fs::symlink_metadata(folder).is_ok_and(|there| there.is_dir())) {
        depthloom_durable::remove_abandoned(&folder);
    }
    depthloom_durable::remove_abandoned(folder);
}

/// Removes the reports in a folder before its run resumes: they cover only the frames so far.
pub(super) fn remove_reports(folder: &Path) -> io::Result<()> {
    for name in REPORT {
        match fs::remove_file(folder.join(name)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

/// The first foreign file or folder by name, if any: one that no run wrote.
pub(super) fn foreign(folder: &Path) -> io::Result<Option<OsString>> {
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

/// Includes what a killed writer left: `.<name>.<random>.partial`, before 0.2 `<name>.partial`.
fn is_file_of_a_run(name: &str) -> bool {
    let before = name.strip_suffix(depthloom_durable::PARTIAL).and_then(|name| name.strip_suffix('.'));
    let written = [Some(name), depthloom_durable::final_name(name), before];
    is_outdated(name) || FILES.iter().chain(&REPORT).any(|file| written.contains(&Some(*file)))
}

/// Whether all files in a folder and its subfolders have one of these extensions, also with a suffix of unfinished
/// files.
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

#[cfg(test)]
mod tests {
    use super::{FILES, FOLDERS, REPORT};

    #[test]
    fn the_guide_describes_every_file_of_a_run() {
        let page = include_str!("../../../../docs/reference/files.md");
        let folders = FOLDERS.iter().map(|(folder, _)| format!("{folder}/"));
        let files = FILES.iter().chain(&REPORT).map(|file| (*file).to_owned());
        let missed: Vec<String> = files.chain(folders).filter(|name| !page.contains(&format!("`{name}`"))).collect();
        assert_eq!(missed, [""; 0], "docs/reference/files.md does not describe these");
    }
}
