//! Compares two folders of runs, byte for byte.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Files that may differ between equal runs.
const MAY_DIFFER: [&str; 2] = ["environment.json", "timings.parquet"];

/// What two runs have in common.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Equality {
    /// Every byte of every file.
    Bytes,
    /// Every value and every table. Of a program with neither `version` nor `code` each run makes up keys, which
    /// recordings and Parquet files contain.
    Values,
}

/// The first difference, in words; `None` without a difference.
pub(crate) fn difference(reusing: &Path, fresh: &Path, equality: Equality) -> Option<String> {
    let (reusing_files, fresh_files) = (contents(reusing), contents(fresh));
    let names = reusing_files.keys().chain(fresh_files.keys());
    let has_keys =
        |name: &str| equality == Equality::Values && (name == "recording.mcap" || name.ends_with(".parquet"));
    let differs = |name: &&String| match (reusing_files.get(*name), fresh_files.get(*name)) {
        (Some(_), Some(_)) if has_keys(name) => false,
        (reusing, fresh) => reusing != fresh,
    };
    let mut different: Vec<&String> = names.filter(differs).collect();
    different.sort_unstable();
    different.dedup();
    let values = different_values(&reusing.join("recording.mcap"), &fresh.join("recording.mcap"), equality);
    if different.is_empty() && values.is_empty() {
        return None;
    }
    let lines: String = values.iter().map(|line| format!("\n      {line}")).collect();
    Some(format!("these files differ from those of --fresh: {different:?}{lines}"))
}

/// The files of a folder by their names in it.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(inner) = open.pop() {
        for entry in fs::read_dir(&inner).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
                continue;
            }
            let name = path.strip_prefix(folder).unwrap_or(&path).display().to_string();
            if !MAY_DIFFER.contains(&name.as_str()) {
                found.insert(name, fs::read(path).unwrap_or_default());
            }
        }
    }
    found
}

/// The messages in which two recordings differ: topic and time, at most a few.
fn different_values(reusing: &Path, fresh: &Path, equality: Equality) -> Vec<String> {
    let messages = |path: &Path| -> Vec<(String, u64, Vec<u8>)> {
        let bytes = fs::read(path).unwrap_or_default();
        let Ok(stream) = mcap::MessageStream::new(&bytes) else { return Vec::new() };
        let messages =
            stream.flatten().map(|message| (message.channel.topic.clone(), message.log_time, message.data.to_vec()));
        messages.filter(|(topic, ..)| equality == Equality::Bytes || !topic.ends_with("/commit")).collect()
    };
    let (reusing, fresh) = (messages(reusing), messages(fresh));
    let mut lines = Vec::new();
    for place in 0..reusing.len().max(fresh.len()) {
        let (found, wanted) = (reusing.get(place), fresh.get(place));
        if found == wanted {
            continue;
        }
        let name = |message: Option<&(String, u64, Vec<u8>)>| {
            message.map_or_else(|| "nothing".to_owned(), |(topic, time, _)| format!("{topic} at {time} ns"))
        };
        if name(found) == name(wanted) {
            lines.push(format!("{}: other content", name(wanted)));
        } else {
            lines.push(format!("{}: {} instead", name(wanted), name(found)));
            break;
        }
        if lines.len() > 5 {
            break;
        }
    }
    lines
}
