//! The execution of a run: from a ready plan to a recording, a table and plots.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_analysis::{Prepared, ReportOptions, SAMPLES, SamplingTap, Summary, plan_key};
use depthloom_graphs::contracts::Failure;
use depthloom_graphs::language::Loaded;
use depthloom_graphs::plan::{NodeId, Plan, RunId};
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{Frame, counted, render};
use depthloom_nodes::{onnx, process};
use depthloom_recording::{Condition, EarlierRuns, Recorder, Recording, RecordingError};
use depthloom_runner::{Checkpoints, Interrupt, Observer, Options, Report, RunError, Unwatched};
use depthloom_runs::{
    File,
    environment::{self, ENVIRONMENT, Environment},
    files_in, models,
    reuse::{self, OUTDATED, Reused},
    run_folder::{Begun, RunFolder},
};
use depthloom_runs::{FrameFailure, Frames, RECORDING, TIMINGS, frames_and_failures, run_failed, write_timings};
use depthloom_terminal::{CliError, ExitCode, print, print_path, say};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;

use crate::args::RunArgs;
use crate::diagnostics::{self, Error};
use crate::output;
use crate::page;
use crate::progress::Progress;
use crate::report::{self, analyse, no_pixel_counted, summary};
use crate::samples;
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
    /// Observes the progress of the recording.
    pub observer: &'a dyn Observer,
    /// Threads that wait for values, and encode them.
    pub workers: usize,
    /// Frames in flight.
    pub window: usize,
}

/// Runs what is ready: records, scores and prints.
pub(crate) fn carry_out(
    args: &RunArgs,
    loaded: Loaded,
    mut ready: Ready,
    interrupt: &Interrupt,
    remote: Option<&RemoteNodes<'_>>,
) -> Result<ExitCode, CliError> {
    let Loaded { kept, read, .. } = loaded;
    let plan = ready.plan.clone();
    let of_sources = [std::mem::take(&mut ready.warnings), truths::missing(&ready)].concat();
    tell(args, &of_sources);
    let (folder, begun) = make_folder(args, &plan, &kept, &read)?;
    let earlier = reuse::earlier_runs(args.is_fresh(), &folder, &plan);
    let unreadable = reuse::unreadable(&earlier);
    tell(args, &unreadable);
    let begun = Reusable { begun, earlier }.verified(args, &folder, &ready, remote.is_some())?;
    let mut options = options(args, &folder);
    if let Some(RemoteNodes { workers, window, .. }) = remote {
        (options.workers, options.window) = (*workers, Some(*window));
    }

    let stopped = || interrupt.stops_admission();
    let partial = folder.partial.clone();
    let recorded = record(ready, &plan, args, &options, (&folder, &partial), begun, interrupt, &stopped, remote);
    let Recorded { failed, warnings, checkpoints, reused, prepared, has_printed } = match recorded {
        Ok(recorded) => recorded,
        Err(ended) => return Err(ended.stop(folder, remote.is_some())),
    };
    let finished =
        finish(args, &folder, prepared, interrupt, || environment::describe(options.workers, options.window, &read));
    let Finished { report, environment, key, frames, failures } = finished.map_err(|stop| {
        let partial = folder.partial.display();
        stop.also(format!("the recording is whole: `depthloom report {partial}` makes its tables"))
    })?;
    let outdated = folder.file(OUTDATED);
    if outdated.exists() {
        std::fs::remove_file(&outdated).map_err(|error| {
            CliError::of_writing(ExitCode::Engine, format_args!("failed to remove {}", outdated.display()), &error)
        })?;
    }
    let out = folder.finish()?;
    checkpoints.remove();
    if has_printed && !is_silent(args) {
        say(format_args!("what programs printed is in {}", out.join(PRINTED).display()));
    }

    let warnings = [of_sources, unreadable, warnings].concat();
    let incomplete = (failed > 0).then(|| {
        let frames = counted(failed, "frame");
        CliError::new(ExitCode::FrameFailures, format!("{frames} failed; what depended on them is left out"))
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
        report: report::Report::of(&report, None),
        error: incomplete.as_ref().map(Error::from),
    };
    show(args, &report, output, &out).map_err(|stop| stop.also(format!("the run is whole in {}", out.display())))?;
    if args.page.open {
        page::open(&out);
    }
    Ok(incomplete.map_or(ExitCode::Success, |stop| {
        say(&stop);
        stop.exit
    }))
}

/// Whether nothing but errors is printed while it runs.
pub(crate) fn is_silent(args: &RunArgs) -> bool {
    args.quiet || args.output.json
}

/// The folder to write: that of `--out`, or a new one; and the recording of the interrupted run in it, if there is one.
fn make_folder(
    args: &RunArgs,
    plan: &Plan,
    kept: &[(String, String)],
    read: &[PathBuf],
) -> Result<(RunFolder, Option<Arc<Recording>>), CliError> {
    let mut recording = None;
    let begun = |partial: &Path| {
        let path = partial.join(RECORDING);
        // A run that ended before it recorded anything again leaves only what was set aside: no frame of that is lost.
        let nothing = || match Recording::open(partial.join(OUTDATED)) {
            Ok(aside) if aside.is_empty() => Begun::Nothing,
            Ok(aside) if !args.is_fresh() && aside.is_of_experiment(plan) => Begun::This,
            Ok(_) => Begun::Other,
            // Frames that cannot be read at the moment are not removed either.
            Err(_) if partial.join(OUTDATED).exists() => Begun::Other,
            Err(_) => Begun::Nothing,
        };
        match Recording::open(&path) {
            Ok(found) if found.is_empty() => nothing(),
            Ok(found) if !args.is_fresh() && found.is_of_experiment(plan) => {
                recording = Some(Arc::new(found));
                Begun::This
            }
            // It ended before the head of the recording was written, or the file was made.
            Err(RecordingError::NotARecording { .. }) => nothing(),
            Err(_) if std::fs::metadata(&path).map_or(true, |file| file.len() == 0) => nothing(),
            Ok(_) | Err(_) => Begun::Other,
        }
    };
    let folder = match &args.out {
        Some(out) if args.output.json && out.to_str().is_none() => {
            let what = format!("the output folder `{}` is no UTF-8, which --json prints", out.display());
            return Err(CliError::usage(what, "choose another --out, or leave --json out"));
        }
        Some(out) => RunFolder::create(out, args.overwrite, read, begun)?,
        None => RunFolder::create_new(&Path::new("runs").join(&plan.experiment), &environment::utc_stamp())?,
    };
    match write_experiment(&folder, kept, read) {
        Ok(()) => Ok((folder, recording)),
        Err(stop) if folder.goes_on => Err(stop),
        Err(stop) => {
            folder.discard();
            Err(stop)
        }
    }
}

/// Writes the experiment's files beside the recording, so that they can be checked and run from there, and lists what the run reads.
fn write_experiment(folder: &RunFolder, kept: &[(String, String)], read: &[PathBuf]) -> Result<(), CliError> {
    let before = |stop| CliError { exit: ExitCode::Usage, ..stop };
    // Of a run that comes to its end it says more.
    let reads = json!({ "reads": environment::reads(read) });
    folder.write(ENVIRONMENT, &format!("{reads:#}\n")).map_err(before)?;
    for (name, text) in kept {
        if let Some(inner) = Path::new(name).parent().filter(|inner| !inner.as_os_str().is_empty()) {
            let inner = folder.partial.join(inner);
            depthloom_durable::create_folder(&inner).map_err(|error| {
                CliError::of_writing(ExitCode::Usage, format_args!("failed to create {}", inner.display()), &error)
            })?;
        }
        folder.write(name, text).map_err(before)?;
    }
    Ok(())
}

fn options(args: &RunArgs, folder: &RunFolder) -> Options {
    let default = Options::default();
    Options {
        workers: args.workers.map_or(default.workers, usize::from),
        window: args.window.map(usize::from),
        keep_going: args.keep_going,
        checkpoints: Some(folder.checkpoints()),
        audit: args.audit.into(),
    }
}

/// A run that ended early.
struct EarlyEnd {
    why: CliError,
    /// How many frames were written.
    frames: u64,
    /// Whether frames that were written may hold wrong values.
    is_suspect: bool,
}

impl EarlyEnd {
    /// Adds what was kept and how to resume. The folder of a run that wrote no frame is removed.
    fn stop(self, folder: RunFolder, is_remote: bool) -> CliError {
        let mut stop = self.why;
        let (partial, checkpoints) = (folder.partial.clone(), folder.checkpoints());
        let frames = self.frames;
        if self.is_suspect && folder.goes_on {
            let partial = partial.display();
            return stop.also(format!("{partial} holds values that may be wrong: replace it with --fresh --overwrite"));
        }
        if self.is_suspect {
            folder.discard();
            return stop.also("nothing of this run was kept");
        }
        if frames == 0 && folder.file(OUTDATED).exists() {
            let partial = partial.display();
            return stop.also(format!(
                "no frame was recorded; {partial} keeps the frames of the interrupted run, and the same command with the same --out reuses them"
            ));
        }
        if frames == 0 {
            folder.discard();
            stop = stop.also("no frame was recorded");
        } else {
            let count = counted(frames, "frame");
            let (at, report) = (partial.display(), partial.display());
            stop = stop.also(format!("{count} can be read from {at}: `depthloom report {report}`"));
            let printed = partial.join(PRINTED);
            if printed.is_file() {
                stop = stop.also(format!("what programs printed is in {}", printed.display()));
            }
        }
        let is_put_down = std::fs::read_dir(&checkpoints).is_ok_and(|mut files| files.next().is_some());
        let resumes = if frames == 0 { "" } else { "behind these frames, " };
        if stop.exit == ExitCode::Interrupted && is_put_down {
            let checkpoints = checkpoints.display();
            stop = stop.also(format!(
                "run the same again, with the same --out, to go on: {resumes}learning from {checkpoints}"
            ));
        } else if stop.exit != ExitCode::Usage && frames > 0 {
            let fixed = if stop.exit == ExitCode::FrameFailures { "once the cause is fixed, " } else { "" };
            stop = stop.also(if is_remote {
                format!(
                    "{fixed}`depthloom run` of the same experiment, with the same --out, goes on behind these frames"
                )
            } else {
                format!("{fixed}run the same again, with the same --out, to go on behind these frames")
            });
        }
        stop
    }
}

/// Values that need not be computed.
struct Reusable {
    /// The recording of an interrupted process of the same run, which resumes after it.
    begun: Option<Arc<Recording>>,
    earlier: EarlierRuns,
}

impl Reusable {
    /// Sets the recording of an interrupted process aside if this run would record something else: its data, programs or engines changed.
    fn verified(self, args: &RunArgs, folder: &RunFolder, ready: &Ready, is_remote: bool) -> Result<Self, CliError> {
        let Self { begun: Some(recording), earlier } = self else { return Ok(self) };
        let outdated = if is_remote {
            Some("dora computes all values again".to_owned())
        } else {
            reuse::outdated(ready, &earlier, &recording)?
        };
        let Some(why) = outdated else { return Ok(Self { begun: Some(recording), earlier }) };
        drop((recording, earlier));
        let partial = folder.partial.display();
        tell(
            args,
            &[format!(
                "not resuming after the frames that {partial} holds, since {why}: what is still right is reused"
            )],
        );
        let (recording, aside) = (folder.file(RECORDING), folder.file(OUTDATED));
        depthloom_durable::rename(&recording, &aside).map_err(|error| {
            CliError::of_writing(ExitCode::Engine, format_args!("failed to rename {}", recording.display()), &error)
        })?;
        Ok(Self { begun: None, earlier: reuse::earlier_runs(args.is_fresh(), folder, &ready.plan) })
    }
}

/// A complete recording.
struct Recorded<'a> {
    /// How many values were reused, and of which runs.
    reused: Reused,
    /// How many frames failed.
    failed: u64,
    /// The warnings of the run.
    warnings: Vec<String>,
    /// What is removed once the run is complete.
    checkpoints: Checkpoints,
    /// What the report need not read from the recording.
    prepared: Prepared<'a>,
    /// Whether programs wrote to standard error.
    has_printed: bool,
}

/// The file in the run's folder for what programs wrote to standard error.
const PRINTED: &str = "programs.log";

/// Writes what programs printed; returns whether there is any, and warnings about programs that failed after their last reply.
fn write_printed(folder: &RunFolder) -> Result<(bool, Vec<String>), CliError> {
    let ended = process::take_ended();
    let text = process::printed_text(&ended);
    if !text.is_empty() {
        folder.write(PRINTED, &text)?;
    }
    let failed =
        ended.iter().filter_map(|program| Some(format!("`{}` {}", program.command, program.failure.as_ref()?)));
    Ok((!text.is_empty(), failed.chain(process::take_import_warnings()).collect()))
}

/// Runs the frames, closes the recording, and prints the warnings.
#[expect(clippy::too_many_arguments, reason = "each is another thing, and they meet here alone")]
fn record<'a>(
    ready: Ready,
    plan: &Plan,
    args: &RunArgs,
    options: &Options,
    (folder, partial): (&RunFolder, &'a Path),
    begun: Reusable,
    interrupt: &Interrupt,
    stopped: &'a (dyn Fn() -> bool + Sync),
    remote: Option<&RemoteNodes<'_>>,
) -> Result<Recorded<'a>, EarlyEnd> {
    let Reusable { begun, earlier } = begun;
    let earlier = Arc::new(earlier);
    let recorder = match &begun {
        Some(begun) => Recorder::resume(begun, plan),
        None => Recorder::create(folder.file(RECORDING), plan),
    };
    let recorder = recorder.map_err(|error| EarlyEnd {
        why: CliError::remedied(ExitCode::Engine, "failed to start the recording", &error),
        // What an earlier process wrote stays.
        frames: begun.as_ref().map_or(0, |begun| reuse::frames(begun)),
        is_suspect: false,
    })?;
    // Values of remote nodes are not looked up in earlier runs: their keys come with them.
    let recorder = if remote.is_none() { recorder.with_earlier(Arc::clone(&earlier)) } else { recorder };
    let recorder = recorder.durable(args.durable);
    if begun.is_some() && !is_silent(args) {
        let (frames, partial) = (counted(recorder.frames(), "frame"), folder.partial.display());
        say(format_args!("resuming {partial} after {frames}"));
    }
    if let Some(Condition::Damaged { offset, what, .. }) = begun.as_ref().map(|begun| begun.condition()) {
        let partial = folder.partial.display();
        tell(args, &[format!("made afresh what {partial} held behind byte {offset}: {what}")]);
    }
    let progress = Progress::new(plan, is_silent(args));
    // What is wrong with the scores the report says when the frames are safe.
    let sampling = SamplingTap::new(&recorder, plan, partial, &report_options(args), stopped).ok();
    let watch = Both(&progress, remote.map_or(&Unwatched, |remote| remote.observer));
    let ran = match &sampling {
        Some(sampling) => depthloom_runner::run(ready, sampling, options, &watch, interrupt),
        None => depthloom_runner::run(ready, &recorder, options, &watch, interrupt),
    };
    let printed = write_printed(folder);
    let sampled = sampling.and_then(SamplingTap::finish);
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
    tell(args, &warnings);
    write_timings(&ran.timings, plan, &recorder, &folder.file(TIMINGS)).map_err(ended)?;
    if ran.interrupted {
        return Err(ended(CliError::new(ExitCode::Interrupted, "interrupted")));
    }
    let failed = ran.stages.iter().map(|stage| stage.failed).sum();
    let reused = reuse::reuse_counts(&ran, plan, &earlier);
    if let (Some(text), false) = (reused.text(), is_silent(args)) {
        say(text);
    }
    let prepared = Prepared { sampled, reports: reuse::reports(&earlier, options.audit) };
    Ok(Recorded { failed, warnings, checkpoints: ran.checkpoints, reused: reused.output(), prepared, has_printed })
}

/// Two observers of a run.
struct Both<'a>(&'a dyn Observer, &'a dyn Observer);

impl Observer for Both<'_> {
    fn stage_started(&self, run: RunId, frames: u64) {
        self.0.stage_started(run, frames);
        self.1.stage_started(run, frames);
    }

    fn frame_retired(&self, run: RunId, frame: &Frame, failures: &[Failure]) {
        self.0.frame_retired(run, frame, failures);
        self.1.frame_retired(run, frame, failures);
    }

    fn progress(&self, run: RunId, node: NodeId, done: u64, total: u64, message: &str) {
        self.0.progress(run, node, done, total, message);
        self.1.progress(run, node, done, total, message);
    }

    fn warned(&self, run: RunId, node: Option<NodeId>, what: &str) {
        self.0.warned(run, node, what);
        self.1.warned(run, node, what);
    }

    fn info(&self, run: RunId, node: NodeId, what: &str) {
        self.0.info(run, node, what);
        self.1.info(run, node, what);
    }

    fn stage_finished(&self, run: RunId) {
        self.0.stage_finished(run);
        self.1.stage_finished(run);
    }
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
fn tell(args: &RunArgs, warnings: &[String]) {
    if !args.output.json {
        warnings.iter().for_each(|warning| diagnostics::print_warning(warning));
    }
}

/// The results of a run whose folder is complete.
struct Finished {
    report: Summary,
    environment: Environment,
    /// Of its plan.
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
    let recording = Recording::open(folder.file(RECORDING))
        .map_err(|error| CliError::remedied(ExitCode::Engine, "failed to read the recording back", &error))?;
    models::write(&recording, &folder.partial)?;
    let report = analyse(&recording, &folder.partial, &report_options(args), prepared, interrupt)?;
    if args.samples {
        samples::write(&recording, &folder.file(SAMPLES), is_silent(args), interrupt)?;
    }
    let mut environment = environment();
    folder.write(ENVIRONMENT, &environment.text())?;
    if !args.page.no_page {
        page::write(
            &recording,
            &folder.partial,
            &report,
            &page::surroundings(&folder.partial),
            is_silent(args),
            interrupt,
        )?;
        // The page's time and memory are the run's, too.
        environment.measure_again();
        folder.write(ENVIRONMENT, &environment.text())?;
    }
    let (frames, failures) = frames_and_failures(&recording);
    Ok(Finished { report, environment, key: plan_key(recording.plan()).to_string(), frames, failures })
}

/// Prints the results.
fn show(args: &RunArgs, report: &Summary, output: impl FnOnce() -> Run, out: &Path) -> Result<(), CliError> {
    if args.output.json {
        return output::print(&output());
    }
    if !args.quiet {
        print(summary(report, out))?;
    }
    print_path("run: ", out)
}
