//! `depthloom compare`: is one result significantly better than another?

use std::path::{Path, PathBuf};

use depthloom_analysis::{CompareOptions, ComparedRun, ComparisonOutput, Resampling, Selection, Side};
use depthloom_graphs::language::{glob, nearest};
use depthloom_recording::Recording;
use depthloom_runner::Interrupt;
use depthloom_runs::{end, failed, open_frames};
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{CompareArgs, CompareBy, PixelsOption, RunsFolder, TableFormat};
use crate::output;
use crate::output::delivery::Delivery;
use crate::output::diagnostics::{Error, print_stop};
use crate::results::frames::note_frames_beyond;
use crate::results::samples::samples_of;
use crate::signals;

const TERMINAL_WIDTH: usize = 140;

/// Output of `compare`: which side is better, and how significantly.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Compare {
    #[serde(flatten)]
    comparison: ComparisonOutput,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

pub(crate) fn compare(args: &CompareArgs) -> Result<ExitCode, CliError> {
    let delivery = Delivery::new(&args.output)?;
    let interrupt = signals::listen("stopping")?;
    let mut opened = Opened { folder: args.folder.clone(), runs: Vec::new() };
    let mut sides: Vec<Side> = Vec::new();
    for written in &args.sides {
        let side = opened.side(written, sides.last())?;
        // A run of which parts are named is not a side itself.
        if sides.last().is_some_and(|last| last.name.is_none() && last.run == side.run && side.name.is_some()) {
            sides.pop();
        }
        sides.push(side);
    }
    let runs: Vec<ComparedRun<'_>> =
        opened.runs.iter().map(|(called, recording)| ComparedRun { called, recording }).collect();
    let options = CompareOptions {
        selection: Selection { estimates: args.estimates.clone(), ..args.scores.selection() },
        scores: args.metrics.clone(),
        baseline: args.baseline.clone(),
        resampling: args.intervals.resampling(match args.by {
            Some(CompareBy::Distance) => Resampling::OF_ERRORS,
            None => Resampling::OF_SCORES,
        }),
        grouping: args.group.clone(),
        fail_if: args.fail_if.clone(),
        typesetting: args.typesetting.typesetting(),
    };
    if args.by == Some(CompareBy::Distance) {
        return by_distance(args, &delivery, &runs, &sides, &options, &interrupt);
    }
    let compared = depthloom_analysis::compare(&runs, &sides, &options, &|| interrupt.stops_admission());
    let compared = compared.map_err(failed)?;
    let exceeded = compared.exceeded();
    let faulty = (!exceeded.is_empty())
        .then(|| CliError::new(ExitCode::FrameFailures, format!("limit exceeded: {}", exceeded.join("; "))));
    let bytes = match delivery.format {
        TableFormat::Terminal => compared.terminal(TERMINAL_WIDTH).into_bytes(),
        TableFormat::Md => compared.markdown().into_bytes(),
        TableFormat::Csv => compared.table.csv(),
        TableFormat::Parquet => compared.parquet().map_err(failed)?,
        TableFormat::Latex => compared.table.latex().into_bytes(),
        TableFormat::Json => {
            let output = Compare { comparison: compared.output.clone(), error: faulty.as_ref().map(Error::from) };
            output::text(&output).into_bytes()
        }
    };
    let recordings: Vec<&Path> = opened.runs.iter().map(|(_, recording)| recording.path()).collect();
    delivery.warn_of_condition(opened.runs.iter().map(|(_, recording)| recording));
    note_frames_beyond(opened.runs.iter().map(|(_, recording)| recording), args.scores.frames.as_ref());
    delivery.deliver(&bytes, &recordings)?;
    let exit = end(opened.runs.iter().map(|(_, recording)| recording));
    let Some(stop) = faulty else { return Ok(exit) };
    print_stop(&stop);
    Ok(stop.exit)
}

/// Compares absolute errors by ground-truth distance. Missing samples of a run are written first.
fn by_distance(
    args: &CompareArgs,
    delivery: &Delivery<'_>,
    runs: &[ComparedRun<'_>],
    sides: &[Side],
    options: &CompareOptions,
    interrupt: &Interrupt,
) -> Result<ExitCode, CliError> {
    if !matches!(args.scores.pixels, None | Some(PixelsOption::Common)) {
        let what =
            "`--by distance` supports `--pixels common` only: errors are compared on the pixels that are valid in both";
        return Err(CliError::usage(what, "leave out --pixels"));
    }
    if args.baseline.as_deref() == Some("best") {
        let what = "`--baseline best` does not support `--by distance`: there is no best side over all distances";
        return Err(CliError::usage(what, "name a side, or leave out --baseline"));
    }
    let is_silent = !delivery.is_shown();
    let mut samples = Vec::new();
    for run in runs {
        samples.push(samples_of(run.recording.path(), &args.folder, is_silent, interrupt)?);
    }
    let stop = || interrupt.stops_admission();
    let compared = depthloom_analysis::compare_by_distance(runs, &samples, sides, options, args.bins.as_ref(), &stop);
    let compared = compared.map_err(failed)?;
    let recordings: Vec<&Path> = runs.iter().map(|run| run.recording.path()).collect();
    let json = || output::text(&compared.output());
    delivery.warn_of_condition(runs.iter().map(|run| run.recording));
    note_frames_beyond(runs.iter().map(|run| run.recording), args.scores.frames.as_ref());
    delivery.table(&compared.table, TERMINAL_WIDTH, &compared.key, &recordings, json)?;
    Ok(end(runs.iter().map(|run| run.recording)))
}

/// The runs that were named so far.
struct Opened {
    folder: RunsFolder,
    runs: Vec<(String, Recording)>,
}

impl Opened {
    /// A side: a part of the run that was named last, a run, or a part of another.
    fn side(&mut self, written: &Path, last: Option<&Side>) -> Result<Side, CliError> {
        let (text, last) = (written.to_str(), last.map(|side| side.run));
        if let (Some(run), Some(text)) = (last, text)
            && self.has(run, text)?
        {
            return Ok(Side { run, name: Some(text.to_owned()) });
        }
        let is_run = match self.folder.recording(written, "compare") {
            Ok(path) => return Ok(Side { run: self.open(written, &path)?, name: None }),
            Err(stop) => stop,
        };
        for (place, _) in text.unwrap_or_default().match_indices(':') {
            let (run, name) = written.to_str().unwrap_or_default().split_at(place);
            let Ok(path) = self.folder.recording(Path::new(run), "compare") else { continue };
            let (run, name) = (self.open(Path::new(run), &path)?, &name[1..]);
            if !self.has(run, name)? {
                return Err(self.no_such(run, name)?);
            }
            return Ok(Side { run, name: Some(name.to_owned()) });
        }
        let Some(run) = last else { return Err(is_run) };
        let text = written.display().to_string();
        Err(if written.components().count() > 1 && written.exists() { is_run } else { self.no_such(run, &text)? })
    }

    fn open(&mut self, called: &Path, path: &PathBuf) -> Result<usize, CliError> {
        let known = self.runs.iter().position(|(_, recording)| recording.path() == path);
        if let Some(run) = known {
            return Ok(run);
        }
        self.runs.push((called.display().to_string(), open_frames(path)?));
        Ok(self.runs.len() - 1)
    }

    fn names(&self, run: usize) -> Result<Vec<String>, CliError> {
        depthloom_analysis::names(&self.runs[run].1).map_err(failed)
    }

    fn has(&self, run: usize, name: &str) -> Result<bool, CliError> {
        Ok(self.names(run)?.iter().any(|known| glob(name, known)))
    }

    fn no_such(&self, run: usize, name: &str) -> Result<CliError, CliError> {
        let (called, names) = (&self.runs[run].0, self.names(run)?);
        let what = format!("`{name}` is neither a run nor a variant or estimate of {called}");
        let near = nearest(name, names.iter().map(String::as_str));
        Ok(CliError::unknown(what, near, format!("{called} has {}", names.join(", "))))
    }
}
