//! `depthloom analyse`: the errors of scored pixels, by distance or another recorded quantity.

use std::path::Path;

use depthloom_analysis::{By, Inquiry, TableOutput, Unit, frames_of, recording_notes};
use depthloom_runs::{end, failed, open};
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::Serialize;

use super::samples::samples;
use crate::args::AnalyseArgs;
use crate::output::delivery::Delivery;
use crate::output::progress::bar;
use crate::results::frames::note_frames_beyond;
use crate::results::samples::{is_samples, samples_of};
use crate::signals;

// Output of `analyse`. The schema has the description of the table; a doc comment here would replace it by a reference.
#[derive(JsonSchema, Serialize)]
#[serde(transparent)]
pub(crate) struct Analyse(TableOutput);

impl From<TableOutput> for Analyse {
    fn from(table: TableOutput) -> Self {
        Self(table)
    }
}

/// Prints a table of errors, or writes it to a file. Missing samples of a run are written first.
pub(crate) fn analyse(args: &AnalyseArgs) -> Result<ExitCode, CliError> {
    if args.samples_only {
        return samples(args);
    }
    let delivery = Delivery::new(&args.output)?;
    let mut inquiry = Inquiry {
        by: By::parse(&args.by),
        bins: args.bins.clone(),
        percentiles: args.percentiles.clone(),
        estimates: args.estimates.clone(),
        variants: args.part.variant.clone(),
        stages: args.part.stage.clone(),
        sets: args.pixels.clone(),
        unit: if args.relative { Unit::OfTruth } else { Unit::Metres },
        outlier: args.outlier,
        frames: None,
    };
    if inquiry.by == By::Frame && inquiry.bins.is_some() {
        return Err(CliError::usage(
            "`--by frame` has one bin per frame and does not support --bins",
            "leave out --bins",
        ));
    }
    let interrupt = signals::listen("stopping")?;
    let is_silent = !delivery.is_shown();
    let mut files = Vec::new();
    for run in &args.runs {
        files.push((run.to_string_lossy().into_owned(), samples_of(run, &args.folder, is_silent, &interrupt)?));
    }
    let recordings =
        args.runs.iter().filter(|run| !is_samples(run)).map(|run| open(&args.folder.recording(run, "analyse")?));
    let recordings = recordings.collect::<Result<Vec<_>, _>>()?;
    if let Some(choice) = &args.frames {
        if let Some(file) = args.runs.iter().find(|run| is_samples(run)) {
            let what = format!("--frames needs a run, and {} is a file of samples", file.display());
            return Err(CliError::usage(what, "name the run that the samples are from"));
        }
        let frames = recordings.iter().map(|recording| frames_of(recording, choice)).collect::<Result<_, _>>();
        inquiry.frames = Some(frames.map_err(failed)?);
    }
    let bar = bar(is_silent, 1, "{bar:30} {percent} %  {eta} left");
    let progress = |done: u64, all: u64| {
        bar.set_length(all);
        bar.set_position(done);
    };
    let found = depthloom_analysis::analyse(&files, &inquiry, &progress, &|| interrupt.stops_admission());
    bar.finish_and_clear();
    let (mut found, run) = found.map_err(failed)?;
    found.show_labels(&recordings);
    found.typeset(&args.typesetting.typesetting());
    found.add_notes(recordings.iter().flat_map(recording_notes));
    delivery.warn_of_condition(&recordings);
    note_frames_beyond(&recordings, args.frames.as_ref());
    let read: Vec<&Path> = files.iter().map(|(_, file)| file.as_path()).collect();
    delivery.answer::<Analyse>(&found, &run, &read)?;
    Ok(end(&recordings))
}
