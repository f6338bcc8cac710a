//! The parts of a planned run, with the costs that an earlier run measured.

use std::collections::BTreeSet;
use std::path::PathBuf;

use depthloom_graphs::contracts::{Contract, Frame, Source};
use depthloom_graphs::plan::{FrameIndex, Origin, Plan, PlannedNode, RunId, StageRun};
use depthloom_graphs::ready::Ready;
use depthloom_recording::{RecordedNode, RecordedOutput, RecordedPlan, RecordedRun};
use depthloom_runs::environment::Work;

use super::measured::{Costs, NodeCosts, OutputBytes, StageCosts, recorded_frames};
use super::page::PageContent;
use super::prediction::{Part, PartClass, Step};

/// The most frames of a source whose files are looked at.
const MOST_FRAMES: usize = 1000;
/// The steps of a run, and what they do not include.
#[derive(Default)]
pub(super) struct Matched {
    pub(super) steps: Vec<Step>,
    /// Nodes and sources with the cost of another node of the same kind.
    pub(super) by_kind: Vec<String>,
    /// Nodes and sources without a measurement.
    pub(super) missing: Vec<String>,
    /// Whether a part has a measurement.
    pub(super) has_measurement: bool,
    /// Sources whose files are not known.
    pub(super) unknown_files: Vec<String>,
}

/// The frames of every stage run: `frames` if it is given, except of stages that another stage reads.
pub(super) fn frames_of(ready: &Ready, frames: Option<u64>) -> Vec<u64> {
    let plan = &ready.plan;
    let own = ready.runs.iter().map(|run| run.source.frames().len() as u64);
    let of_run = |(run, own): (RunId, u64)| match frames {
        Some(frames) if !is_read_by_another_stage(plan, run) => frames,
        _ => own,
    };
    RunId::all(plan.runs.len()).zip(own).map(of_run).collect()
}

/// Whether another stage reads an aggregate value of this one, as of a training.
pub(super) fn is_read_by_another_stage(plan: &Plan, run: RunId) -> bool {
    let reads = |node: &PlannedNode| {
        node.inputs.iter().any(|input| matches!(input.from, Some(Origin::Once { run: from, .. }) if from == run))
    };
    RunId::enumerate(&plan.runs).any(|(other, planned)| other != run && planned.nodes.iter().any(reads))
}

/// The parts of a run of `ready` with these numbers of frames.
pub(super) fn matched(ready: &Ready, frames: &[u64], costs: &Costs, page: bool) -> Matched {
    let mut found = Matched::default();
    let recorded = RecordedPlan::from_plan(&ready.plan);
    found.steps.extend(costs.start.map(|start| other_step(PartClass::Start, start.cpu_s, 1.0, 0.0)));
    for ((run, planned), frames) in RunId::enumerate(&ready.plan.runs).zip(frames) {
        let stage = Stage { plan: &ready.plan, planned, recorded: &recorded.runs[run], frames: *frames, costs };
        let parts = stage.parts(&*ready.runs[run.0].source, &mut found);
        found.steps.push(Step { stage: stage.recorded.name().to_owned(), frames: *frames, parts });
    }
    found.steps.extend(report_steps(&recorded, frames, costs, page));
    found
}

/// A stage run of the experiment, and the costs of an earlier run.
struct Stage<'a> {
    plan: &'a Plan,
    planned: &'a StageRun,
    recorded: &'a RecordedRun,
    frames: u64,
    costs: &'a Costs,
}

impl Stage<'_> {
    /// Whether all variants share what these variants use.
    fn is_shared(&self, variants: usize) -> bool {
        variants == self.plan.variants.len()
    }

    fn parts(&self, source: &dyn Source, found: &mut Matched) -> Vec<Part> {
        let is_shared = self.is_shared(self.planned.variants.len());
        let stage = self.measured_stage(found);
        let mut parts = vec![Part {
            is_shared,
            cpu_s: stage.and_then(|stage| stage.read_cpu_s).unwrap_or(0.0),
            read_bytes: self.source_bytes(source, found),
            ..Part::new(PartClass::Read)
        }];
        if let Some(stage) = stage {
            let other = stage.other_bytes;
            parts.push(Part { is_shared, cpu_s: self.costs.other_cpu_s, ..Part::new(PartClass::Other) });
            parts.push(write(stage, other, is_shared));
            for (output, bytes) in self.recorded.source.outputs.iter().zip(self.source_outputs(stage)) {
                let Some(bytes) = bytes else { continue };
                let share = self.recorded_share(output);
                parts.push(Part {
                    is_shared,
                    cpu_s: share * bytes.raw * stage.encode_source_s,
                    ..Part::new(PartClass::Encode)
                });
                parts.push(write(stage, share * bytes.stored, is_shared));
            }
        }
        for (node, recorded) in self.planned.nodes.iter().zip(&self.recorded.nodes) {
            self.add_node(node, recorded, stage, source.frames().first(), &mut parts, found);
        }
        parts
    }

    /// The costs of the stage run with the same stage and source, else with the same source.
    fn measured_stage(&self, found: &mut Matched) -> Option<&StageCosts> {
        let kinds = |run: &RecordedRun| run.source.parts.iter().map(|part| part.kind.clone()).collect::<Vec<_>>();
        let wanted = kinds(self.recorded);
        let runs = self.costs.plan.runs.iter().zip(&self.costs.stages);
        let same_kinds = runs.filter(|(run, costs)| kinds(run) == wanted && costs.read_cpu_s.is_some());
        // The last of equal ones: stages of the same name first, then sources of the same name.
        let nearness = |(run, _): &(&RecordedRun, &StageCosts)| {
            (run.prefix == self.recorded.prefix, run.stage == self.recorded.stage, run.source == self.recorded.source)
        };
        let nearest = same_kinds.max_by_key(nearness);
        let name = format!("the source of {}", self.recorded.name());
        match nearest {
            Some((run, costs)) => {
                found.has_measurement = true;
                if run.stage != self.recorded.stage {
                    found.by_kind.push(name);
                }
                Some(costs)
            }
            None => {
                found.missing.push(format!("{name} ({})", wanted.join(", ")));
                None
            }
        }
    }

    /// The measured sizes of the source's outputs, in their order.
    fn source_outputs<'b>(&self, stage: &'b StageCosts) -> Vec<Option<&'b OutputBytes>> {
        let of_port = |port: &str| stage.source.iter().find(|bytes| bytes.port == port);
        let outputs = self.recorded.source.outputs.iter();
        outputs.map(|output| of_port(&output.port).filter(|_| output.recorded)).collect()
    }

    /// The share of frames whose value is recorded.
    fn recorded_share(&self, output: &RecordedOutput) -> f64 {
        recorded_frames(output, self.frames, self.plan.record.every) as f64 / self.frames.max(1) as f64
    }

    fn add_node(
        &self,
        node: &PlannedNode,
        recorded: &RecordedNode,
        stage: Option<&StageCosts>,
        first: Option<&Frame>,
        parts: &mut Vec<Part>,
        found: &mut Matched,
    ) {
        let name = match node.variant_names(self.plan).first() {
            Some(variant) => format!("{}.{variant}/{}", self.planned.stage, node.name),
            None => format!("{}.{}", self.planned.stage, node.name),
        };
        let Some(Measurement { costs, is_equal }) = self.measurement(recorded) else {
            found.missing.push(format!("{name} ({})", node.kind));
            return;
        };
        found.has_measurement = true;
        if !is_equal {
            found.by_kind.push(format!("{name} ({})", node.kind));
        }
        let is_shared = self.is_shared(node.variants.len());
        let is_ordered = node.contract == Contract::Ordered;
        parts.push(Part {
            is_shared,
            cpu_s: costs.cpu_s.unwrap_or(0.0),
            threads: is_ordered.then_some(1.0),
            read_bytes: observed_bytes(node, first),
            ..Part::new(PartClass::Nodes)
        });
        for (output, planned) in recorded.outputs.iter().zip(&node.outputs) {
            let Some(bytes) = costs.outputs.iter().find(|bytes| bytes.port == output.port) else { continue };
            let (Some(stage), true) = (stage, planned.recorded) else { continue };
            let share = self.recorded_share(output);
            let cpu_s = share * bytes.raw * stage.encode_nodes_s;
            parts.push(Part { is_shared, cpu_s, ..Part::new(PartClass::Encode) });
            parts.push(write(stage, share * bytes.stored, is_shared));
        }
        let once = Part { is_shared, ..Part::once(PartClass::Aggregate) };
        // What an ordered node collects grows with the frames; what an aggregate node computes does not.
        let growth = if is_ordered { self.frames as f64 / costs.frames.max(1) as f64 } else { 1.0 };
        if let Some(work) = costs.once {
            parts.push(Part { cpu_s: growth * work.cpu_s, threads: Some(threads(work)), ..once });
        }
        if costs.aggregate_bytes > 0 {
            parts.push(Part { written_bytes: growth * costs.aggregate_bytes as f64, ..once });
        }
    }

    /// The costs of the equal node, else of the most similar node of the same kind.
    fn measurement(&self, recorded: &RecordedNode) -> Option<Measurement<'_>> {
        let runs = self.costs.plan.runs.iter().zip(&self.costs.stages);
        let nodes = runs.flat_map(|(run, stage)| run.nodes.iter().zip(&stage.nodes).map(move |pair| (run, pair)));
        let measured = nodes.filter(|(_, (node, costs))| node.kind == recorded.kind && costs.is_measured());
        let nearness = |(run, (node, _)): &(&RecordedRun, (&RecordedNode, &NodeCosts))| {
            let is_same_stage = run.stage == self.planned.stage;
            // A source of another size has nodes with the same hash.
            (node.node_hash == recorded.node_hash, is_same_stage && node.name == recorded.name, is_same_stage)
        };
        let (_, (node, costs)) = measured.max_by_key(nearness)?;
        Some(Measurement { costs, is_equal: node.node_hash == recorded.node_hash })
    }

    /// The bytes per frame of the files that the source reads.
    fn source_bytes(&self, source: &dyn Source, found: &mut Matched) -> f64 {
        let frames = source.frames().len();
        let step = frames.div_ceil(MOST_FRAMES).max(1);
        let positions: Vec<FrameIndex> = (0..frames).step_by(step).map(FrameIndex).collect();
        let files = positions.iter().flat_map(|position| source.files(*position)).map(|(_, path)| path);
        let bytes = bytes_per_frame(files, positions.len());
        let is_generated = self.recorded.source.parts.iter().all(|part| part.kind.starts_with("synthetic/"));
        if bytes <= 0.0 && !is_generated {
            found.unknown_files.push(self.planned.source.name.clone());
        }
        bytes
    }
}

/// The size of the files that a node itself reads for the first frame.
fn observed_bytes(node: &PlannedNode, first: Option<&Frame>) -> f64 {
    let (Some(observes), Some(frame)) = (&node.observes, first) else { return 0.0 };
    bytes_per_frame(observes.files_of(frame), 1)
}

/// The costs of a node of the earlier run.
struct Measurement<'a> {
    costs: &'a NodeCosts,
    /// Whether the node is equal, with equal parameters and inputs.
    is_equal: bool,
}

fn write(stage: &StageCosts, written_bytes: f64, is_shared: bool) -> Part {
    let cpu_s = written_bytes * stage.write_s;
    Part { is_shared, cpu_s, threads: Some(1.0), written_bytes, ..Part::new(PartClass::Write) }
}

/// The mean number of threads that worked. A busy machine makes threads wait, but one always worked.
fn threads(work: Work) -> f64 {
    if work.wall_s > 0.0 { (work.cpu_s / work.wall_s).max(1.0) } else { 1.0 }
}

/// The size of files, each counted once, per frame.
fn bytes_per_frame(files: impl Iterator<Item = PathBuf>, frames: usize) -> f64 {
    let files: BTreeSet<PathBuf> = files.collect();
    let size = |path: &PathBuf| std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    files.iter().map(size).sum::<u64>() as f64 / frames.max(1) as f64
}

/// A step outside stages.
fn other_step(class: PartClass, cpu_s: f64, threads: f64, written_bytes: f64) -> Step {
    let part = Part { cpu_s, threads: Some(threads), written_bytes, ..Part::once(class) };
    Step { stage: String::new(), frames: 0, parts: vec![part] }
}

/// The analysis and the page.
fn report_steps(plan: &RecordedPlan, frames: &[u64], costs: &Costs, page: bool) -> Vec<Step> {
    let before: Vec<u64> = costs.stages.iter().map(|stage| stage.frames).collect();
    let ratio = |size: fn(&RecordedRun, u64) -> u64| {
        let sum = |plan: &RecordedPlan, frames: &[u64]| {
            plan.runs.iter().zip(frames).map(|(run, frames)| size(run, *frames)).sum::<u64>()
        };
        sum(plan, frames) as f64 / sum(&costs.plan, &before).max(1) as f64
    };
    let scored = ratio(|run, frames| frames * run.estimates.len().max(1) as u64);
    let content = PageContent::of_run(plan, frames);
    let shown = content.growth(PageContent::of_run(&costs.plan, &before));
    let step = |class: PartClass, work: Option<Work>, growth: f64, bytes: f64| {
        let work = work.unwrap_or(Work { cpu_s: 0.0, wall_s: 0.0 });
        other_step(class, growth * work.cpu_s, threads(work), bytes)
    };
    let report_bytes = scored * costs.frame_file_bytes as f64 + costs.constant_bytes as f64;
    let mut steps = vec![step(PartClass::Report, costs.report, scored, report_bytes)];
    if page && costs.page_bytes > 0 {
        let page_bytes = (shown * costs.page_bytes as f64).min(content.most_bytes());
        steps.push(step(PartClass::Page, costs.page, shown, page_bytes));
    }
    steps
}
