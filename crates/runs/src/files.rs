//! The names of files and folders of runs.

use std::path::{Path, PathBuf};

/// The folder of runs without an `--out`.
pub const FOLDER: &str = "runs";
/// The folder of an experiment's shards, among its runs: `<runs>/<experiment>/shards/<plan>/<shard>`.
pub const SHARDS: &str = "shards";
/// The recording in a run's folder.
pub const RECORDING: &str = "recording.mcap";
/// The timings of a run.
pub const TIMINGS: &str = "timings.parquet";
/// The drops and latencies of a live run, in its folder.
pub const LIVE: &str = "live.json";
/// In the folder of an unfinished run: a recording that cannot be resumed, because data, programs or engines changed
/// since, or because it is damaged. Its values are still reused by their cache keys.
pub const OUTDATED: &str = "recording.outdated.mcap";
/// The file that marks a run's folder.
pub const MARKER: &str = "depthloom-run.json";
/// Tags and a note of a run.
pub const NOTES: &str = "notes.json";
/// The folder of trained models in a run's folder.
pub const MODELS: &str = "models";

/// The recordings that were set aside in a run's folder, oldest first.
pub fn outdated_files(folder: &Path) -> Vec<PathBuf> {
    let files = (1..).map(|number| folder.join(outdated_name(number)));
    files.take_while(|file| file.symlink_metadata().is_ok()).collect()
}

/// The name for the next recording that is set aside in a run's folder.
pub fn next_outdated(folder: &Path) -> PathBuf {
    folder.join(outdated_name(outdated_files(folder).len() + 1))
}

/// Whether a file has the name of a recording that was set aside.
pub(crate) fn is_outdated(name: &str) -> bool {
    let number = name.strip_prefix("recording.outdated-").and_then(|rest| rest.strip_suffix(".mcap"));
    name == OUTDATED
        || number.and_then(|number| number.parse().ok()).is_some_and(|number| outdated_name(number) == name)
}

fn outdated_name(number: usize) -> String {
    if number < 2 { OUTDATED.to_owned() } else { format!("recording.outdated-{number}.mcap") }
}

#[cfg(test)]
mod tests {
    use super::{OUTDATED, is_outdated, next_outdated, outdated_files};

    #[test]
    fn recordings_that_are_set_aside_get_new_names() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in [OUTDATED, "recording.outdated-2.mcap", "recording.outdated-3.mcap"] {
            let next = next_outdated(folder.path());
            assert_eq!(next, folder.path().join(name));
            assert!(is_outdated(name));
            std::fs::write(next, name).expect("written");
        }
        assert_eq!(outdated_files(folder.path()).len(), 3);
        for name in ["recording.outdated-1.mcap", "recording.outdated-02.mcap", "recording.outdated-x.mcap"] {
            assert!(!is_outdated(name), "{name}");
        }
    }
}
