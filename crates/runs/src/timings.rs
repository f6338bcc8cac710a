//! The timings of a run, beside its recording.

use std::path::Path;

use depthloom_analysis::{RowKeys, TimingLatency, plan_key};
use depthloom_graphs::plan::Plan;
use depthloom_recording::{RecordedPlan, Recorder};
use depthloom_runner::Phase;
use depthloom_terminal::{CliError, ExitCode};

/// Writes a run's timings beside its recording.
///
/// # Errors
/// If the file cannot be written.
pub fn write_timings(
    report: &depthloom_runner::Report,
    plan: &Plan,
    recorder: &Recorder,
    path: &Path,
) -> Result<(), CliError> {
    let failed = |what: String| CliError::new(ExitCode::Engine, format!("failed to write the timings: {what}"));
    let recorded = RecordedPlan::read_back(plan).map_err(failed)?;
    let row_keys = RowKeys::new(&recorded);
    let rows: Vec<depthloom_analysis::Timing> =
        report.timings.iter().flat_map(|timing| rows(timing, report, plan, &row_keys, recorder)).collect();
    depthloom_analysis::write_timings(&rows, &plan_key(&recorded), path)
        .map_err(|error| CliError::from_error(ExitCode::Engine, &error))
}

/// The rows of a timing: one, or two if compression is a part of encoding.
fn rows(
    timing: &depthloom_runner::Timing,
    report: &depthloom_runner::Report,
    plan: &Plan,
    row_keys: &RowKeys<'_>,
    recorder: &Recorder,
) -> Vec<depthloom_analysis::Timing> {
    let run = &plan.runs[timing.run];
    let variants = match timing.phase {
        Phase::Once(node) | Phase::Node(node) => &run.nodes[node].variants,
        Phase::Source | Phase::Write | Phase::Encode(_) => &run.variants,
    };
    let live = report.live.as_ref().filter(|live| live.run == timing.run);
    let step = live.and_then(|live| live.steps.iter().find(|step| step.phase == timing.phase));
    let latency = step.map(|step| {
        let depthloom_runner::Latency { p50_ns, p95_ns, p99_ns, max_ns, jitter_ns, .. } = step.latency;
        TimingLatency { p50_ns, p95_ns, p99_ns, max_ns, jitter_ns }
    });
    let row =
        |node: String, phase: &str, cpu_ns: u64, wall_ns: u64, median_cpu_ns: Option<u64>| depthloom_analysis::Timing {
            row_key: row_keys.for_variants(&run.stage, variants),
            node,
            phase: phase.to_owned(),
            frames: timing.count,
            cpu_ns,
            wall_ns,
            median_cpu_ns,
            latency,
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
