//! The execution of a run: from a ready plan to a recording, a table and plots.

mod early_end;
mod folder;
pub(crate) mod live;
mod observers;
mod programs;
pub(crate) mod shard;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_analysis::{Prepared, ReportOptions, SAMPLES, SampleSink, Summary, plan_key};
use depthloom_graphs::language::Loaded;
use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{counted, render};
use depthloom_jobs::Shard;
use depthloom_nodes::onnx;
use depthloom_recording::{Condition, Recorder, Recording};
use depthloom_runner::{Checkpoints, Interrupt, Observer, Options, Report, RunError};
use depthloom_runs::environment::{self, ENVIRONMENT, Environment, Work};
use depthloom_runs::reuse::{self, Reused};
use depthloom_runs::run_folder::RunFolder;
use depthloom_runs::{
    File, FrameFailure, Frames, GitState, RECORDING, TIMINGS, failed, files_in, frames_and_failures, models,
    outdated_files, run_failed, write_timings,
};
use depthloom_terminal::{CliError, ExitCode, print, print_path, say};
use schemars::JsonSchema;
use serde::Serialize;

use self::early_end::EarlyEnd;
use self::folder::{FolderRequest, Reusable, make_folder};
use self::observers::Both;
use self::programs::{PRINTED, write_printed};
use crate::args::RunArgs;
use crate::output;
use crate::output::diagnostics::{self, Error};
use crate::output::progress::Progress;
use crate::results::page;
use crate::results::report::{self, analyse, no_pixel_counted, summary};
use crate::results::samples;
use crate::truths;

/// Of `run`: what was run, and what came of it.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Run {
    experiment: String,
    /// Its folder.
    run: String,
    /// The key of its plan: that of equal experiments, as Parquet files have it (`depthloom.run`).
    key: String,
    /// What was run, with every parameter: as `plan --json` tells it.
    parameters: render::Plan,
    /// By stage, its frames.
    frames: Vec<Frames>,
    /// How many frames failed.
    failed_frames: u64,
    /// What failed, frame by frame.
    failures: Vec<FrameFailure>,
    reused: Reused,
    warnings: Vec<String>,
    environment: Environment,
    /// The files in its folder, by name.
    files: Vec<File>,
    /// As `report --json` tells it.
    report: report::Report,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// A run whose sources and nodes run in other processes.
pub(crate) struct RemoteNodes<'a> {
    pub observer: &'a dyn Observer,
    /// Threads that wait for values, and encode them.
    pub workers: usize,
    pub window: usize,
}

/// Runs what is ready: records, scores and prints. Returns the folder of the run, too. `found` are warnings of the
/// command.
pub(crate) fn carry_out(
    args: &RunArgs,
    loaded: Loaded,
    mut ready: Ready,
    interrupt: &Interrupt,
    remote: Option<&RemoteNodes<'_>>,
    watch: &dyn Observer,
    found: &[String],
) -> Result<(ExitCode, PathBuf), CliError> {
    let Loaded { stored, read, .. } = loaded;
    let plan = ready.plan.clone();
    // The first files are those of the experiment. They may change while it runs.
    let written = plan.written.iter().map(|(_, text)| text.as_str());
    let git = GitState::of_files(read.iter().map(PathBuf::as_path).zip(written));
    if args.samples {
        depthloom_analysis::check_samples(&plan).map_err(failed)?;
    }
    let of_sources = [found.to_vec(), std::mem::take(&mut ready.warnings), truths::missing(&ready)].concat();
    print_warnings(args, &of_sources);
    let runs = args.folder.path();
    let request = FolderRequest {
        out: args.out.as_deref(),
        overwrite: args.overwrite,
        is_fresh: args.is_fresh(),
        is_json: args.output.json,
        runs: &runs,
    };
    let (folder, resumable) = make_folder(&request, &plan, &stored, &read)?;
    let earlier = reuse::earlier_runs(args.is_fresh(), &folder, &args.folder.path(), &plan, &|_| false);
    let unreadable = reuse::unreadable(&earlier);
    print_warnings(args, &unreadable);
    let resumable = Reusable { resumable, earlier }.verified(args, &folder, &ready, None, remote.is_some())?;
    let mut options = options(args, &folder);
    if let Some(RemoteNodes { workers, window, .. }) = remote {
        (options.workers, options.window) = (*workers, Some(*window));
    }

    let stopped = || interrupt.stops_admission();
    let partial = folder.partial.clone();
    let target = Target { folder: &folder, partial: &partial, remote, shard: None, watch };
    let start = Work::since_start();
    let recorded = record(ready, &plan, args, &options, target, resumable, interrupt, &stopped);
    let Recorded { failed, warnings, checkpoints, reused, prepared, has_printed } = match recorded {
        Ok(recorded) => recorded,
        Err(ended) => return Err(ended.stop(folder, remote.is_some())),
    };
    let finished = finish(args, &folder, prepared, interrupt, || {
        environment::describe(options.workers, options.window, &read, git).with_start(start)
    });
    let Finished { report, environment, key, frames, failures } = finished.map_err(|stop| {
        let partial = folder.partial.display();
        stop.also(format!("the recording is complete: `depthloom report {partial}` writes its tables"))
    })?;
    // The last first: a removal that is interrupted leaves no gap in their numbers.
    for outdated in outdated_files(&folder.partial).into_iter().rev() {
        std::fs::remove_file(&outdated).map_err(|error| {
            CliError::of_writing(ExitCode::Engine, format_args!("failed to remove {}", outdated.display()), &error)
        })?;
    }
    let out = folder.finish()?;
    checkpoints.remove();
    if has_printed && !is_silent(args) {
        say(format_args!("the output of programs is in {}", out.join(PRINTED).display()));
    }

    let warnings = [of_sources, unreadable, warnings].concat();
    let incomplete = (failed > 0).then(|| {
        let frames = counted(failed, "frame");
        CliError::new(ExitCode::FrameFailures, format!("{frames} failed; values that depend on them are left out"))
    });
    let incomplete = incomplete.or_else(|| no_pixel_counted(&report));
    let output = || Run {
        experiment: plan.experiment.clone(),
        run: out.to_string_lossy().into_owned(),
        key,
        parameters: plan.summary_json(),
        frames,
        failed_frames: failed,
        failures,
        reused,
        warnings,
        environment,
        files: files_in(&out),
        report: report::Report::new(&report, None),
        error: incomplete.as_ref().map(Error::from),
    };
    show(args, &report, output, &out).map_err(|stop| stop.also(format!("the run is complete in {}", out.display())))?;
    if args.page.open {
        page::open(&out);
    }
    let exit = incomplete.map_or(ExitCode::Success, |stop| {
        say(&stop);
        stop.exit
    });
    Ok((exit, out))
}

/// Whether nothing but errors is printed while it runs.
pub(crate) fn is_silent(args: &RunArgs) -> bool {
    args.quiet || args.output.json
}

fn options(args: &RunArgs, folder: &RunFolder) -> Options {
    let default = Options::default();
    Options {
        workers: args.workers.map_or(default.workers, usize::from),
        window: args.window.map(usize::from),
        keep_going: args.keep_going,
        checkpoints: Some(folder.checkpoints()),
        audit: args.audit.into(),
        share: None,
    }
}

/// Where a run is recorded, and what of it.
struct Target<'a, 'b> {
    folder: &'b RunFolder,
    /// The folder while it is partial.
    partial: &'a Path,
    remote: Option<&'b RemoteNodes<'b>>,
    /// If this process computes a shard of the run.
    shard: Option<&'b Shard>,
    watch: &'b dyn Observer,
}

struct Recorded<'a> {
    /// How many values were reused, and of which runs.
    reused: Reused,
    failed: u64,
    warnings: Vec<String>,
    /// What is removed once the run is complete.
    checkpoints: Checkpoints,
    /// What the report need not read from the recording.
    prepared: Prepared<'a>,
    has_printed: bool,
}

/// Runs the frames, closes the recording, and prints the warnings.
#[expect(clippy::too_many_arguments, reason = "each is another thing, and they meet here alone")]
fn record<'a>(
    ready: Ready,
    plan: &Plan,
    args: &RunArgs,
    options: &Options,
    Target { folder, partial, remote, shard, watch }: Target<'a, '_>,
    resumable: Reusable,
    interrupt: &Interrupt,
    stopped: &'a (dyn Fn() -> bool + Sync),
) -> Result<Recorded<'a>, EarlyEnd> {
    let Reusable { resumable, earlier } = resumable;
    let earlier = Arc::new(earlier);
    let recorder = match &resumable {
        Some(resumable) => Recorder::resume(resumable, plan),
        None => Recorder::create(folder.file(RECORDING), plan),
    };
    let recorder = recorder.map_err(|error| EarlyEnd {
        why: CliError::remedied(ExitCode::Engine, "failed to start the recording", &error),
        // What an earlier process wrote stays.
        frames: resumable.as_ref().map_or(0, |resumable| reuse::frames(resumable)),
        is_suspect: false,
    })?;
    // Values of remote nodes are not looked up in earlier runs: their keys come with them.
    let recorder = if remote.is_none() { recorder.with_earlier(Arc::clone(&earlier)) } else { recorder };
    let recorder = recorder.durable(args.durable);
    let windows = options.share.as_ref().map(depthloom_jobs::windows).unwrap_or_default();
    let recorder = recorder.with_windows(&windows).map_err(|error| EarlyEnd {
        why: CliError::remedied(ExitCode::Engine, "failed to start the recording", &error),
        frames: 0,
        is_suspect: false,
    })?;
    let recorder =
        if shard.is_some_and(|shard| !shard.records_frames()) { recorder.without_frames() } else { recorder };
    if resumable.is_some() && !is_silent(args) {
        let (frames, partial) = (counted(recorder.frames(), "frame"), folder.partial.display());
        say(format_args!("resuming {partial} after {frames}"));
    }
    if let Some(Condition::Damaged { offset, what, .. }) = resumable.as_ref().map(|resumable| resumable.condition()) {
        let partial = folder.partial.display();
        print_warnings(args, &[format!("recomputing the frames of {partial} after byte {offset}: {what}")]);
    }
    let progress = Progress::new(plan, is_silent(args));
    // If that fails, the report says why, when the frames are stored.
    let samples_in_memory = report_options(args).samples_in_memory;
    let sample_sink = match shard {
        None => SampleSink::new(&recorder, plan, partial, samples_in_memory, stopped).ok(),
        Some(_) => None,
    };
    let watch = Both(&progress, remote.map_or(watch, |remote| remote.observer));
    let ran = match &sample_sink {
        Some(sink) => depthloom_runner::run(ready, sink, options, &watch, interrupt),
        None => depthloom_runner::run(ready, &recorder, options, &watch, interrupt),
    };
    let printed = write_printed(folder);
    let samples = sample_sink.and_then(SampleSink::finish);
    // Whatever happened, what was recorded is closed properly: a run that failed keeps the frames before the failure.
    let finished = match &ran {
        Ok(ran) if !ran.interrupted => recorder.finish(&[]),
        _ => recorder.finish_early(),
    };
    let finished =
        finished.map_err(|error| CliError::remedied(ExitCode::Engine, "failed to close the recording", &error));
    let ended = |why| EarlyEnd { why, frames: recorder.frames(), is_suspect: false };
    // Of several errors the first is reported.
    let ran = ran.map_err(|error| {
        let is_suspect = matches!(error, RunError::Audit(_));
        EarlyEnd { is_suspect, ..ended(run_failed(&error)) }
    })?;
    finished.map_err(ended)?;
    let (has_printed, failed_programs) = printed.map_err(ended)?;
    let warnings = [warnings(&ran, plan), failed_programs, reuse::warnings(&earlier)].concat();
    print_warnings(args, &warnings);
    write_timings(&ran, plan, &recorder, &folder.file(TIMINGS)).map_err(ended)?;
    if ran.interrupted {
        return Err(ended(CliError::new(ExitCode::Interrupted, "interrupted")));
    }
    let failed = ran.stages.iter().map(|stage| stage.failed).sum();
    let reused = reuse::reuse_counts(&ran, plan, &earlier);
    if let (Some(text), false) = (reused.text(), is_silent(args)) {
        say(text);
    }
    let prepared = Prepared { samples, reports: reuse::reports(&earlier, options.audit) };
    Ok(Recorded { failed, warnings, checkpoints: ran.checkpoints, reused: reused.output(), prepared, has_printed })
}

fn report_options(args: &RunArgs) -> ReportOptions {
    ReportOptions { paper: args.paper, ..ReportOptions::default() }
}

/// Libraries that were not used, and the warnings of nodes.
fn warnings(ran: &Report, plan: &Plan) -> Vec<String> {
    let engine = onnx::in_use();
    let passed_over = engine.into_iter().flat_map(|engine| {
        engine.refused.iter().map(|refused| format!("networks ran in {}: {refused}", engine.title()))
    });
    passed_over.chain(ran.warnings.iter().map(|warning| warning.text(plan))).collect()
}

/// Prints warnings, unless they go into the JSON object.
fn print_warnings(args: &RunArgs, warnings: &[String]) {
    if !args.output.json {
        warnings.iter().for_each(|warning| diagnostics::print_warning(warning));
    }
}

/// The results of a run whose folder is complete.
struct Finished {
    report: Summary,
    environment: Environment,
    key: String,
    frames: Vec<Frames>,
    failures: Vec<FrameFailure>,
}

/// Writes what belongs beside a complete recording: models, tables, figures, and the environment.
fn finish(
    args: &RunArgs,
    folder: &RunFolder,
    prepared: Prepared<'_>,
    interrupt: &Interrupt,
    environment: impl FnOnce() -> Environment,
) -> Result<Finished, CliError> {
    let before_report = Work::since_start();
    let recording = Recording::open(folder.file(RECORDING))
        .map_err(|error| CliError::remedied(ExitCode::Engine, "failed to read the recording back", &error))?;
    models::write(&recording, &folder.partial)?;
    let report = analyse(&recording, &folder.partial, &report_options(args), prepared, interrupt)?;
    if args.samples {
        samples::write(&recording, &folder.file(SAMPLES), None, is_silent(args), interrupt)?;
    }
    let mut environment = environment();
    environment.report = Some(Work::since(before_report));
    folder.write(ENVIRONMENT, &environment.text())?;
    if !args.page.no_page {
        let before_page = Work::since_start();
        page::write(
            &recording,
            &folder.partial,
            &report,
            &page::surroundings(&folder.partial),
            args.page.options(),
            is_silent(args),
            interrupt,
        )?;
        // The page's time and memory are the run's, too.
        environment.page = Some(Work::since(before_page));
        environment.measure_again();
        folder.write(ENVIRONMENT, &environment.text())?;
    }
    let (frames, failures) = frames_and_failures(&recording);
    Ok(Finished { report, environment, key: plan_key(recording.plan()).to_string(), frames, failures })
}

fn show(args: &RunArgs, report: &Summary, output: impl FnOnce() -> Run, out: &Path) -> Result<(), CliError> {
    if args.output.json {
        return output::print(&output());
    }
    if !args.quiet {
        print(summary(report, out))?;
    }
    print_path("run: ", out)
}
