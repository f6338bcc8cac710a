//! Finds the runs in a folder.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use chrono::{DateTime, NaiveDateTime, Utc};
use depthloom_terminal::{CliError, ExitCode, say};

use crate::environment::{self, STAMP};
use crate::files::{MARKER, RECORDING, SHARDS};
use crate::run_folder::PathState;

/// The depth of folders that are searched: `runs/<experiment>/<time>` is two.
const DEPTH: u32 = 3;

/// A run's folder.
#[derive(Clone, Debug)]
pub struct FoundRun {
    /// Its name: its path in the folder of runs, with `/` between.
    pub name: String,
    /// The folder.
    pub path: PathBuf,
    /// When it finished; for an unfinished run, when it last wrote.
    pub time: DateTime<Utc>,
}

impl FoundRun {
    /// The last part of its name.
    pub fn last_name(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or_default()
    }

    /// Whether this is its name, or the last part of it, in full.
    pub fn is_named(&self, name: &str) -> bool {
        self.name == name || self.last_name() == name
    }

    /// The run in a folder; its name is relative to the folder of runs, or its path if it is elsewhere.
    ///
    /// # Errors
    /// If it is not a run, or its metadata cannot be read.
    pub fn at(path: &Path, folder: &Path) -> Result<Self, CliError> {
        let found = PathState::at(path).map_err(|error| {
            CliError::because(ExitCode::Usage, format_args!("failed to look at {}", path.display()), &error)
        })?;
        if found != PathState::Run {
            let what = match found {
                PathState::Other(what) => what,
                PathState::Empty => "an empty folder",
                PathState::Nothing | PathState::Run => "not there",
            };
            let stop = CliError::new(ExitCode::Usage, format!("{} is not a run: it is {what}", path.display()));
            return Err(stop.remedy("`depthloom runs` lists the runs; for a run elsewhere, give its folder"));
        }
        let name = path.strip_prefix(folder).unwrap_or(path).to_string_lossy().into_owned();
        Ok(Self { name, time: time(path), path: path.to_owned() })
    }

    /// Its time, for JSON.
    pub fn time_utc(&self) -> String {
        self.time.format("%Y-%m-%dT%H:%M:%SZ").to_string()
    }

    /// Whether it has its final name, and so has finished.
    pub fn has_finished(&self) -> bool {
        self.path.extension().is_none_or(|ending| ending != depthloom_durable::PARTIAL)
    }
}

/// All runs in a folder and in its folders, oldest first.
///
/// A symbolic link to a run is ignored, because removing it must not reach beyond the folder; the folder itself may be
/// a link.
///
/// # Errors
/// If the folder cannot be read. A folder in it that cannot be read only causes a warning.
pub fn all(folder: &Path) -> io::Result<Vec<FoundRun>> {
    let mut runs = Vec::new();
    look_into(folder, "", DEPTH, &|_| false, &mut runs)?;
    runs.sort_by(|a, b| (a.time, &a.name).cmp(&(b.time, &b.name)));
    Ok(runs)
}

/// The runs directly in a folder, without those whose folder `skips` names.
pub fn in_folder(folder: &Path, skips: &dyn Fn(&Path) -> bool) -> Vec<FoundRun> {
    let mut runs = Vec::new();
    // A folder that cannot be read has no reusable values.
    let _ = look_into(folder, "", 1, skips, &mut runs);
    runs
}

/// The shards of all experiments in a folder of runs, without those whose folder `skips` names. [`all`] leaves out
/// shards.
pub fn shards(folder: &Path, skips: &dyn Fn(&Path) -> bool) -> Vec<FoundRun> {
    let inner = |folder: PathBuf| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let plans = inner(folder.to_owned()).filter(|path| is_folder(path)).flat_map(|path| inner(path.join(SHARDS)));
    plans.filter(|path| is_folder(path)).flat_map(|path| in_folder(&path, skips)).collect()
}

fn look_into(
    folder: &Path,
    prefix: &str,
    depth: u32,
    skips: &dyn Fn(&Path) -> bool,
    runs: &mut Vec<FoundRun>,
) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let (path, file_name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
        if skips(&path) {
            continue;
        }
        let name = format!("{prefix}{}", file_name.to_string_lossy());
        match PathState::at(&path) {
            Ok(PathState::Run) => runs.push(FoundRun { name, time: time(&path), path }),
            Ok(PathState::Other(_)) if depth > 1 && file_name != SHARDS && is_folder(&path) => {
                if let Err(error) = look_into(&path, &format!("{name}/"), depth - 1, skips, runs) {
                    say(format_args!("warning: failed to look into {}: {error}", path.display()));
                }
            }
            // Removed in the meantime, or not a folder.
            _ => {}
        }
    }
    Ok(())
}

/// False for a symbolic link to a folder.
fn is_folder(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_dir())
}

/// When a run finished, according to its own record, because a copy has other file times.
fn time(folder: &Path) -> DateTime<Utc> {
    let environment = environment::read(folder);
    let finished = environment["finished_utc"].as_str();
    let finished = finished.and_then(|stamp| NaiveDateTime::parse_from_str(stamp, STAMP).ok());
    let written = |name: &str| fs::metadata(folder.join(name)).and_then(|metadata| metadata.modified()).ok();
    let last = || written(RECORDING).or_else(|| written(MARKER)).unwrap_or(SystemTime::UNIX_EPOCH);
    finished.map_or_else(|| last().into(), |time| time.and_utc())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::all;
    use crate::files::MARKER;

    fn make(folder: &Path, stamp: &str) {
        fs::create_dir_all(folder).unwrap();
        fs::write(folder.join(MARKER), "").unwrap();
        fs::write(folder.join("environment.json"), format!("{{\"finished_utc\": \"{stamp}\"}}")).unwrap();
    }

    #[test]
    fn runs_are_sorted_by_their_recorded_time_and_links_are_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("runs");
        make(&root.join("b/second"), "2026-11-22T02-00-00Z");
        make(&root.join("first"), "2026-11-22T01-00-00Z");
        make(&root.join("a/third"), "2026-11-22T03-00-00Z");
        // A run in a run, one that is too deep, and a foreign folder.
        make(&root.join("first/inner"), "2026-11-22T04-00-00Z");
        make(&root.join("a/b/c/deep"), "2026-11-22T05-00-00Z");
        fs::create_dir_all(root.join("notes")).unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(root.join("a"), root.join("link")).unwrap();
        let names: Vec<String> = all(&root).unwrap().into_iter().map(|run| run.name).collect();
        assert_eq!(names, ["first", "b/second", "a/third"]);
        assert!(all(&root.join("none")).is_err());
    }
}
