//! `depthloom run`: from an experiment file to a recording, a table and plots.

use std::path::{Path, PathBuf};
use std::time::Instant;

use depthloom_analysis::{ReportOptions, report};
use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::{NotReady, Ready};
use depthloom_recording::{Recorder, Recording};
use depthloom_runner::{Interrupt, Options, RunError};
use serde_json::json;

use super::check::load;
use super::report::summary;
use super::{print, print_json};
use crate::args::RunArgs;
use crate::diagnostics;
use crate::environment;
use crate::exit::{Exit, Stop, chain};
use crate::progress::Progress;
use crate::run_folder::RunFolder;

/// Loads, plans, opens, runs, records, scores and prints.
pub fn run(args: &RunArgs) -> Result<Exit, Stop> {
    let silent = args.quiet || args.json;
    let Some(plan) = load(&args.experiment, silent)? else { return Ok(Exit::Before) };
    let out =
        args.out.clone().unwrap_or_else(|| Path::new("runs").join(&plan.experiment).join(environment::utc_stamp()));
    let ready = match Ready::new(plan, &crate::registry::registry()) {
        Ok(ready) => ready,
        Err(missing) => return Ok(print_missing(&missing)),
    };
    let plan = ready.plan.clone();
    let folder = RunFolder::create(&out, args.overwrite)?;
    let started = Instant::now();

    let default = Options::default();
    let options = Options {
        workers: args.workers.map_or(default.workers, usize::from),
        window: args.window.map(usize::from),
        keep_going: args.keep_going,
        checkpoints: Some(folder.out.with_file_name("checkpoints")),
    };
    let interrupt = on_ctrl_c()?;
    let recorder = Recorder::create(folder.file("recording.mcap"), &plan)
        .map_err(|error| Stop::because(Exit::Engine, "failed to start the recording", &error))?;
    let progress = Progress::new(&plan, silent);
    let ran = depthloom_runner::run(ready, &recorder, &options, &progress, &interrupt);
    // Whatever happened, what was recorded is closed properly: a run that failed keeps the frames before the failure.
    let finished =
        recorder.finish(&[]).map_err(|error| Stop::because(Exit::Engine, "failed to close the recording", &error));
    write_experiment(&folder, &plan)?;
    let ran = match ran {
        Ok(ran) => ran,
        Err(error) => return Err(stop_of(&error, &folder)),
    };
    finished?;

    super::report::write_timings(&ran.timings, &plan, &recorder, &folder.file("timings.parquet"))?;
    if ran.interrupted {
        return Err(Stop::new(Exit::Interrupted, "interrupted")
            .remedy(format!("the frames done so far are in {}", folder.partial.display())));
    }
    let failed: u64 = ran.stages.iter().map(|stage| stage.failed).sum();
    // What the run needed is given back before the analysis begins.
    drop((ran, recorder, progress));
    let recording = Recording::open(folder.file("recording.mcap"))
        .map_err(|error| Stop::because(Exit::Engine, "failed to read the recording back", &error))?;
    let report = report(&recording, &folder.partial, &ReportOptions { paper: args.paper })
        .map_err(|error| Stop::because(Exit::Engine, "failed to analyse the recording", &error))?;
    let environment = environment::describe(options.workers, options.window, started.elapsed().as_secs_f64());
    folder.write("environment.json", &format!("{environment:#}\n"))?;
    let out = folder.finish()?;

    if args.json {
        let mut object =
            json!({ "experiment": plan.experiment, "run": out, "failed_frames": failed, "environment": environment });
        object["report"] = report.json;
        print_json(&object)?;
    } else if args.quiet {
        print(&format!("run: {}\n", out.display()))?;
    } else {
        print(&summary(&report, &out))?;
        print(&format!("run: {}\n", out.display()))?;
    }
    if failed > 0 {
        eprintln!("{failed} frames failed; what depended on them is left out");
        return Ok(Exit::Frames);
    }
    Ok(Exit::Whole)
}

/// The first Ctrl-C stops admission, the second aborts; the third ends the process, should all else hang.
fn on_ctrl_c() -> Result<Interrupt, Stop> {
    let interrupt = Interrupt::default();
    let raised = interrupt.clone();
    ctrlc::set_handler(move || {
        if raised.aborts() {
            std::process::exit(Exit::Interrupted as i32);
        }
        match raised.raise() {
            1 => eprintln!("stopping: the frames in flight are finished; again to abort"),
            _ => eprintln!("aborting"),
        }
    })
    .map_err(|error| Stop::because(Exit::Engine, "failed to listen for Ctrl-C", &error))?;
    Ok(interrupt)
}

fn print_missing(missing: &[NotReady]) -> Exit {
    for error in missing {
        diagnostics::print_stop(&chain(error), error.fault().remedy_text());
    }
    Exit::Before
}

fn stop_of(error: &RunError, folder: &RunFolder) -> Stop {
    let exit = match error {
        RunError::Aborted => Exit::Interrupted,
        error if error.is_of_a_frame() => Exit::Frames,
        _ => Exit::Engine,
    };
    let kept = format!("the frames before are in {}", folder.partial.display());
    let remedy = match error.remedy() {
        Some(remedy) => format!("{remedy}; {kept}"),
        None => kept,
    };
    Stop::new(exit, chain(error)).remedy(remedy)
}

/// Keeps the experiment as written and as resolved beside the recording.
fn write_experiment(folder: &RunFolder, plan: &Plan) -> Result<(), Stop> {
    if let Some((_, text)) = plan.written.first() {
        folder.write("experiment.yaml", text)?;
    }
    folder.write("experiment.resolved.yaml", &plan.resolved)
}

/// The recording of a run's folder, or the recording itself.
pub fn recording_of(run: &Path) -> PathBuf {
    if run.is_dir() { run.join("recording.mcap") } else { run.to_owned() }
}
