//! What jobs request from the scheduler: time and memory, from the measurements of an earlier run.

use std::collections::HashSet;
use std::path::Path;

use depthloom_graphs::Key;
use depthloom_graphs::contracts::Contract;
use depthloom_graphs::plan::{Plan, RunId};
use depthloom_jobs::slurm::JobRequest;
use depthloom_jobs::{Shard, Step};
use depthloom_terminal::CliError;

use crate::commands::experiments::cost::{Costs, NodeCosts, StageCosts, measured};
use crate::output::diagnostics::print_warning;

/// Machines of a cluster differ, and neighbours disturb: this many times the measured time is requested.
const TIME_FACTOR: f64 = 3.0;
/// Every job opens sources and reads the index of earlier results: seconds.
const START_S: f64 = 120.0;
/// The bandwidth of the last run, which mostly copies: bytes per second.
const COPIED_PER_S: f64 = 50e6;
/// The shortest time that is requested, seconds.
const SHORTEST_S: f64 = 600.0;
const MEMORY_FACTOR: f64 = 1.5;
/// The least memory that is requested, MB.
const LEAST_MB: f64 = 1024.0;

/// The requests of every step, from the measurements in the folder of a run.
///
/// # Errors
/// If the run has no measurements.
pub(super) fn requests(
    run: &Path,
    plan: &Plan,
    frames: &[usize],
    steps: &[Step],
    workers: u16,
) -> Result<Vec<JobRequest>, CliError> {
    let costs = measured(run)?;
    if !costs.stages.iter().flat_map(|stage| &stage.nodes).any(NodeCosts::is_measured) {
        let what = format!("--from {}: it reused all its values, so nothing was measured", run.display());
        return Err(CliError::usage(
            what,
            "name a run that computed its values, e.g. one with `run --fresh` of a few frames",
        ));
    }
    let known: HashSet<Key> = costs.plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.node_hash).collect();
    for run in &plan.runs {
        let mut trainings = run.nodes.iter().filter(|node| node.contract == Contract::Once);
        if let Some(node) = trainings.find(|node| !known.contains(&node.node_hash)) {
            let (name, from) = (format!("{}.{}", run.stage, node.name), costs.folder.display());
            print_warning(&format!(
                "`{name}` differs from that of {from}: the time for it is that of the measured one; `-- --time=...` sets another"
            ));
        }
    }
    let request = |step: &Step| request(&costs, plan, frames, step, f64::from(workers));
    Ok(steps.iter().map(request).collect())
}

fn request(costs: &Costs, plan: &Plan, frames: &[usize], step: &Step, workers: f64) -> JobRequest {
    let stages = |run: RunId| {
        let same =
            costs.plan.runs.iter().zip(&costs.stages).filter(move |(of_run, _)| of_run.stage == plan.runs[run].stage);
        same.map(|(_, stage)| stage)
    };
    let frames_s = |run: RunId| -> f64 {
        let slowest = stages(run).map(StageCosts::cpu_s_per_frame).fold(0.0, f64::max);
        slowest * frames.get(run.0).copied().unwrap_or_default() as f64
    };
    let aggregates_s = |run: RunId| stages(run).map(StageCosts::aggregate_cpu_s).fold(0.0, f64::max);
    let all = || RunId::all(plan.runs.len());
    let work_s = match step.shards.first() {
        Some(Shard::Frames { part, runs }) => {
            let own = all().filter(|run| runs.is_empty() || runs.contains(&run.0));
            own.map(frames_s).sum::<f64>() / part.count() as f64 / workers
        }
        Some(Shard::Variants { part }) => {
            let own: f64 = all().map(|run| frames_s(run) / workers + aggregates_s(run)).sum();
            // Nodes that all variants share run in every shard.
            own / (part.count() as f64).sqrt()
        }
        // Trainings use few cores well.
        Some(Shard::Nodes { .. }) => all().map(aggregates_s).sum(),
        None => {
            let bytes = |run: RunId| {
                let per_frame = stages(run).map(StageCosts::bytes_per_frame).fold(0.0, f64::max);
                per_frame * frames.get(run.0).copied().unwrap_or_default() as f64
            };
            let report = [costs.report, costs.page].into_iter().flatten().map(|work| work.cpu_s).sum::<f64>();
            let measured: u64 = costs.stages.iter().map(|stage| stage.frames).sum();
            let scale = frames.iter().sum::<usize>() as f64 / (measured.max(1) as f64);
            all().map(bytes).sum::<f64>() / COPIED_PER_S + report * scale.max(1.0)
        }
    };
    let time_s = (TIME_FACTOR * work_s + START_S).max(SHORTEST_S).ceil();
    let memory = costs.peak_resident_bytes.map(|bytes| (MEMORY_FACTOR * bytes as f64 / 1e6).max(LEAST_MB).ceil());
    JobRequest { minutes: Some((time_s / 60.0).ceil() as u64), memory_mb: memory.map(|memory| memory as u64) }
}
