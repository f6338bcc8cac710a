//! `depthloom new`: a first experiment, to begin from.

use std::fs::File;
use std::io::{ErrorKind, Write as _};

use depthloom_terminal::{Exit, Stop, print_path};

use crate::args::NewArgs;

/// What is written: an experiment that runs anywhere, with a word on every part of it.
const FIRST: &str = include_str!("new.yaml");

/// Writes the first experiment where nothing is yet.
pub fn new(args: &NewArgs) -> Result<Exit, Stop> {
    let file = &args.file;
    let failed = |error: std::io::Error| match error.kind() {
        ErrorKind::AlreadyExists => {
            Stop::new(Exit::Before, format!("{} exists already", file.display())).remedy("choose another name")
        }
        _ => Stop::because(Exit::Before, format_args!("failed to write {}", file.display()), &error),
    };
    File::create_new(file).and_then(|mut file| file.write_all(FIRST.as_bytes())).map_err(failed)?;
    print_path("run it: depthloom run ", file)?;
    Ok(Exit::Whole)
}
