//! What a run's folder holds: whatever else lies there is somebody's, and keeps the folder from being replaced.

use std::ffi::OsString;
use std::fs;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::Path;

use depthloom_analysis::{LEADING, PAGE, PAGE_MARK, TABLE_MARK};

use super::marker::MARKER;
use crate::earlier::OUTDATED;

/// The files that a run writes.
const FILES: [&str; 7] = [
    MARKER,
    "recording.mcap",
    OUTDATED,
    "experiment.yaml",
    "experiment.resolved.yaml",
    "environment.json",
    "timings.parquet",
];
/// And its reports.
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
    "samples.parquet",
    PAGE,
];
/// The folders, and the endings of what they hold.
const FOLDERS: [(&str, &[&str]); 2] = [("experiment", &["yaml", "yml"]), ("models", &["onnx"])];

/// A table or a page with the name of a report's that no report wrote.
pub fn not_of_a_report(folder: &Path) -> Option<String> {
    // A report's tables, and how those of 0.1.0 began.
    const TABLES: [(&str, &str); 5] = [
        ("scores", "stage,position,"),
        ("table", "estimator,scored_on,"),
        ("error_vs_distance", "estimator,bin_m,"),
        ("true_distances", "bin_m,count"),
        ("learning_curves", "curve,step,"),
    ];
    let now = LEADING[..2].join(",");
    if first_bytes(&folder.join(PAGE)).is_some_and(|first| !first.starts_with(PAGE_MARK.as_bytes())) {
        return Some(PAGE.to_owned());
    }
    TABLES.into_iter().find_map(|(table, before)| {
        let (csv, parquet) = (format!("{table}.csv"), format!("{table}.parquet"));
        let first = first_bytes(&folder.join(&csv));
        let begins = |columns: &str| first.as_ref().is_some_and(|first| first.starts_with(columns.as_bytes()));
        if first.is_some() && !begins(&now) && !begins(before) {
            return Some(csv);
        }
        // Parquet files of 0.1.0 do not say what they are, but the CSV file beside them does.
        let says_it = |last: Vec<u8>| last.windows(TABLE_MARK.len()).any(|part| part == TABLE_MARK.as_bytes());
        let is_another = last_bytes(&folder.join(&parquet)).is_some_and(|last| !says_it(last) && !begins(before));
        is_another.then_some(parquet)
    })
}

/// A file, if one is there: a pipe would be waited for.
fn file(path: &Path) -> Option<fs::File> {
    fs::metadata(path).is_ok_and(|there| there.is_file()).then(|| fs::File::open(path).ok()).flatten()
}

/// How a file begins; `None` if it cannot be read, and so not be replaced either.
fn first_bytes(path: &Path) -> Option<Vec<u8>> {
    let mut first = Vec::new();
    file(path)?.take(64).read_to_end(&mut first).ok()?;
    Some(first)
}

/// How a file ends: in a Parquet file, with what it says of itself.
fn last_bytes(path: &Path) -> Option<Vec<u8>> {
    const MOST: u64 = 64 << 10;
    let mut last = Vec::new();
    let mut file = file(path)?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(MOST))).ok()?;
    file.read_to_end(&mut last).ok()?;
    Some(last)
}

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
    let mut files = FILES.iter().chain(&REPORT);
    files.any(|file| name == *file || written.is_some_and(|of| of == *file || is_numbered(of, file)))
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

#[cfg(test)]
mod tests {
    use super::{FILES, FOLDERS, REPORT};

    #[test]
    fn every_file_of_a_run_stands_in_the_guide() {
        let page = include_str!("../../docs/reference/files.md");
        let folders = FOLDERS.iter().map(|(folder, _)| format!("{folder}/"));
        let files = FILES.iter().chain(&REPORT).map(|file| (*file).to_owned());
        let missed: Vec<String> = files.chain(folders).filter(|name| !page.contains(&format!("`{name}`"))).collect();
        assert_eq!(missed, [""; 0], "docs/reference/files.md does not say what these are");
    }
}
