//! Experiment files as commands read them.

use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use depthloom_graphs::language::{Loaded, Options, Severity};
use depthloom_graphs::{Registry, counted};
use depthloom_terminal::{CliError, ExitCode, Problem};

use crate::args::ExperimentArgs;
use crate::output::diagnostics;

const STANDARD_INPUT: &str = "-";

/// The most bytes that are read from standard input: no experiment is larger.
const LARGEST: u64 = 64 << 20;

fn standard_input() -> Result<String, CliError> {
    let mut text = String::new();
    match io::stdin().lock().take(LARGEST).read_to_string(&mut text) {
        Ok(_) => Ok(text),
        Err(error) => {
            Err(CliError::because(ExitCode::Usage, "failed to read the experiment from standard input", &error))
        }
    }
}

/// Refuses standard input, for a command that needs a file.
pub(crate) fn is_file(args: &ExperimentArgs) -> Result<(), CliError> {
    if args.experiment != Path::new(STANDARD_INPUT) {
        return Ok(());
    }
    let what = "an experiment from standard input can be checked, planned and drawn, but not run";
    Err(CliError::usage(what, "write it to a file, and name the file"))
}

/// Loads an experiment; prints its warnings unless `quiet`.
pub(crate) fn load(args: &ExperimentArgs, registry: &Registry, quiet: bool) -> Result<Loaded, CliError> {
    load_texts(args, registry, quiet, Vec::new())
}

/// As [`load`], with texts that replace files on disk.
pub(crate) fn load_texts(
    args: &ExperimentArgs,
    registry: &Registry,
    quiet: bool,
    open_texts: Vec<(PathBuf, String)>,
) -> Result<Loaded, CliError> {
    let ExperimentArgs { set, matrix, variants, .. } = args.clone();
    let text = if args.experiment == Path::new(STANDARD_INPUT) { Some(standard_input()?) } else { None };
    let options = Options { set, matrix, only: variants, text, open_texts, ..Default::default() };
    match depthloom_graphs::language::load(&args.experiment, registry, &options) {
        Ok(loaded) => {
            if !quiet {
                diagnostics::print(&loaded.warnings);
            }
            Ok(loaded)
        }
        Err(found) => {
            let errors = found.iter().filter(|diagnostic| diagnostic.severity == Severity::Error).count();
            let what = format!("{} has {}", args.experiment.display(), counted(errors, "error"));
            Err(CliError::new(ExitCode::Usage, what).problems(found.0.into_iter().map(Problem::Placed)))
        }
    }
}
