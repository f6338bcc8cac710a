//! `depthloom runs timings`: where a run spent its time.

use depthloom_analysis::{AnalysisError, RowKey, TimingLatency};
use depthloom_runs::{TIMINGS, named, partial_with, remedy_of_partial};
use depthloom_terminal::{CliError, ExitCode, print};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{RunsArgs, TimingsArgs};
use crate::output;

/// Output of `runs timings`: where a run spent its time.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Timings {
    timings: Vec<Timing>,
}

/// The cost of a part of a run.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Timing {
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
    /// From the capture of a frame until this part had finished it; null unless the run was live.
    latency: Option<Latency>,
}

/// Percentiles of a latency over frames, nanoseconds.
#[derive(JsonSchema, Serialize)]
struct Latency {
    p50_ns: u64,
    p95_ns: u64,
    p99_ns: u64,
    max_ns: u64,
    /// The mean absolute difference between successive frames.
    jitter_ns: u64,
}

/// Prints core-milliseconds per frame by node, encoding, compression and writing.
pub(super) fn timings(args: &RunsArgs, command: &TimingsArgs) -> Result<ExitCode, CliError> {
    let run = named(&command.run, &args.folder.path())?;
    let path = run.join(TIMINGS);
    let failed = |error: AnalysisError| {
        let stop = CliError::because(ExitCode::Usage, "failed to show the timings", &error);
        match partial_with(&run, TIMINGS).filter(|_| !run.exists()) {
            Some(partial) => stop.remedy(remedy_of_partial(&partial, "runs timings")),
            None => stop.remedy("name the folder of a run, or a run that `depthloom runs` lists"),
        }
    };
    if args.json {
        let timings = depthloom_analysis::read_timings(&path).map_err(failed)?;
        output::print(&Timings { timings: timings.into_iter().map(Timing::new).collect() })?;
    } else {
        print(depthloom_analysis::timings_table(&path).map_err(failed)?)?;
    }
    Ok(ExitCode::Success)
}

impl Timing {
    /// A timing under the names of the columns of `timings.parquet`.
    fn new(timing: depthloom_analysis::Timing) -> Self {
        let depthloom_analysis::Timing { row_key, node, phase, frames, cpu_ns, wall_ns, median_cpu_ns, latency } =
            timing;
        let RowKey { stage, variant, .. } = row_key;
        let latency = latency.map(|latency| {
            let TimingLatency { p50_ns, p95_ns, p99_ns, max_ns, jitter_ns } = latency;
            Latency { p50_ns, p95_ns, p99_ns, max_ns, jitter_ns }
        });
        Self { stage, variant, node, phase, frames, cpu_ns, wall_ns, median_cpu_ns, latency }
    }
}
