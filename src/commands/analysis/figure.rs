//! `depthloom figure`: figures for papers.

use std::path::{Path, PathBuf};

use depthloom_analysis::{FigureKind, FigureRequest, FigureRun, Resampling, SampleSet, Size, Unit};
use depthloom_recording::Recording;
use depthloom_runs::{end, failed, open, open_frames, recording_of};
use depthloom_terminal::{CliError, ExitCode, print};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{FigureArgs, FigureFormat, SetOption};
use crate::output;
use crate::output::delivery::{can_be_written, write_named};
use crate::output::progress::bar;
use crate::results::samples::samples_of;
use crate::signals;

/// Of `figure`: what was drawn.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Figure {
    file: String,
    /// The file of the numbers that it shows; null where none was asked for.
    data: Option<String>,
    /// What it shows, over which pixels: the beginning of a caption.
    about: String,
    width_mm: f64,
    height_mm: f64,
    bytes: u64,
    /// What is to be said of it beside that.
    notes: Vec<String>,
}

pub(crate) fn figure(args: &FigureArgs) -> Result<ExitCode, CliError> {
    let format = format_of(args)?;
    can_be_written(&args.out)?;
    if let Some(data) = &args.data {
        can_be_written(data)?;
        if data == &args.out {
            let what = format!("--data and --out are both {}", data.display());
            return Err(CliError::usage(what, "name two files"));
        }
    }
    let request = request(args)?;
    let interrupt = signals::listen("stopping: no file is written")?;
    let mut opened: Vec<(String, Recording, Option<PathBuf>)> = Vec::new();
    for run in &args.runs {
        let path = recording_of(run, "figure")?;
        let samples = match request.kind.is_of_samples() {
            true => Some(samples_of(run, args.output.json, &interrupt)?),
            false => None,
        };
        // A learning curve is no value of a frame.
        let open = if request.kind == FigureKind::Learning { open } else { open_frames };
        opened.push((run.to_string_lossy().into_owned(), open(&path)?, samples));
    }
    let runs: Vec<FigureRun<'_>> = opened
        .iter()
        .map(|(called, recording, samples)| FigureRun { called, recording, samples: samples.clone() })
        .collect();
    let bar = bar(args.output.json, 1, "{bar:30} {percent} %  {eta} left");
    let progress = |done: u64, all: u64| {
        bar.set_length(all);
        bar.set_position(done);
    };
    let drawn = depthloom_analysis::figure(&runs, &request, &progress, &|| interrupt.stops_admission());
    bar.finish_and_clear();
    let figure = drawn.map_err(failed)?;
    let bytes = match format {
        FigureFormat::Svg => figure.drawing.svg().into_bytes(),
        FigureFormat::Pdf => figure.drawing.pdf(&figure.about),
        FigureFormat::Png => figure
            .drawing
            .png(f64::from(args.dpi))
            .map_err(|what| CliError::usage(what, "ask for fewer pixels with `--dpi`, or for SVG or PDF"))?,
    };
    let recordings: Vec<&Path> = opened.iter().map(|(_, recording, _)| recording.path()).collect();
    write_named(&args.out, &bytes, &recordings)?;
    if let Some(data) = &args.data {
        write_named(data, &figure.data, &recordings)?;
    }
    let (width_mm, height_mm) = figure.drawing.size_mm();
    if args.output.json {
        output::print(&Figure {
            file: args.out.to_string_lossy().into_owned(),
            data: args.data.as_ref().map(|data| data.to_string_lossy().into_owned()),
            about: figure.about.clone(),
            width_mm,
            height_mm,
            bytes: bytes.len() as u64,
            notes: figure.notes.clone(),
        })?;
        return Ok(end(opened.iter().map(|(_, recording, _)| recording)));
    }
    let data = args.data.as_ref().map(|data| format!(", {}", data.display())).unwrap_or_default();
    let notes: String = figure.notes.iter().map(|note| format!("note: {note}\n")).collect();
    print(format!("{}\n{notes}{}{data}: {width_mm} x {height_mm} mm\n", figure.about, args.out.display()))?;
    Ok(end(opened.iter().map(|(_, recording, _)| recording)))
}

/// What the file is written as: what was asked for, or what its ending says.
fn format_of(args: &FigureArgs) -> Result<FigureFormat, CliError> {
    let ending = args.out.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let of_ending = match ending.as_deref() {
        Some("svg") => Some(FigureFormat::Svg),
        Some("png") => Some(FigureFormat::Png),
        Some("pdf") => Some(FigureFormat::Pdf),
        _ => None,
    };
    match (args.format, of_ending) {
        (Some(asked), Some(ending)) if asked != ending => {
            let what = format!("--format contradicts the extension of {}", args.out.display());
            Err(CliError::usage(what, "leave --format out, or name a file of that ending"))
        }
        (Some(format), _) | (None, Some(format)) => Ok(format),
        (None, None) => {
            let what = format!("cannot determine the format of {}: it has no known extension", args.out.display());
            Err(CliError::usage(what, "end it in `.svg`, `.png` or `.pdf`, or give --format"))
        }
    }
}

fn request(args: &FigureArgs) -> Result<FigureRequest, CliError> {
    let kind = args.kind;
    let is_of_errors = kind.is_of_samples();
    let set = match args.set {
        Some(SetOption::Common) => Some(SampleSet::Common),
        Some(SetOption::Valid) => Some(SampleSet::Valid),
        _ => None,
    };
    let wrong = |what: &str, remedy: &str| Err(CliError::usage(what.to_owned(), remedy.to_owned()));
    match args.set {
        Some(SetOption::All | SetOption::Filled) if is_of_errors => {
            return wrong("a pixel without an answer has no error to draw", "take `--set common` or `--set valid`");
        }
        Some(SetOption::Common) if !is_of_errors => {
            return wrong("scores of a figure are those that were recorded", "take another --set");
        }
        _ => {}
    }
    for (is_given, is_taken, option) in [
        (args.by.is_some(), matches!(kind, FigureKind::ErrorVsDistance | FigureKind::Reliability), "--by"),
        (args.bins.is_some(), is_of_errors && kind != FigureKind::Cdf, "--bins"),
        (args.relative, is_of_errors && kind != FigureKind::Difference, "--relative"),
        (args.score.is_some(), matches!(kind, FigureKind::Frames | FigureKind::Parameter), "--score"),
        (!args.axes.is_empty(), kind == FigureKind::Parameter, "--axes"),
        (args.frames.is_some(), kind == FigureKind::Panels, "--frames"),
    ] {
        if is_given && !is_taken {
            let what = format!("this kind of figure takes no {option}");
            return Err(CliError::usage(what, "leave it out; `depthloom help figure` says what takes it"));
        }
    }
    Ok(FigureRequest {
        kind,
        size: Size { width_mm: args.width, height_mm: args.height },
        title: args.title.clone(),
        estimates: args.estimates.clone(),
        variants: args.part.variant.clone(),
        stages: args.part.stage.clone(),
        set,
        scored_set: args.set.and_then(SetOption::recorded),
        by: args.by.clone(),
        bins: args.bins.clone(),
        unit: if args.relative { Unit::OfTruth } else { Unit::Metres },
        layout: args.layout.layout(),
        thin: args.thin,
        most: args.most,
        score: args.score.clone(),
        axes: args.axes.clone(),
        frames: args.frames.clone(),
        resampling: args.intervals.resampling(Resampling::OF_ERRORS),
        dpi: f64::from(args.dpi),
    })
}
