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

use depthloom_graphs::Registry;
use depthloom_jobs::{JOBS, Submission};
use depthloom_runs::SHARDS;
use depthloom_terminal::{CliError, ExitCode};

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
    /// How the user names it.
    pub(crate) fn name(&self) -> &str {
        &self.submission.experiment
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
    let mut found = Vec::new();
    for folder in folders {
        found.push(SubmissionFolder { submission: Submission::read(&folder)?, folder });
    }
    let newest = found.into_iter().max_by(|a, b| a.submission.submitted_utc.cmp(&b.submission.submitted_utc));
    newest.ok_or_else(|| {
        let what = match name {
            Some(name) => format!("`{}` has no submitted jobs in {}", name.display(), runs.display()),
            None => format!("nothing was submitted in {}", runs.display()),
        };
        let remedy = "name an experiment as its file does (`experiment: NAME`); `depthloom submit FILE` submits one";
        CliError::usage(what, remedy)
    })
}

/// An absolute path without symbolic links, as jobs on other machines use it.
pub(crate) fn absolute(path: &Path) -> Result<PathBuf, CliError> {
    std::path::absolute(path)
        .map_err(|error| CliError::because(ExitCode::Usage, format_args!("failed to find {}", path.display()), &error))
}
