//! `depthloom samples` and `depthloom analyse`: a row a scored pixel, and the errors of them by whatever is asked.

use std::path::{Path, PathBuf};

use depthloom_analysis::{
    Answer, By, Inquiry, SAMPLES, SamplesWritten, TableOutput, Unit, samples_are_of, write_samples,
};
use depthloom_recording::{Condition, Recording};
use depthloom_runner::Interrupt;
use depthloom_runs::end;
use depthloom_runs::failed;
use depthloom_runs::open;
use depthloom_runs::recording_of;
use indicatif::{ProgressBar, ProgressStyle};
use schemars::JsonSchema;
use serde::Serialize;

use super::table::{Delivery, can_be_written};
use crate::args::{AnalyseArgs, SamplesArgs};
use crate::outputs::{self, CommandOutput, Output};
use crate::signals;
use depthloom_graphs::counted;
use depthloom_runs::run_folder;
use depthloom_terminal::{Exit, Stop, print, say};

/// Of `samples`: what was written.
#[derive(JsonSchema, Serialize)]
pub struct Samples {
    file: String,
    /// The rows.
    samples: u64,
    frames: u64,
    /// The columns of estimators.
    estimators: u64,
    notes: Vec<String>,
}

impl CommandOutput for Samples {
    const OUTPUT: Output = Output::Samples;
}

// Of `analyse`. The schema has the description of the table: one here would make it refer to the table's.
#[derive(JsonSchema, Serialize)]
#[serde(transparent)]
pub struct Analyse(TableOutput);

impl CommandOutput for Analyse {
    const OUTPUT: Output = Output::Analyse;
}

impl From<TableOutput> for Analyse {
    fn from(table: TableOutput) -> Self {
        Self(table)
    }
}

/// Writes the samples of a run.
pub fn samples(args: &SamplesArgs) -> Result<Exit, Stop> {
    let path = recording_of(&args.run, "samples")?;
    let out = match &args.out {
        Some(out) => {
            // The run's own samples may be written again.
            let own = path.with_file_name(SAMPLES);
            if !matches!((out.canonicalize(), own.canonicalize()), (Ok(out), Ok(own)) if out == own) {
                can_be_written(out)?;
            }
            out.clone()
        }
        None => path.with_file_name(SAMPLES),
    };
    let interrupt = signals::listen("stopping: no file is written")?;
    let _lock = run_folder::lock_if_run(folder_of(&out))?;
    let recording = open(&path)?;
    let written = write(&recording, &out, args.quiet || args.json, &interrupt)?;
    if args.json {
        outputs::print(&Samples {
            file: out.to_string_lossy().into_owned(),
            samples: written.samples,
            frames: written.frames,
            estimators: written.estimators as u64,
            notes: written.notes,
        })?;
        return Ok(end([&recording]));
    }
    written.notes.iter().for_each(|note| say(format_args!("note: {note}")));
    if !args.quiet {
        let (samples, frames) = (counted(written.samples, "sample"), counted(written.frames, "frame"));
        print(format!("{samples} of {frames}: {}\n", out.display()))?;
    }
    Ok(end([&recording]))
}

fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Writes a recording's samples to a file, with progress.
pub(super) fn write(
    recording: &Recording,
    out: &Path,
    is_silent: bool,
    interrupt: &Interrupt,
) -> Result<SamplesWritten, Stop> {
    if *recording.condition() != Condition::Whole {
        say(format_args!("warning: the recording is {}", recording.condition()));
    }
    let bar = bar(is_silent, "samples: {bar:30} {pos}/{len} frames  {eta} left");
    let progress = |done: usize, all: usize| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    };
    let written = write_samples(recording, out, &progress, &|| interrupt.stops_admission());
    bar.finish_and_clear();
    written.map_err(|error| failed(&error))
}

pub(super) fn bar(is_silent: bool, template: &str) -> ProgressBar {
    let bar = if is_silent { ProgressBar::hidden() } else { ProgressBar::new(1) };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

/// Prints a table of errors, or writes it to a file; of runs that have no samples yet, these first.
pub fn analyse(args: &AnalyseArgs) -> Result<Exit, Stop> {
    let delivery = Delivery::of(args.format, args.json, args.out.as_deref())?;
    let inquiry = Inquiry {
        by: By::parse(&args.by),
        bins: args.bins.clone(),
        percentiles: args.percentiles.clone(),
        estimators: args.estimators.clone(),
        variants: args.variant.clone(),
        stages: args.stage.clone(),
        sets: args.set.iter().map(|set| set.set()).collect(),
        unit: if args.relative { Unit::OfTruth } else { Unit::Metres },
        gross: args.gross,
    };
    if inquiry.by == By::Frame && inquiry.bins.is_some() {
        return Err(
            Stop::new(Exit::Before, "`--by frame` has a bin a frame, and takes no --bins").remedy("leave it out")
        );
    }
    let interrupt = signals::listen("stopping")?;
    let is_silent = !delivery.is_shown();
    let mut files = Vec::new();
    for run in &args.runs {
        files.push((run.to_string_lossy().into_owned(), samples_of(run, is_silent, &interrupt)?));
    }
    let bar = bar(is_silent, "{bar:30} {percent} %  {eta} left");
    let progress = |done: u64, all: u64| {
        bar.set_length(all);
        bar.set_position(done);
    };
    let found = depthloom_analysis::analyse(&files, &inquiry, &progress, &|| interrupt.stops_admission());
    bar.finish_and_clear();
    let (found, run) = found.map_err(|error| failed(&error))?;
    let read: Vec<&Path> = files.iter().map(|(_, file)| file.as_path()).collect();
    delivery.answer::<Analyse>(&Answer::Grid(found), &run, &read)?;
    let recordings = args.runs.iter().filter(|run| !is_samples(run)).map(|run| open(&recording_of(run, "analyse")?));
    Ok(end(&recordings.collect::<Result<Vec<_>, _>>()?))
}

/// Whether what is named is a file of samples itself.
fn is_samples(run: &Path) -> bool {
    run.is_file() && run.extension().is_some_and(|ending| ending == "parquet")
}

/// The file of samples of a run, made if there is none, or if it is of what the recording was before; or such a file itself.
pub(super) fn samples_of(run: &Path, is_silent: bool, interrupt: &Interrupt) -> Result<PathBuf, Stop> {
    if is_samples(run) {
        return Ok(run.to_owned());
    }
    let path = recording_of(run, "analyse")?;
    let file = path.with_file_name(SAMPLES);
    let recording = open(&path)?;
    if file.is_file() && samples_are_of(&file, &recording).map_err(|error| failed(&error))? {
        return Ok(file);
    }
    let elsewhere = || {
        format!(
            "`depthloom samples {} --out FILE.parquet` writes the samples to another folder, and `depthloom analyse FILE.parquet` reads them there; \
             for a figure copy the run to a folder that can be written",
            run.display()
        )
    };
    let _lock = run_folder::lock_if_run(folder_of(&file)).map_err(|stop| stop.remedy(elsewhere()))?;
    let written = write(&recording, &file, is_silent, interrupt)
        .map_err(|stop| if stop.exit == Exit::Engine { stop.remedy(elsewhere()) } else { stop })?;
    written.notes.iter().for_each(|note| say(format_args!("note: {note}")));
    Ok(file)
}
