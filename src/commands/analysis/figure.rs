//! `depthloom figure`: figures for papers.

use std::path::{Path, PathBuf};

use depthloom_analysis::{FigureKind, FigureRequest, FigureRun, Resampling, SampleSet, Size, Unit};
use depthloom_recording::Recording;
use depthloom_runs::{end, failed, open, open_frames};
use depthloom_terminal::{CliError, ExitCode, print};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{FigureArgs, FigureFormat, PixelsOption};
use crate::output;
use crate::output::delivery::{can_be_written, write_named};
use crate::output::progress::bar;
use crate::results::samples::samples_of;
use crate::signals;

/// Output of `figure`: the figure that was drawn.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Figure {
    file: String,
    /// The CSV file of its numbers; null without `--csv`.
    csv: Option<String>,
    /// What it shows, over which pixels: the beginning of a caption.
    about: String,
    width_mm: f64,
    height_mm: f64,
    bytes: u64,
    /// Remarks for the caption.
    notes: Vec<String>,
}

pub(crate) fn figure(args: &FigureArgs) -> Result<ExitCode, CliError> {
    let format = format_of(args)?;
    can_be_written(&args.out)?;
    if let Some(csv) = &args.csv {
        can_be_written(csv)?;
        if csv == &args.out {
            let what = format!("--csv and --out are both {}", csv.display());
            return Err(CliError::usage(what, "name two files"));
        }
    }
    let request = request(args)?;
    let interrupt = signals::listen("stopping: no file is written")?;
    let mut opened: Vec<(String, Recording, Option<PathBuf>)> = Vec::new();
    for run in &args.runs {
        let path = args.folder.recording(run, "figure")?;
        let samples = match request.kind.needs_samples() {
            true => Some(samples_of(run, &args.folder, args.output.json, &interrupt)?),
            false => None,
        };
        // A learning curve needs no frames.
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
            .map_err(|what| CliError::usage(what, "use a lower `--dpi`, or SVG or PDF"))?,
    };
    let recordings: Vec<&Path> = opened.iter().map(|(_, recording, _)| recording.path()).collect();
    write_named(&args.out, &bytes, &recordings)?;
    if let Some(csv) = &args.csv {
        write_named(csv, &figure.data, &recordings)?;
    }
    let (width_mm, height_mm) = figure.drawing.size_mm();
    if args.output.json {
        output::print(&Figure {
            file: args.out.to_string_lossy().into_owned(),
            csv: args.csv.as_ref().map(|csv| csv.to_string_lossy().into_owned()),
            about: figure.about.clone(),
            width_mm,
            height_mm,
            bytes: bytes.len() as u64,
            notes: figure.notes.clone(),
        })?;
        return Ok(end(opened.iter().map(|(_, recording, _)| recording)));
    }
    let csv = args.csv.as_ref().map(|csv| format!(", {}", csv.display())).unwrap_or_default();
    let notes: String = figure.notes.iter().map(|note| format!("note: {note}\n")).collect();
    print(format!("{}\n{notes}{}{csv}: {width_mm} x {height_mm} mm\n", figure.about, args.out.display()))?;
    Ok(end(opened.iter().map(|(_, recording, _)| recording)))
}

/// The format of `--format`, or that of the file's extension.
fn format_of(args: &FigureArgs) -> Result<FigureFormat, CliError> {
    let extension = args.out.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    let by_extension = match extension.as_deref() {
        Some("svg") => Some(FigureFormat::Svg),
        Some("png") => Some(FigureFormat::Png),
        Some("pdf") => Some(FigureFormat::Pdf),
        _ => None,
    };
    match (args.format, by_extension) {
        (Some(requested), Some(extension)) if requested != extension => {
            let what = format!("--format contradicts the extension of {}", args.out.display());
            Err(CliError::usage(what, "leave out --format, or use a file with that extension"))
        }
        (Some(format), _) | (None, Some(format)) => Ok(format),
        (None, None) => {
            let what = format!("cannot determine the format of `{}`: it has no known extension", args.out.display());
            Err(CliError::usage(what, "use `.svg`, `.png` or `.pdf`, or pass --format"))
        }
    }
}

fn request(args: &FigureArgs) -> Result<FigureRequest, CliError> {
    let kind = args.kind;
    let is_of_errors = kind.needs_samples();
    let set = match args.pixels {
        Some(PixelsOption::Common) => Some(SampleSet::Common),
        Some(PixelsOption::Valid) => Some(SampleSet::Valid),
        _ => None,
    };
    let wrong = |what: &str, remedy: &str| Err(CliError::usage(what.to_owned(), remedy.to_owned()));
    match args.pixels {
        Some(PixelsOption::All | PixelsOption::Filled) if is_of_errors => {
            return wrong(
                "this kind of figure needs valid pixels: an invalid pixel has no error to draw",
                "use `--pixels common` or `--pixels valid`",
            );
        }
        Some(PixelsOption::Common) if !is_of_errors => {
            return wrong(
                "`--pixels common` is not supported here: this kind of figure draws recorded metrics only",
                "use `--pixels all` or `--pixels valid`, or leave it out",
            );
        }
        _ => {}
    }
    for (is_given, is_supported, option) in [
        (args.by.is_some(), matches!(kind, FigureKind::ErrorVsDistance | FigureKind::Reliability), "--by"),
        (args.bins.is_some(), is_of_errors && kind != FigureKind::Cdf, "--bins"),
        (args.relative, is_of_errors && kind != FigureKind::Difference, "--relative"),
        (args.metric.is_some(), matches!(kind, FigureKind::Frames | FigureKind::Parameter), "--metric"),
        (!args.axes.is_empty(), kind == FigureKind::Parameter, "--axes"),
        (args.frames.is_some(), kind == FigureKind::Panels, "--frames"),
    ] {
        if is_given && !is_supported {
            let what = format!("this kind of figure does not support {option}");
            return Err(CliError::usage(what, "leave it out; `depthloom help figure` lists the kinds that support it"));
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
        scored_set: args.pixels.and_then(PixelsOption::recorded),
        by: args.by.clone(),
        bins: args.bins.clone(),
        unit: if args.relative { Unit::OfTruth } else { Unit::Metres },
        layout: args.layout.layout(),
        min_count: args.min_count,
        y_max: args.y_max,
        score: args.metric.clone(),
        axes: args.axes.clone(),
        frames: args.frames.clone(),
        resampling: args.intervals.resampling(Resampling::OF_ERRORS),
        dpi: f64::from(args.dpi),
    })
}
