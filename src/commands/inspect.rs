//! `depthloom inspect`: a data set, a recording or an ONNX file.

pub(crate) mod data_set;
pub(crate) mod network;
pub(crate) mod recording;

use std::path::PathBuf;

use depthloom_graphs::Registry;
use depthloom_runs::{RECORDING, is_recording, named, partial_with, remedy_of_partial};
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::InspectArgs;

/// The kind of source that reads recordings.
const RECORDINGS: &str = "mcap";

/// The kind of thing that was inspected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Subject {
    DataSet,
    Recording,
    Onnx,
}

impl Subject {
    const fn name(self) -> &'static str {
        match self {
            Self::DataSet => "a data set",
            Self::Recording => "a recording",
            Self::Onnx => "an ONNX file",
        }
    }
}

/// Prints the description of whatever the path names.
pub(crate) fn inspect(args: &InspectArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let (subject, path) = recognise(args, registry)?;
    check_options(args, subject)?;
    match subject {
        Subject::DataSet => data_set::inspect(args, &path, registry),
        Subject::Recording => recording::inspect(args, &path),
        Subject::Onnx => network::inspect(args, &path),
    }
}

/// What the path names, and the file or folder to read.
fn recognise(args: &InspectArgs, registry: &Registry) -> Result<(Subject, PathBuf), CliError> {
    let path = named(&args.path, &args.folder.path())?;
    if !path.exists() {
        let stop = CliError::new(ExitCode::Usage, format!("there is no file, folder or run `{}`", path.display()));
        return Err(match partial_with(&path, RECORDING) {
            Some(partial) => stop.remedy(remedy_of_partial(&partial, "inspect")),
            None => stop.remedy(
                "name the folder of a data set, a bag, a recording, an .onnx file, or a run that `depthloom runs` lists",
            ),
        });
    }
    let is_onnx = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("onnx"));
    if is_onnx && !path.is_dir() {
        return Ok((Subject::Onnx, path));
    }
    if args.as_source || args.contact_sheet.is_some() {
        return Ok((Subject::DataSet, path));
    }
    // A run's folder, also if its recording is damaged or is not a file; a bag is also an MCAP file.
    let recognises = || registry.source_kind(RECORDINGS).is_some_and(|kind| !kind.recognise(&path).is_empty());
    let is_run = path.join(RECORDING).symlink_metadata().is_ok();
    let is_other = !path.is_file() && !path.is_dir();
    if is_run || is_other || path.is_file() && is_recording(&path) && recognises() {
        return Ok((Subject::Recording, args.folder.recording(&path, "inspect")?));
    }
    Ok((Subject::DataSet, path))
}

/// Refuses options that do not apply.
fn check_options(args: &InspectArgs, subject: Subject) -> Result<(), CliError> {
    for (option, is_given, applies_to) in [
        ("--contact-sheet", args.contact_sheet.is_some(), Subject::DataSet),
        ("--as-source", args.as_source, Subject::DataSet),
        ("--verify-bytes", args.verify_bytes, Subject::Recording),
        ("--keys", args.keys, Subject::Recording),
        ("--size", args.size.is_some(), Subject::Onnx),
    ] {
        if is_given && applies_to != subject {
            let what = format!("{option} does not apply to {}: {}", subject.name(), args.path.display());
            return Err(CliError::usage(what, format!("leave it out; it applies to {}", applies_to.name())));
        }
    }
    Ok(())
}
