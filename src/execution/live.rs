//! The execution of a live run: from a stream to a recording, latencies and an exit code.

mod output;
mod ring;
mod sink;

use std::path::PathBuf;
use std::sync::Arc;

use depthloom_analysis::{Prepared, ReportOptions, Summary};
use depthloom_graphs::contracts::ErrorMessage;
use depthloom_graphs::language::Loaded;
use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{chain, counted};
use depthloom_recording::{Recorder, Recording};
use depthloom_runner::{Audit, Interrupt, Live, LiveReport, Options, Report, run_live};
use depthloom_runs::environment::{self, ENVIRONMENT};
use depthloom_runs::run_folder::RunFolder;
use depthloom_runs::{GitState, LIVE, RECORDING, TIMINGS, models, reuse, run_failed, write_timings};
use depthloom_terminal::{CliError, ExitCode, print, print_path, say};
use depthloom_viewer::{ServeAddress, Viewer, ViewerSink};

pub(crate) use self::output::LiveOutput;
pub(crate) use self::ring::RingTrigger;
pub(crate) use self::sink::LatestMap;
use self::sink::{LiveSink, Storage};
use super::early_end::EarlyEnd;
use super::folder::{FolderRequest, make_folder};
use super::programs::{PRINTED, write_printed};
use crate::args::LiveArgs;
use crate::output::diagnostics;
use crate::output::live::{LiveProgress, Messages};
use crate::results::report;

/// Whether nothing but errors is printed while it runs.
pub(crate) const fn is_silent(args: &LiveArgs) -> bool {
    args.quiet || args.output.json
}

/// What came of a live run.
struct Finished {
    /// Its folder, unless nothing was recorded.
    out: Option<PathBuf>,
    live: LiveReport,
    /// How many frames have a failure.
    failed: u64,
    warnings: Vec<String>,
    /// Whether programs printed something.
    has_printed: bool,
    /// The scores, if they were requested.
    scores: Option<Summary>,
}

/// Runs what is ready: records and prints.
pub(crate) fn carry_out(
    args: &LiveArgs,
    loaded: Loaded,
    mut ready: Ready,
    live: Live,
    interrupt: &Interrupt,
    trigger: Option<&RingTrigger>,
) -> Result<ExitCode, CliError> {
    let plan = ready.plan.clone();
    let stage = plan.runs[live.run].stage.clone();
    let found = std::mem::take(&mut ready.warnings);
    print_warnings(args, &found);
    let mut finished = match args.keep.zip(trigger) {
        Some(kept) => ring::run_ring(args, kept, &plan, ready, live, interrupt)?,
        None if args.no_record => run_unrecorded(args, &plan, ready, live, interrupt)?,
        None => run_recorded(args, loaded, &plan, ready, live, interrupt)?,
    };
    finished.warnings.splice(0..0, found);
    let incomplete = incomplete(args, &finished);
    if args.output.json {
        crate::output::print(&LiveOutput::new(&plan.experiment, &stage, &finished, incomplete.as_ref()))?;
    } else {
        if !args.quiet {
            print(output::text(&stage, &finished.live))?;
        }
        if let (Some(out), true) = (&finished.out, finished.has_printed && !args.quiet) {
            say(format_args!("the output of programs is in {}", out.join(PRINTED).display()));
        }
        if let (Some(summary), Some(out), false) = (&finished.scores, &finished.out, args.quiet) {
            print(report::summary(summary, out))?;
        }
        if let Some(out) = &finished.out {
            print_path(if args.keep.is_some() { "kept in: " } else { "run: " }, out)?;
        }
    }
    Ok(incomplete.map_or(ExitCode::Success, |stop| {
        say(&stop);
        stop.exit
    }))
}

/// Why the exit code is not 0.
fn incomplete(args: &LiveArgs, finished: &Finished) -> Option<CliError> {
    if finished.failed > 0 {
        let what = format!("{} of {} frames failed", finished.failed, finished.live.processed);
        return Some(CliError::new(ExitCode::FrameFailures, what));
    }
    let dropped = finished.live.drops.total();
    (dropped > 0 && !args.allow_drops).then(|| {
        let what = format!("{dropped} of {} frames were dropped", finished.live.offered);
        CliError::new(ExitCode::FrameFailures, what)
            .remedy("--allow-drops accepts this; --no-drop lets the source wait")
    })
}

fn options(args: &LiveArgs, checkpoints: Option<PathBuf>) -> Options {
    let workers = args.workers.map_or(Options::default().workers, usize::from);
    let window = args.window.map(usize::from);
    // An audit would delay the start: `run` audits.
    Options { workers, window, keep_going: true, checkpoints, audit: Audit::None, share: None }
}

fn execute(
    args: &LiveArgs,
    plan: &Plan,
    ready: Ready,
    live: Live,
    (storage, checkpoints): (Storage<'_>, Option<PathBuf>),
    messages: &Messages,
    interrupt: &Interrupt,
) -> Result<Report, CliError> {
    let viewer = serve(args, plan)?;
    let sink = LiveSink::new(storage, plan, live.run, viewer.is_some());
    let progress = LiveProgress::new(plan, live.run, sink.latest(), messages.clone(), args.plain, is_silent(args));
    let ran = {
        let sink = ViewerSink::new(&sink, viewer.as_ref());
        run_live(ready, live, &sink, &options(args, checkpoints), &progress, interrupt)
    };
    end_serving(args, viewer);
    ran.map_err(|error| run_failed(&error))
}

/// Starts the server for viewers, if it was requested.
fn serve(args: &LiveArgs, plan: &Plan) -> Result<Option<Viewer>, CliError> {
    let Some(address) = &args.serve else { return Ok(None) };
    let refused = |error: ErrorMessage| CliError::remedied(ExitCode::Usage, "--serve", &error);
    let address = ServeAddress::parse(address).map_err(refused)?;
    let viewer = Viewer::start(plan, address, &args.topics, &plan.experiment).map_err(refused)?;
    print_warnings(args, address.warning().as_slice());
    if !is_silent(args) {
        say(format_args!("serving at ws://{}", viewer.address()));
    }
    Ok(Some(viewer))
}

/// Ends the server, and warns of what viewers missed.
fn end_serving(args: &LiveArgs, viewer: Option<Viewer>) {
    let Some(mut viewer) = viewer else { return };
    viewer.finish();
    let missed = viewer.counts().dropped_frames;
    let mut warnings = Vec::new();
    if missed > 0 {
        warnings
            .push(format!("viewers missed values of {}: they could not be encoded in time", counted(missed, "frame")));
    }
    warnings
        .extend(viewer.take_error().map(|error| format!("a value could not be shown to viewers: {}", chain(&error))));
    print_warnings(args, &warnings);
}

fn print_warnings(args: &LiveArgs, warnings: &[String]) {
    if !args.output.json {
        warnings.iter().for_each(|warning| diagnostics::print_warning(warning));
    }
}

/// The report of the live stage, and what else the caller prints.
fn finished(args: &LiveArgs, plan: &Plan, ran: Report, failed_programs: Vec<String>) -> Result<Finished, CliError> {
    let warnings = [super::warnings(&ran, plan), failed_programs].concat();
    print_warnings(args, &warnings);
    let failed = ran.stages.iter().map(|stage| stage.failed).sum();
    match ran.live {
        Some(live) if !ran.interrupted => {
            Ok(Finished { out: None, live, failed, warnings, has_printed: false, scores: None })
        }
        _ => Err(CliError::new(ExitCode::Interrupted, "interrupted before the live stage ended")),
    }
}

fn run_unrecorded(
    args: &LiveArgs,
    plan: &Plan,
    ready: Ready,
    live: Live,
    interrupt: &Interrupt,
) -> Result<Finished, CliError> {
    let earlier = reuse::beside(None, &args.folder.path(), plan);
    let storage = (Storage::Nothing { earlier: &earlier }, None);
    let ran = execute(args, plan, ready, live, storage, &Messages::default(), interrupt)?;
    finished(args, plan, ran, Vec::new())
}

fn run_recorded(
    args: &LiveArgs,
    loaded: Loaded,
    plan: &Plan,
    ready: Ready,
    live: Live,
    interrupt: &Interrupt,
) -> Result<Finished, CliError> {
    let Loaded { stored, read, .. } = loaded;
    let written = plan.written.iter().map(|(_, text)| text.as_str());
    let git = GitState::of_files(read.iter().map(PathBuf::as_path).zip(written));
    let runs = args.folder.path();
    let partial = args.out.as_deref().map(depthloom_durable::partial_name).filter(|_| !args.overwrite);
    let has_frames =
        |partial: &PathBuf| Recording::open(partial.join(RECORDING)).is_ok_and(|recording| !recording.is_empty());
    if let Some(partial) = partial.filter(has_frames) {
        let what = format!("{} has frames of a run that ended early, and a live run cannot resume", partial.display());
        return Err(CliError::usage(what, "choose another --out, or replace it with --overwrite"));
    }
    let request = FolderRequest {
        out: args.out.as_deref(),
        overwrite: args.overwrite,
        // A live run cannot be resumed: its frames have passed.
        is_fresh: true,
        is_json: args.output.json,
        runs: &runs,
    };
    let (folder, _) = make_folder(&request, plan, &stored, &read)?;
    let earlier = Arc::new(reuse::earlier_runs(false, &folder, &runs, plan, &|_| false));
    print_warnings(args, &reuse::unreadable(&earlier));
    let recorder = match Recorder::create(folder.file(RECORDING), plan) {
        Ok(recorder) => recorder.with_earlier(earlier).durable(args.durable),
        Err(error) => {
            let why = CliError::remedied(ExitCode::Engine, "failed to start the recording", &error);
            return Err(EarlyEnd { why, frames: 0, is_suspect: false }.stop_live(folder));
        }
    };
    let storage = (Storage::Sink(&recorder), Some(folder.checkpoints()));
    let ran = execute(args, plan, ready, live, storage, &Messages::default(), interrupt);
    let closed = match &ran {
        Ok(ran) if !ran.interrupted => recorder.finish(&[]),
        _ => recorder.finish_early(),
    };
    let closed = closed.map_err(|error| CliError::remedied(ExitCode::Engine, "failed to close the recording", &error));
    // Of several errors the first is reported.
    let complete = ran.and_then(|ran| closed.map(|_| ran)).and_then(|ran| {
        let workers = options(args, None).workers;
        let environment = environment::describe(workers, args.window.map(usize::from), &read, git);
        folder.write(ENVIRONMENT, &environment.text())?;
        write_files(args, plan, &folder, &recorder, ran, interrupt)
    });
    match complete {
        Ok((mut finished, checkpoints)) => {
            finished.out = Some(folder.finish()?);
            checkpoints.remove();
            Ok(finished)
        }
        Err(why) => Err(EarlyEnd { why, frames: recorder.frames(), is_suspect: false }.stop_live(folder)),
    }
}

/// Writes what belongs beside the recording.
fn write_files(
    args: &LiveArgs,
    plan: &Plan,
    folder: &RunFolder,
    recorder: &Recorder,
    ran: Report,
    interrupt: &Interrupt,
) -> Result<(Finished, depthloom_runner::Checkpoints), CliError> {
    let (has_printed, failed_programs) = write_printed(folder)?;
    write_timings(&ran, plan, recorder, &folder.file(TIMINGS))?;
    let checkpoints = ran.checkpoints.clone();
    let mut finished = finished(args, plan, ran, failed_programs)?;
    finished.has_printed = has_printed;
    finished.out = Some(folder.out.clone());
    let recording = Recording::open(folder.file(RECORDING))
        .map_err(|error| CliError::remedied(ExitCode::Engine, "failed to read the recording back", &error))?;
    models::write(&recording, &folder.partial)?;
    if args.scores {
        let options = ReportOptions::default();
        let summary = report::analyse(&recording, &folder.partial, &options, Prepared::default(), interrupt)?;
        finished.scores = Some(summary);
    }
    let stage = &plan.runs[finished.live.run].stage;
    let output = LiveOutput::new(&plan.experiment, stage, &finished, None);
    folder.write(LIVE, &crate::output::text(&output))?;
    Ok((finished, checkpoints))
}
