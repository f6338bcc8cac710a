//! `depthloom export`: recorded values as files that other programs read.

use depthloom_graphs::plan::RunId;
use std::collections::BTreeSet;
use std::path::Path;

use depthloom_codecs::files::Colours;
use depthloom_recording::{Condition, Recording};
use depthloom_runs::open;
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{ColoursOption, ExportArgs};
use crate::output;
use crate::output::diagnostics::Error;
use crate::output::progress::bar;
use crate::signals;
use depthloom_export::{Chosen, ExportFormat, Exported, Folder, Form, Maps, chosen, frames, write_learned, write_rows};
use depthloom_graphs::{chain, counted};
use depthloom_terminal::{CliError, ExitCode, aligned, print, say};

/// Output of `export`: the files that were written.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Export {
    folder: String,
    /// `complete`, `unfinished`, `recovered` or `damaged`.
    condition: &'static str,
    topics: Vec<Exported>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

pub(crate) fn export(args: &ExportArgs) -> Result<ExitCode, CliError> {
    let folder = Folder::at(&args.out, args.overwrite)?;
    let path = args.run.recording("export")?;
    let interrupt = signals::listen("stopping: files that were started are finished")?;
    let recording = open(&path)?;
    let chosen = chosen(&recording, &args.topics, &args.format)?;
    let colours = args.colormap.map(colours);
    check_options(args, &chosen, colours)?;
    let runs: BTreeSet<RunId> = chosen.iter().map(|chosen| chosen.run).collect();
    let frames = frames(&recording, &runs, args.frames.as_ref())?;
    let maps = Maps::new(&recording, &frames, &chosen, colours, args.range)?;
    let single_files = |format: ExportFormat| {
        let topics = chosen.iter().filter(move |chosen| chosen.formats.contains(&format));
        topics.map(move |chosen| (chosen, format))
    };
    let files = || [ExportFormat::Onnx, ExportFormat::Json, ExportFormat::Parquet].into_iter().flat_map(single_files);
    folder.check(maps.files().chain(files().map(|(chosen, format)| chosen.path_with(format.name()))))?;
    folder.create()?;

    let bar = bar(args.quiet || args.output.json, maps.work(), "{bar:30} {pos}/{len}  {eta} left");
    let stop = || interrupt.stops_admission();
    let mut damaged = maps.write(&folder, depthloom_threads::core_count(), &stop, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let mut exported: Vec<Exported> = maps.exported().collect();
    for (chosen, format) in files().take_while(|_| !stop()) {
        if format != ExportFormat::Parquet {
            exported.push(write_learned(&recording, chosen, format, &folder)?);
        } else if let Some((rows, left_out)) = write_rows(&recording, chosen, &frames[chosen.run], &folder, &stop)? {
            exported.push(rows);
            damaged.extend(left_out);
        }
    }
    let files: u64 = exported.iter().map(|topic| topic.files).sum();
    if stop() {
        let complete = format!("{} in {}", counted(files, "file"), args.out.display());
        return Err(
            CliError::new(ExitCode::Interrupted, "interrupted while exporting").remedy(format!("complete: {complete}"))
        );
    }
    for error in &damaged {
        say(format_args!("warning: not exported: {}", chain(error)));
    }
    print_warnings(args, &recording, &exported);
    let is_damaged = !damaged.is_empty() || matches!(recording.condition(), Condition::Damaged { .. });
    let faulty = is_damaged
        .then(|| CliError::new(ExitCode::FrameFailures, format!("{} is damaged", recording.path().display())));
    if args.output.json {
        output::print(&Export {
            folder: args.out.to_string_lossy().into_owned(),
            condition: recording.condition().name(),
            topics: exported,
            error: faulty.as_ref().map(Error::from),
        })?;
    } else if !args.quiet {
        print(text(&exported, files, &args.out))?;
    }
    Ok(faulty.map_or(ExitCode::Success, |stop| stop.exit))
}

const fn colours(option: ColoursOption) -> Colours {
    match option {
        ColoursOption::Turbo => Colours::Turbo,
        ColoursOption::Viridis => Colours::Viridis,
        ColoursOption::Magma => Colours::Magma,
        ColoursOption::Grey => Colours::Grey,
    }
}

/// Refuses colours and a range that apply to nothing.
fn check_options(args: &ExportArgs, chosen: &[Chosen<'_>], colours: Option<Colours>) -> Result<(), CliError> {
    let formats =
        || chosen.iter().flat_map(|chosen| chosen.formats.iter().map(move |format| (*format, chosen.value_type)));
    let forms: Vec<Form> =
        formats().filter_map(|(format, value_type)| Form::for_maps(format, value_type, colours, args.range)).collect();
    let has_colours = forms.iter().any(|form| matches!(form, Form::Coloured(..)));
    let has_points = forms.iter().any(|form| form.is_cloud());
    if args.colormap.is_some() && !has_colours {
        return Err(CliError::usage(
            "--colormap has no effect: no disparity, depth or confidence is exported as PNG",
            "leave it out, or name such a topic with `--format png`",
        ));
    }
    if args.range.is_some() && !has_colours && !has_points {
        return Err(CliError::usage(
            "--range has no effect: neither coloured maps nor point clouds are exported",
            "add `--colormap turbo` or `--format ply`, or leave it out",
        ));
    }
    Ok(())
}

/// Prints warnings about the recording and the numbers.
fn print_warnings(args: &ExportArgs, recording: &Recording, exported: &[Exported]) {
    if *recording.condition() != Condition::Complete {
        say(format_args!("warning: {} is {}", recording.path().display(), recording.condition()));
    }
    for Exported { topic, clipped_pixels, .. } in exported.iter().filter(|topic| topic.clipped_pixels > 0) {
        let pixels = counted(*clipped_pixels, "pixel");
        say(format_args!(
            "warning: {pixels} of {topic} do not fit into 16 bits: they are written as the largest number, or as invalid if below zero; `--format npy` keeps the values"
        ));
    }
    for Exported { topic, .. } in exported.iter().filter(|topic| topic.files == 0 && !args.topics.is_empty()) {
        say(format_args!("warning: {topic} has no value on these frames"));
    }
}

fn text(exported: &[Exported], files: u64, folder: &Path) -> String {
    let row = |topic: &Exported| [topic.topic.clone(), counted(topic.files, "file"), topic.path.clone()];
    let rows: Vec<[String; 3]> = exported.iter().filter(|topic| topic.files > 0).map(row).collect();
    format!("{}{} in {}\n", aligned(&rows, &[1]), counted(files, "file"), folder.display())
}
