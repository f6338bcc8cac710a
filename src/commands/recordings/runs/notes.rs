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
    let notes = match tag.tags.is_empty() {
        true => Notes::read(&run.path)?,
        false => Notes::change(&run.path, |notes| match tag.remove {
            true => remove_tags(notes, &run, &tag.tags),
            false => {
                notes.tags.extend(tag.tags.iter().cloned());
                Ok(())
            }
        })?,
    };
    let text = notes.tags.iter().map(|name| format!("{name}\n")).collect();
    finish(args, &run, notes, text)
}

fn remove_tags(notes: &mut Notes, run: &FoundRun, tags: &[String]) -> Result<(), CliError> {
    if let Some(absent) = tags.iter().find(|name| !notes.tags.contains(*name)) {
        let known: Vec<&str> = notes.tags.iter().map(String::as_str).collect();
        let remedy = match known.as_slice() {
            [] => "the run has no tags".to_owned(),
            known => format!("its tags: {}", known.join(", ")),
        };
        return Err(CliError::usage(format!("{} has no tag `{absent}`", run.name), remedy));
    }
    notes.tags.retain(|name| !tags.contains(name));
    Ok(())
}

/// Writes, removes or prints a note.
pub(super) fn note(args: &RunsArgs, note: &NoteArgs) -> Result<ExitCode, CliError> {
    let run = run(args, &note.run)?;
    let notes = match (&note.text, note.remove) {
        (None, false) => Notes::read(&run.path)?,
        (text, _) => Notes::change(&run.path, |notes| {
            let text = text.as_deref().unwrap_or_default().trim();
            notes.note = (!text.is_empty()).then(|| text.to_owned());
            Ok(())
        })?,
    };
    let text = notes.note.iter().map(|text| format!("{text}\n")).collect();
    finish(args, &run, notes, text)
}

fn run(args: &RunsArgs, name: &Path) -> Result<FoundRun, CliError> {
    let folder = args.folder.path();
    FoundRun::at(&named(name, &folder)?, &folder)
}

fn finish(args: &RunsArgs, run: &FoundRun, notes: Notes, text: String) -> Result<ExitCode, CliError> {
    match args.json {
        true => output::print(&RunsNotes { path: run.path.to_string_lossy().into_owned(), notes })?,
        false => print(text)?,
    }
    Ok(ExitCode::Success)
}
