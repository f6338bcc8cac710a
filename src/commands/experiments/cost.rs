//! `depthloom plan --cost`: what a run would cost, from the measurements of an earlier run.

mod matching;
mod measured;
mod page;
mod prediction;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use depthloom_graphs::language::Loaded;
use depthloom_graphs::plan::{Plan, RunId};
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{Registry, counted};
use depthloom_recording::{
    PlanDifference, RecordedNode, RecordedPlan, RecordedRun, RecordedSource, Recording, source_differences,
};
use depthloom_runner::Options;
use depthloom_runs::{FoundRun, RECORDING, all};
use depthloom_terminal::{CliError, ExitCode, aligned, print, size};
use schemars::JsonSchema;
use serde::Serialize;

pub(crate) use measured::{Costs, NodeCosts, StageCosts, measured};

use self::matching::{Matched, frames_of, is_read_by_another_stage, matched};
use self::measured::Timings;
use self::prediction::{Assumptions, FileSystemUse, Prediction, StepCost, WallLimit, predict};
use crate::allow_exec;
use crate::args::PlanArgs;
use crate::output;
use crate::output::diagnostics::print_warning;

/// The parameters of a source that select frames: they change no cost per frame.
const SELECTION: [&str; 2] = ["frames", "seed"];

/// Output of `plan --cost`: what a run would cost.
#[derive(JsonSchema, Serialize)]
pub(crate) struct PlanCost {
    /// The run whose measurements were used.
    from: String,
    /// The number of variants.
    variants: u64,
    workers: u64,
    /// The assumed bandwidth of the file system, MB (1,000,000 bytes) per second, for reading and writing together.
    bandwidth_mb_s: f64,
    cpu_s: f64,
    core_hours: f64,
    wall_s: f64,
    /// What limits most of the wall-clock time.
    wall_limit: WallLimit,
    /// The size of the files of sources, and of the files that nodes read frame by frame.
    read_bytes: u64,
    written_bytes: u64,
    /// Where most is read and written per second; null if no stage reads or writes.
    file_system: Option<FileSystemUse>,
    /// The most memory that the measured run used.
    peak_resident_bytes: Option<u64>,
    steps: Vec<StepCost>,
    /// The measurements, by stage of the measured run.
    measured: Vec<MeasuredStage>,
    /// The stages that keep their own frames with `--frames`, because other stages read them.
    own_frames: Vec<String>,
    /// Nodes and sources that differ from those of the measured run: with the cost of one of the same kind.
    by_kind: Vec<String>,
    /// Nodes and sources without a measurement: they are not included.
    not_included: Vec<String>,
    warnings: Vec<String>,
}

/// The measurements of a stage.
#[derive(JsonSchema, Serialize)]
pub(crate) struct MeasuredStage {
    stage: String,
    frames: u64,
    /// CPU seconds per frame, without aggregate nodes and without the report.
    cpu_s_per_frame: f64,
    /// Bytes per frame in the recording.
    bytes_per_frame: f64,
    /// CPU seconds of aggregate nodes, such as trainings.
    aggregate_cpu_s: f64,
}

/// Prints what a run of the experiment would cost.
pub(super) fn cost(args: &PlanArgs, loaded: Loaded, registry: &Registry) -> Result<ExitCode, CliError> {
    allow_exec::decide(args.exec, Some((&args.experiment.experiment, &loaded)))?;
    let ready = Ready::new(loaded.plan, registry).map_err(|missing| CliError::of_missing(&missing))?;
    let folder = args.folder.path();
    let run = match &args.from {
        Some(run) => {
            let recording = args.folder.recording(run, "plan EXPERIMENT --cost --from")?;
            recording.parent().map_or_else(|| PathBuf::from("."), Path::to_owned)
        }
        None => nearest(&ready.plan, &folder, &args.experiment.experiment)?,
    };
    let costs = measured(&run)?;
    let frames = frames_of(&ready, args.frames);
    let found = matched(&ready, &frames, &costs, !args.no_page);
    if !found.has_measurement {
        let what = format!("{} has no measurement of a node or source of this experiment", run.display());
        return Err(CliError::usage(what, remedy(&args.experiment.experiment)));
    }
    let planned_variants = ready.plan.variants.len() as u64;
    let variants = args.variant_count.unwrap_or(planned_variants);
    let assumptions = Assumptions {
        workers: args.workers.map_or(Options::default().workers as u64, u64::from),
        bandwidth: args.bandwidth as f64 * 1e6,
        variants: variants as f64 / planned_variants.max(1) as f64,
    };
    let prediction = predict(&found.steps, assumptions);
    let warnings = warnings(&ready.plan, &costs, &found);
    let output = output(args, &ready.plan, &costs, found, (variants, assumptions), prediction, warnings);
    if args.output.json {
        output::print(&output)?;
    } else {
        output.warnings.iter().for_each(|warning| print_warning(warning));
        print(text(&output))?;
    }
    Ok(ExitCode::Success)
}

fn remedy(experiment: &Path) -> String {
    format!("run a few frames of {}, or name a run that has measurements with --from", experiment.display())
}

/// The finished run in a folder with measurements of the most nodes of a plan; of several, one whose sources differ
/// least, and of these the newest.
fn nearest(plan: &Plan, folder: &Path, experiment: &Path) -> Result<PathBuf, CliError> {
    let recorded = RecordedPlan::from_plan(plan);
    let wanted: HashSet<_> = recorded.runs.iter().flat_map(|run| &run.nodes).map(|node| node.node_hash).collect();
    let mut best: Option<((usize, usize), PathBuf)> = None;
    for run in all(folder).unwrap_or_default().into_iter().rev().filter(FoundRun::has_finished) {
        let Ok(recording) = Recording::open(run.path.join(RECORDING)) else { continue };
        let before = recording.plan();
        let shared = before.runs.iter().flat_map(|stage| stage.nodes.iter().map(move |node| (stage, node)));
        let shared: Vec<_> = shared.filter(|(_, node)| wanted.contains(&node.node_hash)).collect();
        if shared.is_empty() {
            continue;
        }
        let Ok(timings) = Timings::read(&run.path) else { continue };
        let is_measured =
            |(stage, node): &&(&RecordedRun, &RecordedNode)| timings.node(before, &stage.stage, node).is_measured();
        let measured = shared.iter().filter(is_measured).count();
        let has_equal_source =
            |run: &&RecordedRun| recorded.runs.iter().any(|other| differences(&run.source, &other.source).is_empty());
        let rank = (measured, before.runs.iter().filter(has_equal_source).count());
        if measured > 0 && best.as_ref().is_none_or(|(most, _)| rank > *most) {
            best = Some((rank, run.path));
        }
    }
    best.map(|(_, path)| path).ok_or_else(|| {
        let what = format!("no finished run in {} has measurements of nodes of this experiment", folder.display());
        CliError::usage(what, remedy(experiment))
    })
}

/// The differences of two sources, except the selection of frames.
fn differences(before: &RecordedSource, after: &RecordedSource) -> Vec<PlanDifference> {
    let is_selection = |difference: &PlanDifference| matches!(difference, PlanDifference::Parameter { path, .. } if SELECTION.contains(&path.as_str()));
    source_differences(before, after).into_iter().filter(|difference| !is_selection(difference)).collect()
}

/// Why the numbers may not fit the experiment.
fn warnings(plan: &Plan, costs: &Costs, found: &Matched) -> Vec<String> {
    let mut warnings = Vec::new();
    let recorded = RecordedPlan::from_plan(plan);
    let run = costs.folder.display();
    for stage in &recorded.runs {
        let Some(before) = costs.plan.runs.iter().find(|before| before.prefix == stage.prefix) else { continue };
        let differing = differences(&before.source, &stage.source);
        if !differing.is_empty() {
            let differing = differing.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
            let name = stage.name();
            warnings.push(format!(
                "the source of stage `{name}` differs from that in {run}, so costs per frame may differ: {differing}"
            ));
        }
    }
    let nodes = || costs.stages.iter().flat_map(|stage| stage.nodes.iter().map(move |node| (stage, node)));
    let is_reused = |(stage, node): &(&StageCosts, &NodeCosts)| {
        node.frames < stage.frames && !(node.frames == 0 && node.once.is_some())
    };
    let reused = nodes().filter(is_reused).count();
    if 2 * reused > nodes().count() {
        warnings.push(format!(
            "{run} reused values of {}, so the costs of encoding and writing may be too low",
            counted(reused, "node")
        ));
    }
    if costs.report.is_none() {
        warnings.push(format!(
            "{run} has no measurement of the report, which is not included: run again with this version of depthloom"
        ));
    }
    for source in &found.unknown_files {
        warnings.push(format!("the files of source `{source}` are not known, and not included in the bytes read"));
    }
    warnings
}

fn output(
    args: &PlanArgs,
    plan: &Plan,
    costs: &Costs,
    found: Matched,
    (variants, assumptions): (u64, Assumptions),
    prediction: Prediction,
    warnings: Vec<String>,
) -> PlanCost {
    let stages = costs.plan.runs.iter().zip(&costs.stages);
    let own_frames = RunId::enumerate(&plan.runs)
        .filter(|(run, _)| args.frames.is_some() && is_read_by_another_stage(plan, *run))
        .map(|(_, planned)| planned.prefix.trim_start_matches('/').to_owned());
    PlanCost {
        from: costs.folder.to_string_lossy().into_owned(),
        variants,
        workers: assumptions.workers,
        bandwidth_mb_s: assumptions.bandwidth / 1e6,
        cpu_s: prediction.cpu_s,
        core_hours: prediction.cpu_s / 3600.0,
        wall_s: prediction.wall_s,
        wall_limit: prediction.limit,
        read_bytes: prediction.read_bytes.round() as u64,
        written_bytes: prediction.written_bytes.round() as u64,
        file_system: prediction.file_system,
        peak_resident_bytes: costs.peak_resident_bytes,
        steps: prediction.steps,
        measured: stages
            .map(|(run, stage)| MeasuredStage {
                stage: run.name().to_owned(),
                frames: stage.frames,
                cpu_s_per_frame: stage.cpu_s_per_frame() + costs.other_cpu_s,
                bytes_per_frame: stage.bytes_per_frame(),
                aggregate_cpu_s: stage.aggregate_cpu_s(),
            })
            .collect(),
        own_frames: own_frames.collect(),
        by_kind: found.by_kind,
        not_included: found.missing,
        warnings,
    }
}

fn text(cost: &PlanCost) -> String {
    let measured: Vec<String> = cost
        .measured
        .iter()
        .map(|stage| format!("{} {}", stage.stage, counted(stage.frames as usize, "frame")))
        .collect();
    let mut text = format!("measured in {}: {}\n\n", cost.from, measured.join(", "));
    let mut rows = vec![["step", "frames", "part", "CPU s", "CPU ms/frame", "read", "written"].map(str::to_owned)];
    for step in &cost.steps {
        for (index, part) in step.parts.iter().enumerate() {
            let is_first = index == 0;
            let frames = step.frames.filter(|_| is_first).map_or_else(String::new, |frames| frames.to_string());
            let is_per_frame = part.part.name() != "aggregate";
            let per_frame = step.frames.filter(|frames| *frames > 0 && is_per_frame);
            rows.push([
                step.stage.clone().filter(|_| is_first).unwrap_or_default(),
                frames,
                part.part.name().to_owned(),
                format!("{:.1}", part.cpu_s),
                per_frame.map_or_else(String::new, |frames| format!("{:.2}", 1000.0 * part.cpu_s / frames as f64)),
                bytes(part.read_bytes),
                bytes(part.written_bytes),
            ]);
        }
    }
    rows.push([
        "total".to_owned(),
        String::new(),
        String::new(),
        format!("{:.1}", cost.cpu_s),
        String::new(),
        bytes(cost.read_bytes),
        bytes(cost.written_bytes),
    ]);
    text += &aligned(&rows, &[1, 3, 4, 5, 6]);
    text.push('\n');
    text += &aligned(&summary(cost), &[]);
    let lists = [
        ("cost of a node of the same kind, because the node differs", &cost.by_kind),
        ("without a measurement, not included", &cost.not_included),
    ];
    for (what, names) in lists.into_iter().filter(|(_, names)| !names.is_empty()) {
        text += &format!("\n{what}:\n");
        text.extend(names.iter().map(|name| format!("  {name}\n")));
    }
    text
}

/// The results, one row each.
fn summary(cost: &PlanCost) -> Vec<[String; 2]> {
    let workers = counted(cost.workers as usize, "worker");
    let limit = match cost.wall_limit {
        WallLimit::Workers => "limited by CPU time",
        WallLimit::SerialPart => "limited by parts that use few threads",
        WallLimit::FileSystem => "limited by the file system",
    };
    let row = |name: &str, value: String| [name.to_owned(), value];
    let mut rows = vec![
        row("core-hours", format!("{:.3} ({:.0} CPU seconds)", cost.core_hours, cost.cpu_s)),
        row("wall time", format!("{} with {workers}, {limit}", duration(cost.wall_s))),
        row("read", size(cost.read_bytes)),
        row("written", size(cost.written_bytes)),
    ];
    if let Some(usage) = &cost.file_system {
        let FileSystemUse { stage, read_mb_s, written_mb_s, workers_at_limit } = usage;
        rows.push(row(
            "file system",
            format!("{read_mb_s:.1} MB/s read, {written_mb_s:.1} MB/s written with {workers} in stage {stage}"),
        ));
        rows.push(row(
            "",
            format!(
                "the limit from {} on, at {:.0} MB/s (--bandwidth)",
                counted(*workers_at_limit as usize, "worker"),
                cost.bandwidth_mb_s
            ),
        ));
    }
    if let Some(peak) = cost.peak_resident_bytes {
        rows.push(row("memory", format!("{} in the measured run", size(peak))));
    }
    if !cost.own_frames.is_empty() {
        let stages = cost.own_frames.join(", ");
        rows.push(row("frames", format!("stages that other stages read keep their own: {stages}")));
    }
    rows
}

fn bytes(bytes: u64) -> String {
    if bytes == 0 { String::new() } else { size(bytes) }
}

/// `41 s`, `12 min`, `5.2 h`.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::duration;

    #[test]
    fn durations_have_a_unit_that_fits() {
        let texts = [0.25, 41.4, 300.0, 18_720.0].map(duration);
        assert_eq!(texts, ["0.2 s", "41 s", "5 min", "5.2 h"]);
    }
}
