//! What the program answered: the files it wrote and what it printed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::child::Ended;

/// Files that differ between two undisturbed runs: what they are for.
const OF_THE_MOMENT: [&str; 2] = ["environment.json", "timings.parquet"];

/// What the program answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Answer {
    pub stdout: String,
    /// By path below the folder.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl Answer {
    /// What a child printed and left in a folder.
    pub(crate) fn new(ended: &Ended, folder: &Path) -> Self {
        Self { stdout: ended.stdout.clone(), files: files(folder) }
    }

    /// In what another answer is not this one.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        if let Some(what) = self.difference_in_files(other) {
            return Some(what);
        }
        (self.stdout != other.stdout).then(|| {
            let lines = self.stdout.lines().zip(other.stdout.lines());
            let line = lines.clone().find(|(ours, theirs)| ours != theirs).map_or("its length", |(_, theirs)| theirs);
            format!("what was printed differs: {line}")
        })
    }

    /// In which files another answer is not this one.
    pub(crate) fn difference_in_files(&self, other: &Self) -> Option<String> {
        let names: BTreeSet<&String> = self.files.keys().chain(other.files.keys()).collect();
        let is_other = |name: &&String| self.files.get(*name) != other.files.get(*name);
        let differing: Vec<&str> = names.into_iter().filter(is_other).map(String::as_str).collect();
        (!differing.is_empty()).then(|| format!("{} differ", differing.join(", ")))
    }

    /// The same without the recording: what a report of it gives.
    pub(crate) fn without_recording(mut self) -> Self {
        self.files.retain(|name, _| !name.ends_with(".mcap") && !name.starts_with("experiment"));
        self
    }
}

/// Every file below a folder that a person keeps.
pub(crate) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    collect(folder, "", &mut found);
    found
}

fn collect(folder: &Path, prefix: &str, found: &mut BTreeMap<String, Vec<u8>>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if OF_THE_MOMENT.contains(&name.as_str()) || name.starts_with('.') {
            continue;
        }
        let path = entry.path();
        if path.is_dir() {
            collect(&path, &format!("{prefix}{name}/"), found);
        } else if path.is_file() {
            let bytes = fs::read(&path).unwrap_or_default();
            let bytes = if name == "report.html" { numbers_of_page(&bytes).unwrap_or(bytes) } else { bytes };
            found.insert(format!("{prefix}{name}"), bytes);
        }
    }
}

/// The numbers of a page, except times and the recording's condition, which is judged by the printed text, and except
/// its pictures, of which a damaged one is omitted and counted. `None` if it is not a page.
fn numbers_of_page(page: &[u8]) -> Option<Vec<u8>> {
    let page = std::str::from_utf8(page).ok()?;
    let (_, rest) = page.split_once("id=\"data\">")?;
    let (data, _) = rest.split_once("</script>")?;
    let data: serde_json::Value = serde_json::from_str(data).ok()?;
    let numbers = ["table", "estimates", "distances", "scores", "curves", "failures"];
    let numbers: Option<Vec<&serde_json::Value>> = numbers.into_iter().map(|name| data.get(name)).collect();
    Some(serde_json::json!(numbers?).to_string().into_bytes())
}
