//! Commands of clusters: submit an experiment as jobs, see how far they are, and run one.

pub(crate) mod cancel;
pub(crate) mod local;
pub(crate) mod requests;
pub(crate) mod retry;
pub(crate) mod scratch;
pub(crate) mod show;
pub(crate) mod start;
pub(crate) mod submit;

use std::path::{Path, PathBuf};

use depthloom_graphs::{Registry, counted};
use depthloom_jobs::{JOBS, Submission, slurm};
use depthloom_runs::SHARDS;
use depthloom_terminal::{CliError, ExitCode, say};

use crate::args::{JobsArgs, JobsCommand};

/// Shows the states of jobs, or executes one of the commands for jobs.
pub(crate) fn jobs(args: &JobsArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let runs = args.folder.path();
    match &args.command {
        None => show::show(&find(&runs, args.submission.name.as_deref())?, args.json),
        Some(JobsCommand::Retry(command)) => retry::retry(&find(&runs, command.submission.name.as_deref())?, command),
        Some(JobsCommand::Cancel(command)) => cancel::cancel(&find(&runs, command.submission.name.as_deref())?),
        Some(JobsCommand::Start(command)) => start::start(command, registry),
    }
}

/// The folder of a submission, and what is in it.
pub(crate) struct SubmissionFolder {
    pub(crate) folder: PathBuf,
    pub(crate) submission: Submission,
}

impl SubmissionFolder {
    /// How commands name it: its folder, because an experiment can have several submissions.
    pub(crate) fn name(&self) -> String {
        name_of(&self.folder)
    }
}

/// The newest submission, or that of an experiment, or in a folder.
fn find(runs: &Path, name: Option<&Path>) -> Result<SubmissionFolder, CliError> {
    let folders: Vec<PathBuf> = match name {
        Some(folder) if folder.join(JOBS).is_file() => vec![folder.to_owned()],
        _ => {
            let inner = |folder: PathBuf| {
                std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect::<Vec<_>>()
            };
            let experiments = inner(runs.to_owned()).into_iter();
            let experiments =
                experiments.filter(|path| name.is_none_or(|name| path.file_name() == Some(name.as_os_str())));
            experiments.flat_map(|path| inner(path.join(SHARDS))).filter(|path| path.join(JOBS).is_file()).collect()
        }
    };
    let (mut found, mut unreadable) = (Vec::new(), None);
    for folder in folders {
        match Submission::read(&folder) {
            Ok(submission) => found.push(SubmissionFolder { folder, submission }),
            Err(stop) => unreadable = Some(stop),
        }
    }
    found.sort_by(|a, b| a.submission.submitted_utc.cmp(&b.submission.submitted_utc));
    let newest = found.pop();
    if newest.is_some() && !found.is_empty() {
        let others: Vec<String> = found.iter().rev().take(MOST_LISTED).map(SubmissionFolder::name).collect();
        let count = counted(found.len() as u64, "earlier submission");
        say(format_args!("note: there are {count} with other plans: {}", others.join(", ")));
    }
    newest.ok_or_else(|| {
        if let Some(stop) = unreadable {
            return stop;
        }
        let what = match name {
            Some(name) => format!("`{}` has no submitted jobs in {}", name.display(), runs.display()),
            None => format!("nothing was submitted in {}", runs.display()),
        };
        let remedy = "name an experiment as its file does (`experiment: NAME`); `depthloom submit FILE` submits one";
        CliError::usage(what, remedy)
    })
}

/// The most submissions that a note lists.
const MOST_LISTED: usize = 4;

/// The folder of a submission as a word for a command in the working directory.
pub(crate) fn name_of(folder: &Path) -> String {
    let here = std::env::current_dir().unwrap_or_default();
    let folder = folder.strip_prefix(&here).unwrap_or(folder);
    slurm::shell_quoted(&folder.display().to_string())
}

/// An absolute path without symbolic links, as jobs on other machines use it.
pub(crate) fn absolute(path: &Path) -> Result<PathBuf, CliError> {
    std::path::absolute(path)
        .map_err(|error| CliError::because(ExitCode::Usage, format_args!("failed to find {}", path.display()), &error))
}
