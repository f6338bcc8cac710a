//! `depthloom new`: a first experiment, to begin from.

use std::fs::File;
use std::io::{ErrorKind, Write as _};

use depthloom_terminal::{CliError, ExitCode, print_path};

use crate::args::NewArgs;

/// What is written: an experiment that runs anywhere, with a word on every part of it.
const FIRST: &str = include_str!("new.yaml");

/// Writes the first experiment where nothing is yet.
pub(crate) fn new(args: &NewArgs) -> Result<ExitCode, CliError> {
    let file = &args.file;
    let failed = |error: std::io::Error| match error.kind() {
        ErrorKind::AlreadyExists => {
            CliError::usage(format!("{} exists already", file.display()), "choose another name")
        }
        _ => CliError::because(ExitCode::Usage, format_args!("failed to write {}", file.display()), &error),
    };
    File::create_new(file).and_then(|mut file| file.write_all(FIRST.as_bytes())).map_err(failed)?;
    print_path("run it: depthloom run ", file)?;
    Ok(ExitCode::Success)
}
