//! `depthloom report` and `depthloom timings`: what a run found, and where its time went.

use std::path::Path;

use depthloom_analysis::{ReportOptions, Summary, Timing};
use depthloom_graphs::plan::Plan;
use depthloom_recording::{Recorder, Recording};
use depthloom_runner::Phase;

use super::run::recording_of;
use super::{print, print_json};
use crate::args::{ReportArgs, TimingsArgs};
use crate::exit::{Exit, Stop};

/// Makes tables and plots again, from the recording alone.
pub fn report(args: &ReportArgs) -> Result<Exit, Stop> {
    let path = recording_of(&args.run);
    let recording = Recording::open(&path)
        .map_err(|error| Stop::because(Exit::Before, format_args!("failed to open {}", path.display()), &error))?;
    let out = match &args.out {
        Some(out) => out.clone(),
        None => path.parent().unwrap_or(Path::new(".")).to_owned(),
    };
    std::fs::create_dir_all(&out)
        .map_err(|error| Stop::because(Exit::Before, format_args!("failed to create {}", out.display()), &error))?;
    let report = depthloom_analysis::report(&recording, &out, &ReportOptions { paper: args.paper })
        .map_err(|error| Stop::because(Exit::Engine, "failed to analyse the recording", &error))?;
    if args.json {
        print_json(&report.json)?;
    } else {
        print(&summary(&report, &out))?;
    }
    Ok(Exit::Whole)
}

/// The table, and where the rest is.
pub fn summary(report: &Summary, folder: &Path) -> String {
    let recording = [("every intermediate", "recording.mcap (opens in Foxglove and Rerun)")];
    let scores = [
        ("scores per frame", "scores.csv"),
        ("this table", "table.{csv,md,tex,parquet}"),
        ("error against distance", "error_vs_distance.{csv,parquet,svg}"),
    ];
    let curves = [("learning curves", "learning_curves.{csv,parquet,svg}")];
    // A run that scores nothing has no table.
    let is_scored = folder.join("scores.csv").is_file();
    let scores = scores.iter().filter(|_| is_scored);
    let files = recording.iter().chain(scores).chain(curves.iter().filter(|_| report.learning_curves > 0));
    let list: String = files.map(|(what, file)| format!("  {what:24}{file}\n")).collect();
    format!("{}\nin {}:\n{list}", report.text, folder.display())
}

/// Prints core-milliseconds per frame by node, encoding, compression and writing.
pub fn timings(args: &TimingsArgs) -> Result<Exit, Stop> {
    let path = args.run.join("timings.parquet");
    let table = depthloom_analysis::timings_table(&path)
        .map_err(|error| Stop::because(Exit::Before, format_args!("failed to read {}", path.display()), &error))?;
    print(&table)?;
    Ok(Exit::Whole)
}

/// Writes a run's timings beside its recording.
pub fn write_timings(
    timings: &[depthloom_runner::Timing],
    plan: &Plan,
    recorder: &Recorder,
    path: &Path,
) -> Result<(), Stop> {
    let rows: Vec<Timing> = timings.iter().flat_map(|timing| rows(timing, plan, recorder)).collect();
    depthloom_analysis::write_timings(&rows, path)
        .map_err(|error| Stop::because(Exit::Engine, format_args!("failed to write {}", path.display()), &error))
}

/// A timing's rows: one, or two where compression is a share of encoding.
fn rows(timing: &depthloom_runner::Timing, plan: &Plan, recorder: &Recorder) -> Vec<Timing> {
    let run = &plan.runs[timing.run];
    let stage = run.prefix.trim_start_matches('/').to_owned();
    let row = |node: String, phase: &str, cpu_ns: u64, wall_ns: u64, median_cpu_ns: Option<u64>| Timing {
        stage: stage.clone(),
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
        Phase::Once(node) => vec![whole(name(plan, timing.run, node), "once")],
        Phase::Node(node) => vec![whole(name(plan, timing.run, node), "process")],
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

/// A node's name, with the first of its variants where it does not serve them all.
fn name(plan: &Plan, run: usize, node: usize) -> String {
    let node = &plan.runs[run].nodes[node];
    let of_stage = plan.runs[run].variants.len();
    match node.variants.first() {
        Some(&first) if node.variants.len() < of_stage => format!("{}/{}", plan.variants[first], node.name),
        _ => node.name.clone(),
    }
}
