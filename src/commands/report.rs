//! `depthloom report` and `depthloom timings`: what a run found, and where its time went.

use std::path::Path;

use depthloom_analysis::{
    AnalysisError, CurveEnd, Lead, Leads, PAGE, Prepared, RecordingCondition, ReportOptions, Resampling, SAMPLES,
    Summary, TableRow, plan_key, report_with,
};
use depthloom_graphs::plan::Plan;
use depthloom_recording::{RecordedPlan, Recorder, Recording};
use depthloom_runner::{Interrupt, Phase};
use depthloom_runs::{
    FOLDER, RECORDING, TIMINGS, models, named, partial_with, recording_of, remedy_of_partial, run_folder,
};
use depthloom_terminal::{Exit, Stop, print};
use schemars::JsonSchema;
use serde::Serialize;

use super::page;
use crate::args::{ReportArgs, TimingsArgs};
use crate::diagnostics::Error;
use crate::outputs::{self, CommandOutput, Output};
use crate::signals;

/// Of `report`: what was found.
#[derive(JsonSchema, Serialize)]
pub struct Report {
    experiment: String,
    recording: RecordingCondition,
    /// The rows of `table.csv`.
    table: Vec<TableRow>,
    /// Where each learning curve ended.
    learning_curves: Vec<CurveEnd>,
    notes: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

impl CommandOutput for Report {
    const OUTPUT: Output = Output::Report;
}

impl Report {
    /// What the analysis found, and why the command did not do all it was asked to.
    pub fn of(summary: &Summary, error: Option<Error>) -> Self {
        Self {
            experiment: summary.experiment.clone(),
            recording: summary.recording.clone(),
            table: summary.rows.clone(),
            learning_curves: summary.curve_ends.clone(),
            notes: summary.notes.clone(),
            error,
        }
    }
}

/// Of `timings`: where a run's time went.
#[derive(JsonSchema, Serialize)]
pub struct Timings {
    timings: Vec<Timing>,
}

impl CommandOutput for Timings {
    const OUTPUT: Output = Output::Timings;
}

/// What a part of a run cost.
#[derive(JsonSchema, Serialize)]
pub struct Timing {
    stage: String,
    /// Null where all variants share the node; of several, the first.
    variant: Option<String>,
    node: String,
    /// `read`, `process`, `once`, `encode`, `compress` or `write`.
    phase: String,
    frames: u64,
    cpu_ns: u64,
    wall_ns: u64,
    median_cpu_ns: Option<u64>,
}

/// Makes tables, plots and models again, from the recording alone.
pub fn report(args: &ReportArgs) -> Result<Exit, Stop> {
    let path = recording_of(&args.run, "report")?;
    let out = match &args.out {
        Some(out) => out.clone(),
        None => path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned(),
    };
    if let Some(run) = run_folder::around(&out) {
        // Its own folder is where a report belongs.
        let of_recording = std::fs::canonicalize(&path).ok().and_then(|path| path.parent().map(Path::to_owned));
        let is_its_own = [of_recording, std::fs::canonicalize(&out).ok()].iter().all(|of| of.as_ref() == Some(&run));
        if !is_its_own {
            let what = format!("{} is a run's folder, and holds what the run wrote and nothing else", run.display());
            return Err(Stop::new(Exit::Before, what).remedy("choose another --out"));
        }
    } else if let Some(name) = run_folder::in_the_way_of_a_report(&out) {
        let what = format!("{} exists already, and no report wrote it", out.join(name).display());
        return Err(Stop::new(Exit::Before, what).remedy("choose another --out, or move it away"));
    }
    let interrupt = signals::listen("stopping: what is not written yet stays as it was")?;
    std::fs::create_dir_all(&out)
        .map_err(|error| Stop::of_writing(Exit::Before, format_args!("failed to create {}", out.display()), &error))?;
    let lock = run_folder::lock_if_run(&out)?;
    let recording =
        Recording::open(&path).map_err(|error| Stop::remedied(Exit::Before, "failed to read the recording", &error))?;
    if lock.is_none() {
        depthloom_durable::remove_abandoned(&out);
        run_folder::mark_for_reports(&out).map_err(|error| {
            Stop::of_writing(Exit::Before, format_args!("failed to write to {}", out.display()), &error)
        })?;
    }
    let intervals = args.ci.map(|confidence| Resampling { confidence, ..Resampling::default() });
    let options = ReportOptions { paper: args.paper, intervals, check_every_byte: true, ..ReportOptions::default() };
    let report = analyse(&recording, &out, &options, Prepared::default(), &interrupt)?;
    let but_whole = |stop: Stop| stop.also(format!("tables and plots are whole in {}", out.display()));
    models::write(&recording, &out).map_err(but_whole)?;
    if !args.page.no_page {
        let of_run = path.parent().unwrap_or(Path::new("."));
        page::write(&recording, &out, &report, &page::surroundings(of_run), args.json, &interrupt)
            .map_err(but_whole)?;
    }
    // An unfinished recording is what was asked for; a damaged one is not what was written.
    let faulty = report.is_damaged.then(|| Stop::new(Exit::Frames, "the recording is damaged"));
    let faulty = faulty.or_else(|| no_pixel_counted(&report));
    let printed = if args.json {
        outputs::print(&Report::of(&report, faulty.as_ref().map(Error::from)))
    } else {
        print(summary(&report, &out))
    };
    printed.map_err(but_whole)?;
    if args.page.open {
        page::open(&out);
    }
    Ok(faulty.map_or(Exit::Whole, |stop| stop.exit))
}

/// What is to be said where frames were scored and not one pixel of them counted: such a run has no answer.
pub fn no_pixel_counted(report: &Summary) -> Option<Stop> {
    report.no_pixel_counted.then(|| Stop::new(Exit::Frames, "not one pixel was scored"))
}

/// Analyses a recording until it is done or asked to stop. What is prepared is not computed again.
pub fn analyse(
    recording: &Recording,
    folder: &Path,
    options: &ReportOptions,
    prepared: Prepared<'_>,
    interrupt: &Interrupt,
) -> Result<Summary, Stop> {
    let interrupted = || Stop::new(Exit::Interrupted, "interrupted while analysing");
    if interrupt.stops_admission() {
        return Err(interrupted());
    }
    let report = report_with(recording, folder, options, prepared, &|| interrupt.stops_admission());
    report.map_err(|error| match error {
        AnalysisError::Stopped => interrupted(),
        error => {
            let exit = if error.is_damage() { Exit::Frames } else { Exit::Engine };
            Stop::remedied(exit, "failed to analyse the recording", &error)
        }
    })
}

/// The table, and where the rest is.
pub fn summary(report: &Summary, folder: &Path) -> String {
    let files = [
        (folder.join(RECORDING).is_file(), "what was recorded", "recording.mcap (for Rerun and Foxglove, too)"),
        (report.scored, "scores per frame", "scores.{csv,parquet}"),
        (report.table, "this table", "table.{csv,md,tex,parquet}"),
        (report.distances, "error against distance", "error_vs_distance.{csv,parquet,svg}"),
        (folder.join(SAMPLES).is_file(), "a row a scored pixel", "samples.parquet (`depthloom analyse` asks it)"),
        (report.learning_curves > 0, "learning curves", "learning_curves.{csv,parquet,svg}"),
        (folder.join(PAGE).is_file(), "all of it on one page", "report.html (`depthloom report RUN --open`)"),
        (folder.join(models::FOLDER).is_dir(), "learnt models", "models/<stage>.<node>.onnx"),
    ];
    let there = files.iter().filter(|(is_there, ..)| *is_there);
    let list: String = there.map(|(_, what, file)| format!("  {what:24}{file}\n")).collect();
    if list.is_empty() { report.text.clone() } else { format!("{}\nin {}:\n{list}", report.text, folder.display()) }
}

/// Prints core-milliseconds per frame by node, encoding, compression and writing.
pub fn timings(args: &TimingsArgs) -> Result<Exit, Stop> {
    let run = named(&args.run, Path::new(FOLDER))?;
    let path = run.join(TIMINGS);
    let failed = |error: AnalysisError| {
        let stop = Stop::because(Exit::Before, "failed to show the timings", &error);
        match partial_with(&run, TIMINGS).filter(|_| !run.exists()) {
            Some(partial) => stop.remedy(remedy_of_partial(&partial, "timings")),
            None => stop.remedy("name the folder of a run"),
        }
    };
    if args.json {
        let timings = depthloom_analysis::read_timings(&path).map_err(failed)?;
        outputs::print(&Timings { timings: timings.into_iter().map(Timing::of).collect() })?;
    } else {
        print(depthloom_analysis::timings_table(&path).map_err(failed)?)?;
    }
    Ok(Exit::Whole)
}

impl Timing {
    /// A timing under the names of the columns of `timings.parquet`.
    fn of(timing: depthloom_analysis::Timing) -> Self {
        let depthloom_analysis::Timing { lead, node, phase, frames, cpu_ns, wall_ns, median_cpu_ns } = timing;
        let Lead { stage, variant, .. } = lead;
        Self { stage, variant, node, phase, frames, cpu_ns, wall_ns, median_cpu_ns }
    }
}

/// Writes a run's timings beside its recording.
pub fn write_timings(
    timings: &[depthloom_runner::Timing],
    plan: &Plan,
    recorder: &Recorder,
    path: &Path,
) -> Result<(), Stop> {
    let failed = |what: String| Stop::new(Exit::Engine, format!("failed to keep the timings: {what}"));
    let recorded = RecordedPlan::read_back(plan).map_err(failed)?;
    let leads = Leads::new(&recorded);
    let rows: Vec<depthloom_analysis::Timing> =
        timings.iter().flat_map(|timing| rows(timing, plan, &leads, recorder)).collect();
    depthloom_analysis::write_timings(&rows, &plan_key(&recorded), path)
        .map_err(|error| Stop::remedied(Exit::Engine, "failed to keep the timings", &error))
}

/// A timing's rows: one, or two where compression is a share of encoding.
fn rows(
    timing: &depthloom_runner::Timing,
    plan: &Plan,
    leads: &Leads<'_>,
    recorder: &Recorder,
) -> Vec<depthloom_analysis::Timing> {
    let run = &plan.runs[timing.run];
    let variants = match timing.phase {
        Phase::Once(node) | Phase::Node(node) => &run.nodes[node].variants,
        Phase::Source | Phase::Write | Phase::Encode(_) => &run.variants,
    };
    let row =
        |node: String, phase: &str, cpu_ns: u64, wall_ns: u64, median_cpu_ns: Option<u64>| depthloom_analysis::Timing {
            lead: leads.of_those(&run.stage, variants),
            node,
            phase: phase.to_owned(),
            frames: timing.count,
            cpu_ns,
            wall_ns,
            median_cpu_ns,
        };
    let whole =
        |node: String, phase: &str| row(node, phase, timing.cpu.sum_ns, timing.wall.sum_ns, timing.median_cpu_ns());
    match timing.phase {
        Phase::Source => vec![whole(timing.label.clone(), "read")],
        Phase::Write => vec![whole("recording".to_owned(), "write")],
        Phase::Once(node) => vec![whole(run.nodes[node].name.clone(), "once")],
        Phase::Node(node) => vec![whole(run.nodes[node].name.clone(), "process")],
        Phase::Encode(part) => {
            let compression = recorder.compression(timing.run)[part];
            let node = format!("recording of {}", compression.class);
            let encode_ns = timing.cpu.sum_ns.saturating_sub(compression.cpu_ns);
            vec![
                row(node.clone(), "encode", encode_ns, timing.wall.sum_ns, None),
                row(node, "compress", compression.cpu_ns, 0, None),
            ]
        }
    }
}
