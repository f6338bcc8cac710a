//! Resolves the name of a run: a path, the beginning of a name, or the latest.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use depthloom_terminal::{CliError, ExitCode};

use crate::found::{FoundRun, all};

/// The newest finished run; after `experiment/`, the newest one whose name begins so.
const LATEST: &str = "@latest";

/// The number of runs that a message about an ambiguous name lists.
const MOST_LISTED: usize = 4;

/// The run that `run` names: an existing file or folder; `@latest`, or `EXPERIMENT/@latest`; the beginning of a run's
/// name in the folder of runs, or of its last part, if only one run matches.
///
/// If nothing matches, returns `run` unchanged: opening it then reports the error.
///
/// # Errors
/// If several runs match, or there is no latest.
pub fn named(run: &Path, folder: &Path) -> Result<PathBuf, CliError> {
    find(run, folder, by_beginning)
}

/// As [`named`], but requires the full name: for commands that remove runs. After a run is removed, the beginning of
/// its name may match another run.
///
/// # Errors
/// As [`named`], if `run` is only the beginning of a name, and if it is the name of both a run here and another one in
/// `folder`.
pub fn named_in_full(run: &Path, folder: &Path) -> Result<PathBuf, CliError> {
    if let Some(other) = namesake(run, folder) {
        let what = format!("`{}` names two runs: one here, and one in {}", run.display(), folder.display());
        let remedy = format!("write the path: `./{}` or `{}`", run.display(), other.display());
        return Err(CliError::usage(what, remedy));
    }
    find(run, folder, |runs, text, folder| {
        let found = by_beginning(runs, text, folder)?;
        let Some(longer) = runs.iter().find(|run| found.as_ref() == Some(&run.path) && !run.is_named(text)) else {
            return Ok(found);
        };
        let what = format!("no run in {} is named `{text}`", folder.display());
        Err(CliError::usage(what, format!("give the full name: `{}` begins with it", longer.name)))
    })
}

/// The run in `folder` named `run`, if another file in the current directory has this name too.
fn namesake(run: &Path, folder: &Path) -> Option<PathBuf> {
    let text = run.to_str().filter(|text| !text.contains(std::path::is_separator))?;
    let here = run.canonicalize().ok()?;
    let runs = all(folder).unwrap_or_default();
    let other = runs.into_iter().find(|found| found.is_named(text))?.path;
    other.canonicalize().is_ok_and(|other| other != here).then_some(other)
}

fn find(
    run: &Path,
    folder: &Path,
    by_name: impl Fn(&[FoundRun], &str, &Path) -> Result<Option<PathBuf>, CliError>,
) -> Result<PathBuf, CliError> {
    let is_nothing = std::fs::symlink_metadata(run).is_err_and(|error| error.kind() == ErrorKind::NotFound);
    let Some(text) = run.to_str().filter(|text| is_nothing && !text.is_empty()) else { return Ok(run.to_owned()) };
    let runs = all(folder).unwrap_or_default();
    match text.strip_suffix(LATEST) {
        Some(prefix) if prefix.is_empty() || prefix.ends_with('/') => latest(&runs, prefix, folder),
        _ => by_name(&runs, text, folder).map(|found| found.unwrap_or_else(|| run.to_owned())),
    }
}

fn latest(runs: &[FoundRun], prefix: &str, folder: &Path) -> Result<PathBuf, CliError> {
    let candidates = || runs.iter().filter(|run| run.name.starts_with(prefix));
    let newest = candidates().rfind(|run| run.has_finished());
    newest.map(|run| run.path.clone()).ok_or_else(|| {
        let suffix = if prefix.is_empty() { String::new() } else { format!(" of `{}`", prefix.trim_end_matches('/')) };
        let stop = CliError::new(ExitCode::Usage, format!("no run{suffix} in {} has finished", folder.display()));
        match candidates().next_back() {
            Some(run) => stop.remedy(format!("it is running, or was interrupted: {}", run.name)),
            None => stop.remedy("`depthloom runs` lists the runs; for a run elsewhere, give its path"),
        }
    })
}

fn by_beginning(runs: &[FoundRun], text: &str, folder: &Path) -> Result<Option<PathBuf>, CliError> {
    // A full name wins, even if other names begin with it.
    let exact: Vec<&FoundRun> = runs.iter().filter(|run| run.is_named(text)).collect();
    let matching = match exact.as_slice() {
        [] => runs.iter().filter(|run| run.name.starts_with(text) || run.last_name().starts_with(text)).collect(),
        _ => exact,
    };
    match matching.as_slice() {
        [] => Ok(None),
        [run] => Ok(Some(run.path.clone())),
        several => {
            let names: Vec<&str> = several.iter().rev().take(MOST_LISTED).map(|run| run.name.as_str()).collect();
            let others = if several.len() > MOST_LISTED { ", ..." } else { "" };
            let what = format!("`{text}` names {} runs in {}", several.len(), folder.display());
            let remedy = format!("write more of the name ({}{others}), or @latest", names.join(", "));
            Err(CliError::usage(what, remedy))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    use super::{named, named_in_full, namesake};
    use crate::files::MARKER;

    fn folder_of(runs: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, stamp) in runs {
            let run = folder.path().join(name);
            fs::create_dir_all(&run).unwrap();
            fs::write(run.join(MARKER), "").unwrap();
            fs::write(run.join("environment.json"), format!("{{\"finished_utc\": \"{stamp}\"}}")).unwrap();
        }
        folder
    }

    #[test]
    fn a_name_here_and_in_the_folder_is_ambiguous() {
        let folder = folder_of(&[("src", "2026-11-21T10-00-00Z"), ("other", "2026-11-21T10-00-00Z")]);
        // Tests run in the folder of their crate, which has a folder `src` too.
        assert_eq!(namesake(Path::new("src"), folder.path()), Some(folder.path().join("src")));
        let error = named_in_full(Path::new("src"), folder.path()).unwrap_err();
        assert!(error.message.what.starts_with("`src` names two runs: "), "{}", error.message.what);
        assert_eq!(named_in_full(Path::new("./src"), folder.path()).unwrap(), PathBuf::from("./src"));
        let other = folder.path().join("other");
        assert_eq!(named_in_full(Path::new("other"), folder.path()).unwrap(), other);
    }

    #[test]
    fn a_run_is_found_by_a_unique_beginning_of_its_name() {
        let folder = folder_of(&[
            ("table1/2026-11-21T10-00-00Z", "2026-11-21T10-00-00Z"),
            ("table1/2026-11-22T10-00-00Z", "2026-11-22T10-00-00Z"),
            ("look/2026-11-20T10-00-00Z", "2026-11-22T09-00-00Z"),
            ("first", "2026-11-19T10-00-00Z"),
            ("first-2", "2026-11-19T11-00-00Z"),
            ("later.partial", "2026-11-23T11-00-00Z"),
        ]);
        let resolve = |text: &str| named(Path::new(text), folder.path());
        let found = |text: &str| resolve(text).unwrap().strip_prefix(folder.path()).unwrap().to_owned();
        for (text, run) in [
            ("look", "look/2026-11-20T10-00-00Z"),
            ("2026-11-20", "look/2026-11-20T10-00-00Z"),
            ("table1/2026-11-21", "table1/2026-11-21T10-00-00Z"),
            ("first", "first"),
            ("first-", "first-2"),
            ("later", "later.partial"),
            ("@latest", "table1/2026-11-22T10-00-00Z"),
            ("look/@latest", "look/2026-11-20T10-00-00Z"),
        ] {
            assert_eq!(found(text), PathBuf::from(run), "{text}");
        }
        let several = resolve("table1").unwrap_err();
        assert!(several.message.what.starts_with("`table1` names 2 runs in "), "{}", several.message.what);
        assert!(several.message.remedy.unwrap().contains("table1/2026-11-22T10-00-00Z, table1/2026-11-21T10-00-00Z"));
        assert!(resolve("later/@latest").unwrap_err().message.what.starts_with("no run of `later` in "));
        // A name that matches nothing is returned unchanged; an existing file wins.
        assert_eq!(resolve("none").unwrap(), PathBuf::from("none"));
        let here = folder.path().join("first");
        assert_eq!(named(&here, folder.path()).unwrap(), here);
    }
}
