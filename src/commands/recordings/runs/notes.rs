//! `depthloom runs tag` and `runs note`: what a person writes about a run.

use std::path::Path;

use depthloom_runs::{FoundRun, Notes, named};
use depthloom_terminal::{CliError, ExitCode, print};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{NoteArgs, RunsArgs, TagArgs};
use crate::output;

/// Output of `runs tag` and `runs note`: the tags and the note that the run has now.
#[derive(JsonSchema, Serialize)]
pub(crate) struct RunsNotes {
    path: String,
    #[serde(flatten)]
    notes: Notes,
}

/// Adds, removes or prints tags.
pub(super) fn tag(args: &RunsArgs, tag: &TagArgs) -> Result<ExitCode, CliError> {
    let run = run(args, &tag.run)?;
    let mut notes = Notes::read(&run.path)?;
    let before = notes.clone();
    match tag.remove {
        true => {
            if let Some(absent) = tag.tags.iter().find(|name| !notes.tags.contains(*name)) {
                let known: Vec<&str> = notes.tags.iter().map(String::as_str).collect();
                let remedy =
                    if known.is_empty() { "it has none".to_owned() } else { format!("its tags: {}", known.join(", ")) };
                return Err(CliError::usage(format!("{} has no tag `{absent}`", run.name), remedy));
            }
            notes.tags.retain(|name| !tag.tags.contains(name));
        }
        false => notes.tags.extend(tag.tags.iter().cloned()),
    }
    finish(args, &run, &before, notes, |notes| notes.tags.iter().map(|name| format!("{name}\n")).collect())
}

/// Writes, removes or prints a note.
pub(super) fn note(args: &RunsArgs, note: &NoteArgs) -> Result<ExitCode, CliError> {
    let run = run(args, &note.run)?;
    let mut notes = Notes::read(&run.path)?;
    let before = notes.clone();
    if note.remove {
        notes.note = None;
    } else if let Some(text) = &note.text {
        let text = text.trim();
        notes.note = (!text.is_empty()).then(|| text.to_owned());
    }
    finish(args, &run, &before, notes, |notes| notes.note.iter().map(|text| format!("{text}\n")).collect())
}

fn run(args: &RunsArgs, name: &Path) -> Result<FoundRun, CliError> {
    let folder = args.folder.path();
    FoundRun::at(&named(name, &folder)?, &folder)
}

fn finish(
    args: &RunsArgs,
    run: &FoundRun,
    before: &Notes,
    notes: Notes,
    text: impl Fn(&Notes) -> String,
) -> Result<ExitCode, CliError> {
    if notes != *before {
        notes.write(&run.path)?;
    }
    match args.json {
        true => output::print(&RunsNotes { path: run.path.to_string_lossy().into_owned(), notes })?,
        false => print(text(&notes))?,
    }
    Ok(ExitCode::Success)
}
