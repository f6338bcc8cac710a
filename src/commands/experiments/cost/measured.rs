//! What a run cost, by stage, node and frame: from its timings, its recording and its environment.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use depthloom_analysis::{PAGE, Timing, read_timings, variant_of};
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{NodeId, RunId, VariantId};
use depthloom_recording::{RecordedContent, RecordedNode, RecordedOutput, RecordedPlan, Recording, TopicSize};
use depthloom_runs::environment::{self, Work};
use depthloom_runs::{RECORDING, TIMINGS, files_in, open, read_failed};
use depthloom_terminal::{CliError, ExitCode};

/// The beginning of the names of files with one row per frame.
const FRAME_FILES: [&str; 2] = ["scores.", "samples."];

/// What a run cost.
#[derive(Clone, Debug)]
pub(crate) struct Costs {
    /// The folder of the run.
    pub(crate) folder: PathBuf,
    /// Its plan.
    pub(crate) plan: RecordedPlan,
    /// By stage run.
    pub(crate) stages: Vec<StageCosts>,
    /// Until the first frame; `None` if an earlier version of depthloom wrote the run.
    pub(crate) start: Option<Work>,
    /// The analysis with tables and figures; `None` as for `start`.
    pub(crate) report: Option<Work>,
    /// The page; `None` without a page, and as for `start`.
    pub(crate) page: Option<Work>,
    /// CPU seconds during frames that no timing contains, per frame.
    pub(crate) other_cpu_s: f64,
    /// The size of the page.
    pub(crate) page_bytes: u64,
    /// The size of files with one row per frame.
    pub(crate) frame_file_bytes: u64,
    /// The size of other files, and of the parts of the recording that do not grow with the frames.
    pub(crate) constant_bytes: u64,
    /// The most memory that the run used.
    pub(crate) peak_resident_bytes: Option<u64>,
}

/// What a stage run cost.
#[derive(Clone, Debug)]
pub(crate) struct StageCosts {
    /// The number of frames in the recording.
    pub(crate) frames: u64,
    /// CPU seconds for reading a frame; `None` if none was read.
    pub(crate) read_cpu_s: Option<f64>,
    /// The outputs of the source.
    pub(crate) source: Vec<OutputBytes>,
    /// By node, in the order of the plan.
    pub(crate) nodes: Vec<NodeCosts>,
    /// CPU seconds for encoding and compressing a byte of the source's values.
    pub(crate) encode_source_s: f64,
    /// The same for a byte of the values of nodes.
    pub(crate) encode_nodes_s: f64,
    /// CPU seconds for writing a byte.
    pub(crate) write_s: f64,
    /// Bytes per frame of the recording that belong to no output: commits, messages for viewers, indexes.
    pub(crate) other_bytes: f64,
}

/// What a node cost.
#[derive(Clone, Debug, Default)]
pub(crate) struct NodeCosts {
    /// The number of frames on which it ran.
    pub(crate) frames: u64,
    /// CPU seconds per frame; `None` if it ran on none.
    pub(crate) cpu_s: Option<f64>,
    /// The work outside frames; `None` if there was none.
    pub(crate) once: Option<Work>,
    /// The size of its aggregate values.
    pub(crate) aggregate_bytes: u64,
    /// Its outputs that were recorded per frame.
    pub(crate) outputs: Vec<OutputBytes>,
}

impl NodeCosts {
    /// Whether its CPU time was measured.
    pub(crate) const fn is_measured(&self) -> bool {
        self.cpu_s.is_some() || self.once.is_some()
    }
}

/// The size of the values of an output, per recorded frame.
#[derive(Clone, Debug)]
pub(crate) struct OutputBytes {
    /// The port.
    pub(crate) port: String,
    /// Without compression.
    pub(crate) raw: f64,
    /// In the recording.
    pub(crate) stored: f64,
}

impl StageCosts {
    /// CPU seconds per frame, without aggregate nodes. Only values with a measurement are included.
    pub(crate) fn cpu_s_per_frame(&self) -> f64 {
        let nodes: f64 = self.nodes.iter().filter_map(|node| node.cpu_s).sum();
        let raw = |outputs: &[OutputBytes]| outputs.iter().map(|output| output.raw).sum::<f64>();
        let node_bytes: f64 = self.nodes.iter().map(|node| raw(&node.outputs)).sum();
        self.read_cpu_s.unwrap_or(0.0)
            + nodes
            + self.encode_source_s * raw(&self.source)
            + self.encode_nodes_s * node_bytes
            + self.write_s * self.bytes_per_frame()
    }

    /// The bytes per frame in the recording.
    pub(crate) fn bytes_per_frame(&self) -> f64 {
        let nodes = self.nodes.iter().flat_map(|node| &node.outputs);
        self.other_bytes + self.source.iter().chain(nodes).map(|output| output.stored).sum::<f64>()
    }

    /// CPU seconds of aggregate nodes, and of ordered nodes after their last frame.
    pub(crate) fn aggregate_cpu_s(&self) -> f64 {
        self.nodes.iter().filter_map(|node| node.once).map(|once| once.cpu_s).sum()
    }
}

/// The timings of one run, found by stage, variant, node and phase.
pub(super) struct Timings(Vec<Timing>);

impl Timings {
    pub(super) fn read(folder: &Path) -> Result<Self, CliError> {
        read_timings(&folder.join(TIMINGS)).map(Self).map_err(|error| {
            let stop = CliError::because(ExitCode::Usage, "failed to read the timings of the run", &error);
            stop.remedy("name the folder of a finished run, or a run that `depthloom runs` lists")
        })
    }

    fn stage<'a>(
        &'a self,
        plan: &'a RecordedPlan,
        stage: &'a str,
        variants: &[VariantId],
    ) -> impl Iterator<Item = &'a Timing> {
        let variant = variant_of(plan, variants);
        self.0.iter().filter(move |row| row.row_key.stage == stage && row.row_key.variant.as_deref() == variant)
    }

    /// CPU time per frame, and outside frames, of a node.
    pub(super) fn node(&self, plan: &RecordedPlan, stage: &str, node: &RecordedNode) -> NodeCosts {
        let mut costs = NodeCosts::default();
        for row in self.stage(plan, stage, &node.variants).filter(|row| row.node == node.name && row.frames > 0) {
            let (cpu_s, wall_s) = (row.cpu_ns as f64 / 1e9, row.wall_ns as f64 / 1e9);
            match row.phase.as_str() {
                "process" => {
                    costs.frames = row.frames;
                    costs.cpu_s = Some(cpu_s / row.frames as f64);
                }
                "once" => costs.once = Some(Work { cpu_s, wall_s }),
                _ => {}
            }
        }
        costs
    }

    fn cpu_s(&self) -> f64 {
        self.0.iter().map(|row| row.cpu_ns as f64 / 1e9).sum()
    }
}

/// What a run cost that is stored in a folder.
///
/// # Errors
/// If its recording or its timings cannot be read.
pub(crate) fn measured(folder: &Path) -> Result<Costs, CliError> {
    let recording = open(&folder.join(RECORDING))?;
    let timings = Timings::read(folder)?;
    let sizes = recording.topic_sizes(&|| false);
    let sizes = sizes.map_err(|error| read_failed("failed to read the sizes of the recording's topics", &error))?;
    let plan = recording.plan();
    let mut topics: BTreeMap<&str, &TopicSize> = sizes.iter().map(|size| (size.topic.as_str(), size)).collect();
    let mut stages: Vec<StageCosts> =
        RunId::all(plan.runs.len()).map(|run| stage_costs(&recording, run, &timings, &mut topics)).collect();
    let attached = add_aggregate_bytes(&recording, &mut stages);
    add_other_bytes(&recording, &sizes, &topics, attached, &mut stages);

    let environment = environment::read(folder);
    let work = |part: &str| serde_json::from_value::<Work>(environment[part].clone()).ok();
    let [start, report, page] = ["start", "report", "page"].map(work);
    let known = [start, report, page].into_iter().flatten().map(|part| part.cpu_s).sum::<f64>() + timings.cpu_s();
    let frames: u64 = stages.iter().map(|stage| stage.frames).sum();
    // Without the start this is not a measurement of the frames.
    let process_cpu_s = environment["cpu_s"].as_f64().filter(|_| start.is_some());
    let other_cpu_s = process_cpu_s.map_or(0.0, |all| (all - known).max(0.0)) / frames.max(1) as f64;
    let mut costs = Costs {
        folder: folder.to_owned(),
        plan: plan.clone(),
        stages,
        start,
        report,
        page,
        other_cpu_s,
        page_bytes: 0,
        frame_file_bytes: 0,
        constant_bytes: recording.attachments().iter().map(|entry| entry.size).sum::<u64>().saturating_sub(attached),
        peak_resident_bytes: environment["peak_resident_bytes"].as_u64(),
    };
    for file in files_in(folder) {
        match file.name.as_str() {
            RECORDING => {}
            PAGE => costs.page_bytes = file.bytes,
            name if FRAME_FILES.iter().any(|start| name.starts_with(start)) => costs.frame_file_bytes += file.bytes,
            _ => costs.constant_bytes += file.bytes,
        }
    }
    Ok(costs)
}

/// The costs of a stage run; takes its topics out of `topics`.
fn stage_costs(
    recording: &Recording,
    run: RunId,
    timings: &Timings,
    topics: &mut BTreeMap<&str, &TopicSize>,
) -> StageCosts {
    let plan = recording.plan();
    let planned = &plan.runs[run];
    let frames = recording.frames(run).len() as u64;
    let mut source = Vec::new();
    let mut nodes: Vec<NodeCosts> = planned.nodes.iter().map(|node| timings.node(plan, &planned.stage, node)).collect();
    for (slot, output) in plan.outputs(run).filter(|(_, output)| !output.once) {
        let Some(size) = topics.remove(output.topic.as_str()) else { continue };
        let bytes = output_bytes(output, size, recorded_frames(output, frames, plan.every));
        match slot {
            Slot::Source { .. } => source.push(bytes),
            Slot::Node { node, .. } => nodes[node.0].outputs.push(bytes),
        }
    }
    let rows = || timings.stage(plan, &planned.stage, &planned.variants);
    let cpu_s = |is_of_part: &dyn Fn(&Timing) -> bool| {
        rows().filter(|row| is_of_part(row)).map(|row| row.cpu_ns as f64 / 1e9).sum::<f64>()
    };
    let read = rows().find(|row| row.phase == "read" && row.frames > 0);
    let is_encoding = |row: &Timing| row.phase == "encode" || row.phase == "compress";
    let is_of_source = |row: &Timing| row.node.ends_with(" camera") || row.node.ends_with(" truth");
    let encoded = rows().filter(|row| row.phase == "encode").map(|row| row.frames).max().unwrap_or(0);
    let written = rows().filter(|row| row.phase == "write").map(|row| row.frames).max().unwrap_or(0);
    let raw = |outputs: &mut dyn Iterator<Item = &OutputBytes>| outputs.map(|output| output.raw).sum::<f64>();
    let stored: f64 =
        source.iter().chain(nodes.iter().flat_map(|node| &node.outputs)).map(|output| output.stored).sum();
    let encode_source_s =
        per(cpu_s(&|row| is_encoding(row) && is_of_source(row)), raw(&mut source.iter()) * encoded as f64);
    let node_bytes = raw(&mut nodes.iter().flat_map(|node| &node.outputs));
    let encode_nodes_s = per(cpu_s(&|row| is_encoding(row) && !is_of_source(row)), node_bytes * encoded as f64);
    StageCosts {
        frames,
        read_cpu_s: read.map(|row| row.cpu_ns as f64 / 1e9 / row.frames as f64),
        source,
        nodes,
        encode_source_s,
        encode_nodes_s,
        write_s: per(cpu_s(&|row| row.phase == "write"), stored * written as f64),
        other_bytes: 0.0,
    }
}

/// A quotient; 0 without a divisor.
fn per(cost: f64, count: f64) -> f64 {
    if count > 0.0 { cost / count } else { 0.0 }
}

/// The number of frames of which an output is recorded: metrics of all, other values of every n-th frame.
pub(super) fn recorded_frames(output: &RecordedOutput, frames: u64, every: u64) -> u64 {
    if output.value_type == depthloom_graphs::ValueType::Scores.name() { frames } else { frames.div_ceil(every.max(1)) }
}

fn output_bytes(output: &RecordedOutput, size: &TopicSize, frames: u64) -> OutputBytes {
    let frames = frames.max(1) as f64;
    let (raw, stored) = (size.raw_bytes as f64 / frames, size.stored_bytes as f64 / frames);
    OutputBytes { port: output.port.clone(), raw, stored }
}

/// Adds the attached aggregate values to their nodes; returns the sum of their sizes.
fn add_aggregate_bytes(recording: &Recording, stages: &mut [StageCosts]) -> u64 {
    let mut seen: Vec<&str> = Vec::new();
    let mut sum = 0;
    for value in recording.aggregate_values() {
        let RecordedContent::Attachment { name, .. } = &value.content else { continue };
        // Equal values are stored once.
        if seen.contains(&name.as_str()) {
            continue;
        }
        seen.push(name);
        let (RunId(run), NodeId(node)) = (value.run, value.node);
        let Some(entry) = recording.attachments().iter().find(|entry| entry.name == *name) else { continue };
        if let Some(node) = stages.get_mut(run).and_then(|stage| stage.nodes.get_mut(node)) {
            node.aggregate_bytes += entry.size;
            sum += entry.size;
        }
    }
    sum
}

/// Divides what belongs to no output between the stage runs: topics by their prefix, indexes by the number of messages.
fn add_other_bytes(
    recording: &Recording,
    sizes: &[TopicSize],
    other_topics: &BTreeMap<&str, &TopicSize>,
    attached: u64,
    stages: &mut [StageCosts],
) {
    let plan = recording.plan();
    let is_below = |topic: &str, run: usize| {
        topic.strip_prefix(plan.runs[run].prefix.as_str()).is_some_and(|rest| rest.starts_with('/'))
    };
    let run_of = |topic: &str| {
        let runs = (0..stages.len()).filter(|run| is_below(topic, *run));
        runs.max_by_key(|run| plan.runs[*run].prefix.len())
    };
    let other: Vec<(usize, u64)> =
        other_topics.values().filter_map(|size| Some((run_of(&size.topic)?, size.stored_bytes))).collect();
    let messages: Vec<(usize, u64)> =
        sizes.iter().filter_map(|size| Some((run_of(&size.topic)?, size.messages))).collect();
    let all_messages: u64 = messages.iter().map(|(_, count)| count).sum();
    let stored: u64 = sizes.iter().map(|size| size.stored_bytes).sum();
    let attachments: u64 = recording.attachments().iter().map(|entry| entry.size).sum();
    let indexes = recording.file_bytes().saturating_sub(stored + attachments.max(attached)) as f64;
    for (run, stage) in stages.iter_mut().enumerate() {
        let of_run = |counts: &[(usize, u64)]| {
            counts.iter().filter(|(other, _)| *other == run).map(|(_, count)| count).sum::<u64>() as f64
        };
        let bytes = of_run(&other) + per(indexes * of_run(&messages), all_messages as f64);
        stage.other_bytes = per(bytes, stage.frames as f64);
    }
}
