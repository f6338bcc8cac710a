//! `depthloom analyse --samples-only`: one row per scored pixel.

use depthloom_analysis::SAMPLES;
use depthloom_graphs::counted;
use depthloom_runs::{end, open_frames, run_folder};
use depthloom_terminal::{CliError, ExitCode, print, say};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::AnalyseArgs;
use crate::output;
use crate::output::delivery::can_be_written;
use crate::results::frames::note_frames_beyond;
use crate::results::samples::{folder_of, write};
use crate::signals;

/// Output of `analyse --samples-only`: the file that was written.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Samples {
    file: String,
    /// The number of rows.
    samples: u64,
    frames: u64,
    /// The number of columns of estimates.
    estimates: u64,
    notes: Vec<String>,
}

/// Writes the samples of a run and prints where they are.
pub(crate) fn samples(args: &AnalyseArgs) -> Result<ExitCode, CliError> {
    let [run] = &args.runs[..] else {
        let what = format!("--samples-only needs one run, and {} were given", args.runs.len());
        return Err(CliError::usage(what, "write the samples of one run after the other"));
    };
    if args.frames.is_some() && args.output.out.is_none() {
        let what = "`--samples-only` with `--frames` needs --out: samples.parquet in a run's folder has all frames";
        return Err(CliError::usage(what, "name a file with `--out FILE.parquet`"));
    }
    let path = args.folder.recording(run, "analyse --samples-only")?;
    let out = match &args.output.out {
        Some(out) => {
            // The samples in the run's folder may be replaced.
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
    let recording = open_frames(&path)?;
    let written = write(&recording, &out, args.frames.as_ref(), args.quiet || args.output.json, &interrupt)?;
    note_frames_beyond([&recording], args.frames.as_ref());
    if args.output.json {
        output::print(&Samples {
            file: out.to_string_lossy().into_owned(),
            samples: written.samples,
            frames: written.frames,
            estimates: written.estimates as u64,
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
