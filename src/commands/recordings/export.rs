//! `depthloom export`: recorded values as files that other programs read.

use depthloom_graphs::plan::RunId;
use std::collections::BTreeSet;
use std::path::Path;

use depthloom_codecs::files::Colours;
use depthloom_recording::{Condition, Recording};
use depthloom_runs::{environment, open, recording_of};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{ColoursOption, ExportArgs};
use crate::output;
use crate::output::diagnostics::Error;
use crate::output::progress::bar;
use crate::signals;
use depthloom_export::{Chosen, ExportFormat, Exported, Folder, Form, Maps, chosen, frames, write_model, write_rows};
use depthloom_graphs::{chain, counted};
use depthloom_terminal::{CliError, ExitCode, aligned, print, say};

/// Of `export`: what was written.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Export {
    folder: String,
    /// `whole`, `unfinished`, `recovered` or `damaged`.
    condition: &'static str,
    topics: Vec<Exported>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

pub(crate) fn export(args: &ExportArgs) -> Result<ExitCode, CliError> {
    let folder = Folder::at(&args.out, args.overwrite)?;
    let path = recording_of(&args.run, "export")?;
    let interrupt = signals::listen("stopping: files begun are finished")?;
    let recording = open(&path)?;
    let chosen = chosen(recording.plan(), &args.topics, &args.format)?;
    let colours = args.colormap.map(colours);
    meant(args, &chosen, colours)?;
    let runs: BTreeSet<RunId> = chosen.iter().map(|chosen| chosen.run).collect();
    let frames = frames(&recording, &runs, args.frames.as_ref())?;
    let maps = Maps::new(&recording, &frames, &chosen, colours, args.range)?;
    let as_one = |format: ExportFormat| {
        let of_format = chosen.iter().filter(move |chosen| chosen.formats.contains(&format));
        of_format.map(move |chosen| (chosen, format))
    };
    let files = || as_one(ExportFormat::Onnx).chain(as_one(ExportFormat::Parquet));
    folder.check(maps.files().chain(files().map(|(chosen, format)| chosen.path_with(format.name()))))?;
    folder.create()?;

    let bar = bar(args.quiet || args.output.json, maps.work(), "{bar:30} {pos}/{len}  {eta} left");
    let stop = || interrupt.stops_admission();
    let mut damaged = maps.write(&folder, environment::cores(), &stop, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let mut exported: Vec<Exported> = maps.exported().collect();
    for (chosen, format) in files().take_while(|_| !stop()) {
        if format == ExportFormat::Onnx {
            exported.push(write_model(&recording, chosen, &folder)?);
        } else if let Some((rows, left_out)) = write_rows(&recording, chosen, &frames[chosen.run], &folder, &stop)? {
            exported.push(rows);
            damaged.extend(left_out);
        }
    }
    let files: u64 = exported.iter().map(|of| of.files).sum();
    if stop() {
        let whole = format!("{} in {}", counted(files, "file"), args.out.display());
        return Err(
            CliError::new(ExitCode::Interrupted, "interrupted while exporting").remedy(format!("whole: {whole}"))
        );
    }
    for error in &damaged {
        say(format_args!("warning: left out: {}", chain(error)));
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

/// That colours and a range are of use to something.
fn meant(args: &ExportArgs, chosen: &[Chosen<'_>], colours: Option<Colours>) -> Result<(), CliError> {
    let formats =
        || chosen.iter().flat_map(|chosen| chosen.formats.iter().map(move |format| (*format, chosen.value_type)));
    let forms: Vec<Form> =
        formats().filter_map(|(format, of)| Form::for_maps(format, of, colours, args.range)).collect();
    let has_colours = forms.iter().any(|form| matches!(form, Form::Coloured(..)));
    let has_points = forms.iter().any(|form| form.is_cloud());
    if args.colormap.is_some() && !has_colours {
        return Err(CliError::usage(
            "--colormap colours nothing: it is of disparities, depths and weights as PNG",
            "leave it out, or ask for one of these with `--format png`",
        ));
    }
    if args.range.is_some() && !has_colours && !has_points {
        return Err(CliError::usage(
            "--range bounds nothing: it is of colours and of point clouds",
            "add --colormap turbo, or `--format ply`",
        ));
    }
    Ok(())
}

/// Prints warnings about the recording and the numbers.
fn print_warnings(args: &ExportArgs, recording: &Recording, exported: &[Exported]) {
    if *recording.condition() != Condition::Whole {
        say(format_args!("warning: {} is {}", recording.path().display(), recording.condition()));
    }
    for Exported { topic, clipped_pixels, .. } in exported.iter().filter(|of| of.clipped_pixels > 0) {
        let pixels = counted(*clipped_pixels, "pixel");
        say(format_args!(
            "warning: {pixels} of {topic} are beyond what 16 bits hold and stand as the largest number, or as none below zero; `--format npy` has them"
        ));
    }
    for Exported { topic, .. } in exported.iter().filter(|of| of.files == 0 && !args.topics.is_empty()) {
        say(format_args!("warning: {topic} has no value on these frames"));
    }
}

fn text(exported: &[Exported], files: u64, folder: &Path) -> String {
    let row = |of: &Exported| [of.topic.clone(), counted(of.files, "file"), of.path.clone()];
    let rows: Vec<[String; 3]> = exported.iter().filter(|of| of.files > 0).map(row).collect();
    format!("{}{} in {}\n", aligned(&rows, &[1]), counted(files, "file"), folder.display())
}
