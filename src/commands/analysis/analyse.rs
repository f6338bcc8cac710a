//! `depthloom analyse`: the errors of scored pixels, by whatever is recorded with them.

use std::path::Path;

use depthloom_analysis::{By, Inquiry, TableOutput, Unit};
use depthloom_runs::{end, failed, open, recording_of};
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::AnalyseArgs;
use crate::output::delivery::Delivery;
use crate::output::progress::bar;
use crate::results::samples::{is_samples, samples_of};
use crate::signals;

// Of `analyse`. The schema has the description of the table: one here would make it refer to the table's.
#[derive(JsonSchema, Serialize)]
#[serde(transparent)]
pub(crate) struct Analyse(TableOutput);

impl From<TableOutput> for Analyse {
    fn from(table: TableOutput) -> Self {
        Self(table)
    }
}

/// Prints a table of errors, or writes it to a file; of runs that have no samples yet, these first.
pub(crate) fn analyse(args: &AnalyseArgs) -> Result<ExitCode, CliError> {
    let delivery = Delivery::new(&args.output)?;
    let inquiry = Inquiry {
        by: By::parse(&args.by),
        bins: args.bins.clone(),
        percentiles: args.percentiles.clone(),
        estimates: args.estimates.clone(),
        variants: args.part.variant.clone(),
        stages: args.part.stage.clone(),
        sets: args.set.clone(),
        unit: if args.relative { Unit::OfTruth } else { Unit::Metres },
        gross: args.gross,
    };
    if inquiry.by == By::Frame && inquiry.bins.is_some() {
        return Err(CliError::usage("`--by frame` has one bin per frame, so it takes no --bins", "leave it out"));
    }
    let interrupt = signals::listen("stopping")?;
    let is_silent = !delivery.is_shown();
    let mut files = Vec::new();
    for run in &args.runs {
        files.push((run.to_string_lossy().into_owned(), samples_of(run, is_silent, &interrupt)?));
    }
    let bar = bar(is_silent, 1, "{bar:30} {percent} %  {eta} left");
    let progress = |done: u64, all: u64| {
        bar.set_length(all);
        bar.set_position(done);
    };
    let found = depthloom_analysis::analyse(&files, &inquiry, &progress, &|| interrupt.stops_admission());
    bar.finish_and_clear();
    let (found, run) = found.map_err(failed)?;
    let read: Vec<&Path> = files.iter().map(|(_, file)| file.as_path()).collect();
    delivery.answer::<Analyse>(&found, &run, &read)?;
    let recordings = args.runs.iter().filter(|run| !is_samples(run)).map(|run| open(&recording_of(run, "analyse")?));
    Ok(end(&recordings.collect::<Result<Vec<_>, _>>()?))
}
