//! Which run is meant: a path, the beginning of a name, or the latest.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use depthloom_terminal::{CliError, ExitCode};

use crate::found::{FoundRun, all};

/// The newest run that is over; behind `experiment/` the newest of those whose names begin so.
const LATEST: &str = "@latest";

/// How many runs are told where one is wanted.
const TOLD: usize = 4;

/// The run that `run` names: a file or folder that is there; `@latest`, or `EXPERIMENT/@latest`; the beginning of a
/// name in the folder of runs, or of the last part of one, if no other run's begins so.
///
/// What names none stays as it is: who opens it says what is wrong with it.
///
/// # Errors
/// If several runs are meant, or there is no latest.
pub fn named(run: &Path, folder: &Path) -> Result<PathBuf, CliError> {
    find(run, folder, by_beginning)
}

/// As [`named`], but a name is given in full: for commands that remove runs. Once a run is gone, the beginning of its
/// name may be another's.
///
/// # Errors
/// As [`named`], if `run` is only the beginning of a name, and if it is the name of a run here and of another one in
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
        Err(CliError::usage(what, format!("give the name in full: `{}` begins so", longer.name)))
    })
}

/// The run in `folder` that has the name `run`, where something else in the current directory has this name too.
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
        Some(of) if of.is_empty() || of.ends_with('/') => latest(&runs, of, folder),
        _ => by_name(&runs, text, folder).map(|found| found.unwrap_or_else(|| run.to_owned())),
    }
}

fn latest(runs: &[FoundRun], of: &str, folder: &Path) -> Result<PathBuf, CliError> {
    let of_these = || runs.iter().filter(|run| run.name.starts_with(of));
    let newest = of_these().rfind(|run| run.is_over());
    newest.map(|run| run.path.clone()).ok_or_else(|| {
        let of = if of.is_empty() { String::new() } else { format!(" of `{}`", of.trim_end_matches('/')) };
        let stop = CliError::new(ExitCode::Usage, format!("no run{of} in {} has finished", folder.display()));
        match of_these().next_back() {
            Some(run) => stop.remedy(format!("one is running, or was interrupted: {}", run.name)),
            None => stop.remedy("`depthloom runs` lists those there are; elsewhere a run is named by its path"),
        }
    })
}

fn by_beginning(runs: &[FoundRun], text: &str, folder: &Path) -> Result<Option<PathBuf>, CliError> {
    // A name in full is that run's, whatever others begin with it.
    let whole: Vec<&FoundRun> = runs.iter().filter(|run| run.is_named(text)).collect();
    let meant = match whole.as_slice() {
        [] => runs.iter().filter(|run| run.name.starts_with(text) || run.last_name().starts_with(text)).collect(),
        _ => whole,
    };
    match meant.as_slice() {
        [] => Ok(None),
        [run] => Ok(Some(run.path.clone())),
        several => {
            let names: Vec<&str> = several.iter().rev().take(TOLD).map(|run| run.name.as_str()).collect();
            let others = if several.len() > TOLD { ", ..." } else { "" };
            let what = format!("`{text}` names {} runs in {}", several.len(), folder.display());
            let remedy = format!("write more of a name ({}{others}), or @latest", names.join(", "));
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
    fn a_run_is_named_by_what_only_it_begins_with() {
        let folder = folder_of(&[
            ("table1/2026-11-21T10-00-00Z", "2026-11-21T10-00-00Z"),
            ("table1/2026-11-22T10-00-00Z", "2026-11-22T10-00-00Z"),
            ("look/2026-11-20T10-00-00Z", "2026-11-22T09-00-00Z"),
            ("first", "2026-11-19T10-00-00Z"),
            ("first-2", "2026-11-19T11-00-00Z"),
            ("later.partial", "2026-11-23T11-00-00Z"),
        ]);
        let of = |text: &str| named(Path::new(text), folder.path());
        let found = |text: &str| of(text).unwrap().strip_prefix(folder.path()).unwrap().to_owned();
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
        let several = of("table1").unwrap_err();
        assert!(several.message.what.starts_with("`table1` names 2 runs in "), "{}", several.message.what);
        assert!(several.message.remedy.unwrap().contains("table1/2026-11-22T10-00-00Z, table1/2026-11-21T10-00-00Z"));
        assert!(of("later/@latest").unwrap_err().message.what.starts_with("no run of `later` in "));
        // What is none is told by who opens it, and what is there under that name is meant.
        assert_eq!(of("none").unwrap(), PathBuf::from("none"));
        let here = folder.path().join("first");
        assert_eq!(named(&here, folder.path()).unwrap(), here);
    }
}
