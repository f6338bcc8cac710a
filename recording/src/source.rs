//! The source kind `mcap`: the recorded values of a stage as output ports.

use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SlotKey, SourceDeclaration, Survey};
use depthloom_graphs::language::{glob, nearest};
use depthloom_graphs::plan::{FrameIndex, NodeId, RunId, VariantId};
use depthloom_graphs::{Context, Fault, Frame, Key, Outputs, Port, Source, SourceKind, SourceOutputs, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::condition::Condition;
use crate::plan::{RecordedNode, RecordedOutput, RecordedRun};
use crate::read::recording::Recording;
use crate::reuse::stored_values::fault;
use crate::write::file_writer::LIBRARY;

const KIND: &str = "mcap";
const VERSION: u32 = 1;

/// The name of a recording in the folder of a run.
const IN_A_RUN: &str = "recording.mcap";

/// Parameters of `mcap`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct McapParams {
    /// The recording, or the folder of its run.
    pub path: DataPath,
    /// The stage to read. Required only if the recording has several stages.
    pub stage: Option<String>,
    /// The variant to read. Without it, nodes that differ between the recorded variants have no outputs.
    pub variant: Option<String>,
    /// The outputs to read: those of the recorded source by their names (`left`), those of nodes as `node.output`
    /// (`stereo.disparity`); `*` matches any characters. By default all recorded outputs of the source, with the cache
    /// keys of that source.
    pub outputs: Vec<String>,
    /// The frames to read, by their recorded index: `1..=40`, `0..48`, `[3, 7]` or a file of ids. By default
    /// (`available`) all frames whose values are recorded.
    pub frames: FrameSelection,
}

/// The kind `mcap`.
pub struct Mcap {
    recording: Recording,
    run: RunId,
    ports: Vec<RecordedPort>,
    frames: Vec<Frame>,
    /// By frame, its position in the recorded stage.
    positions: Vec<FrameIndex>,
    warnings: Vec<String>,
}

/// An output port, and its recorded topic.
struct RecordedPort {
    port: Port,
    topic: String,
    /// The node that computed it; `None` for the source.
    node: Option<NodeId>,
}

impl SourceKind for Mcap {
    type Params = McapParams;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "A recording: the values of one of its stages.",
            doc: "\
`path` is a `recording.mcap`, or the folder of a run. The recording determines the outputs. An output of the recorded source keeps its name (`left`, \
`calibration`, `depth`). An output of a node is `node.output`: `source/stereo.disparity` reads recorded disparities. `outputs` selects among them. \
`depthloom inspect` lists the topics of a recording.\n\n\
Frames keep id, index and time. Their cache key is that of the recorded values, so nothing is decoded to determine it. If only outputs of the recorded \
source are used, cached results for that source stay valid. With `record: { every: n }`, the source has the frames whose values were recorded. Scores \
and aggregate values (models, samples) are not outputs: read a model with `{ file: PATH }`. If the recording was cut off, its complete frames are read, \
with a warning.",
            outputs: Vec::new(),
        }
    }

    fn check(params: &McapParams) -> Result<(), (&'static str, String)> {
        match params.path.path().as_os_str().is_empty() {
            true => Err(("path", "path is missing: a recording, or the folder of a run".to_owned())),
            false => Ok(()),
        }
    }

    fn outputs(params: &McapParams) -> Result<Vec<Port>, Fault> {
        let recording = open(params)?;
        let run = run_of(&recording, params)?;
        Ok(selected_ports(&recording, run, params)?.into_iter().map(|port| port.port).collect())
    }

    fn open(params: McapParams) -> Result<Box<dyn Source>, Fault> {
        Ok(Box::new(Self::opened(&params)?))
    }

    fn survey(params: McapParams) -> Survey {
        match Self::opened(&params) {
            Ok(source) => {
                let faults =
                    if params.frames == FrameSelection::All { missing_frames(&source.recording) } else { None };
                Survey { faults: faults.into_iter().collect(), source: Some(Box::new(source)), facts: Vec::new() }
            }
            Err(fault) => Survey::failed(fault),
        }
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        if !may_be_one(root) {
            return Vec::new();
        }
        let params = McapParams { path: DataPath(root.to_owned()), ..McapParams::default() };
        let Ok(recording) = open(&params) else {
            // Other programs' files are not recordings, except in a run's folder.
            let is_recording = root.join(IN_A_RUN).is_file() || is_of_ours(&path_of(&params));
            let damaged = || Recognised::new("a recording of depthloom that cannot be opened", json!({ "path": root }));
            return is_recording.then(damaged).into_iter().collect();
        };
        let one = |run: &RecordedRun| {
            let what = format!("a recording of depthloom, stage {}", run.name());
            Recognised::new(what, json!({ "path": root, "stage": run.name() }))
        };
        recording.plan().runs.iter().map(one).collect()
    }
}

impl Mcap {
    fn opened(params: &McapParams) -> Result<Self, Fault> {
        let recording = open(params)?;
        let run = run_of(&recording, params)?;
        let ports = selected_ports(&recording, run, params)?;
        let every = usize::try_from(recording.plan().every).unwrap_or(usize::MAX).max(1);
        let recorded = recording.frames(run);
        let mut positions_by_index: Vec<FrameIndex> = FrameIndex::all(recorded.len()).step_by(every).collect();
        positions_by_index.sort_by_key(|position| recorded[*position].index);
        let frame_ids: Vec<(u64, &str)> =
            positions_by_index.iter().map(|at| (recorded[*at].index, &*recorded[*at].id)).collect();
        if frame_ids.is_empty() {
            let (path, stage) = (recording.path().display(), recording.plan().runs[run].name());
            let what = match recording.condition() {
                Condition::Complete => format!("{path} has no frames of stage `{stage}`"),
                condition => format!("{path} has no complete frame of stage `{stage}`: it is {condition}"),
            };
            return Err(Fault::new(what).remedy(
                "repeat `depthloom run` with the same --out to resume after the complete frames; `depthloom inspect` lists the content of a recording",
            ));
        }
        let chosen = params.frames.select(&frame_ids)?;
        let mut warnings: Vec<String> = params.frames.left_out(&frame_ids).into_iter().collect();
        if *recording.condition() != Condition::Complete {
            let path = recording.path().display();
            warnings.push(format!(
                "{path} is {}: {} frames of the stage can be read",
                recording.condition(),
                frame_ids.len()
            ));
        }
        let positions: Vec<FrameIndex> = chosen.into_iter().map(|at| positions_by_index[at]).collect();
        let frame = |position: &FrameIndex| {
            let recorded = &recorded[*position];
            Frame { id: recorded.id.clone(), index: recorded.index, time_ns: recorded.time_ns }
        };
        let frames = positions.iter().map(frame).collect();
        Ok(Self { run, ports, frames, positions, warnings, recording })
    }
}

/// Whether a path has the name of a recording or of a run's folder.
fn may_be_one(root: &Path) -> bool {
    root.is_file() && root.extension().is_some_and(|ending| ending == "mcap") || root.join(IN_A_RUN).is_file()
}

/// Whether a file's first bytes name depthloom as its writer.
fn is_of_ours(path: &Path) -> bool {
    let mut head = [0; 64];
    let read = std::fs::File::open(path).and_then(|mut file| std::io::Read::read(&mut file, &mut head));
    read.is_ok_and(|count| head[..count].windows(LIBRARY.len()).any(|window| window == LIBRARY.as_bytes()))
}

/// The fault that a recording lacks frames of its run.
fn missing_frames(recording: &Recording) -> Option<Fault> {
    let is_lost = match recording.condition() {
        Condition::Complete => false,
        Condition::Unfinished { .. } | Condition::Recovered => true,
        Condition::Damaged { cut, .. } => *cut,
    };
    is_lost.then(|| {
        let what = format!("{} is {}: frames of the run are missing", recording.path().display(), recording.condition());
        Fault::new(what).remedy(
            "repeat `depthloom run` with the same --out to record the missing frames, or use the recorded frames; `frames:` selects among \
             them",
        )
    })
}

impl Source for Mcap {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        let frame = &self.recording.frames(self.run)[self.positions[position]];
        let of_source = frame.source_key.ok_or_else(|| {
            let what = format!("{} has no values of frame `{}`", self.recording.path().display(), frame.id);
            Fault::new(format!("{what}: its source failed when it was recorded"))
                .remedy("exclude the frame with `frames:`")
        })?;
        if self.ports.iter().all(|port| port.node.is_none()) {
            return Ok(of_source);
        }
        let of_node = |node: NodeId| frame.keys.iter().find(|slot| slot.node == node).map(|SlotKey { key, .. }| *key);
        let mut key = Key::build(KIND).number(VERSION.into());
        for port in &self.ports {
            let key_of_port = port.node.map_or(Some(of_source), of_node);
            // A port without a value has no bytes.
            key = key.text(port.port.name).bytes(key_of_port.as_ref().map_or(&[][..], |key| key.as_bytes()));
        }
        Ok(key.finish())
    }

    fn read(&self, position: FrameIndex, _: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let key = self.key(position)?;
        let topics: Vec<&str> = self.ports.iter().map(|port| port.topic.as_str()).collect();
        let mut reader = self.recording.reader(self.run, &topics).map_err(fault)?;
        let values = reader.read(self.positions[position]).map_err(fault)?;
        let present = self.ports.iter().zip(values).filter_map(|(port, value)| Some((port.port.name, value?)));
        let outputs = present.fold(Outputs::none(), |outputs, (port, value)| outputs.with(port, value));
        Ok(SourceOutputs { outputs, key })
    }
}

fn path_of(params: &McapParams) -> PathBuf {
    let path = params.path.path();
    if path.is_dir() { path.join(IN_A_RUN) } else { path.to_owned() }
}

fn open(params: &McapParams) -> Result<Recording, Fault> {
    Recording::open(path_of(params)).map_err(fault)
}

fn run_of(recording: &Recording, params: &McapParams) -> Result<RunId, Fault> {
    let plan = recording.plan();
    let variant = variant_of(recording, params)?;
    let fits = |run: &RecordedRun| {
        params.stage.as_ref().is_none_or(|stage| *stage == run.stage || stage == run.name())
            && variant.is_none_or(|variant| run.variants.contains(&variant))
    };
    let found: Vec<RunId> = RunId::all(plan.runs.len()).filter(|run| fits(&plan.runs[*run])).collect();
    let names = |runs: &mut dyn Iterator<Item = &RecordedRun>| {
        runs.map(|run| format!("`{}`", run.name())).collect::<Vec<_>>().join(", ")
    };
    let path = recording.path().display();
    match (found.as_slice(), &params.stage) {
        ([run], _) => Ok(*run),
        ([], Some(stage)) => Err(Fault::new(format!("{path} has no stage `{stage}`"))
            .remedy(format!("its stages are {}", names(&mut plan.runs.iter())))),
        ([], None) => Err(Fault::new(format!("{path} has no stage"))),
        (several, _) => Err(Fault::new(format!("{path} has {} stages", several.len())).remedy(format!(
            "say which, with `stage`, and with `variant` where its source differs: {}",
            names(&mut several.iter().map(|run| &plan.runs[*run]))
        ))),
    }
}

fn variant_of(recording: &Recording, params: &McapParams) -> Result<Option<VariantId>, Fault> {
    let Some(name) = &params.variant else { return Ok(None) };
    let known = &recording.plan().variants;
    let found = known.iter().position(|variant| variant == name);
    found.map(|found| Some(VariantId(found))).ok_or_else(|| {
        let fault = Fault::new(format!("{} has no variant `{name}`", recording.path().display()));
        match nearest(name, known.iter().map(String::as_str)) {
            Some(near) => fault.remedy(format!("did you mean `{near}`?")),
            None => fault.remedy(format!("its variants are {}", known.join(", "))),
        }
    })
}

/// The recorded ports of a stage run that the parameters select.
fn selected_ports(recording: &Recording, run: RunId, params: &McapParams) -> Result<Vec<RecordedPort>, Fault> {
    let planned = &recording.plan().runs[run];
    let variant = variant_of(recording, params)?;
    let port_of = |node: Option<NodeId>, name: String, output: &RecordedOutput| {
        let value_type = output.value_type().filter(|value_type| *value_type != ValueType::Scores)?;
        let doc = Port::intern(&format!("Recorded as topic {}.", output.topic));
        let port = Port::frame(Port::intern(&name), value_type, doc).optional();
        (output.recorded && !output.once).then(|| RecordedPort { port, topic: output.topic.clone(), node })
    };
    let mut all: Vec<RecordedPort> =
        planned.source.outputs.iter().filter_map(|output| port_of(None, output.port.clone(), output)).collect();
    let serves = |node: &RecordedNode| match variant {
        Some(variant) => node.variants.contains(&variant),
        None => node.variants.len() == planned.variants.len(),
    };
    for (index, node) in NodeId::enumerate(&planned.nodes).filter(|(_, node)| serves(node)) {
        let outputs = node.outputs.iter();
        let outputs =
            outputs.filter_map(|output| port_of(Some(index), format!("{}.{}", node.name, output.port), output));
        let outputs: Vec<RecordedPort> = outputs.collect();
        if outputs.iter().all(|port| all.iter().all(|known| known.port.name != port.port.name)) {
            all.extend(outputs);
        }
    }
    if params.outputs.is_empty() {
        all.retain(|port| port.node.is_none());
    } else {
        let fits = |pattern: &String, port: &RecordedPort| glob(pattern, port.port.name);
        if let Some(none) = params.outputs.iter().find(|pattern| !all.iter().any(|port| fits(pattern, port))) {
            return Err(no_output(recording, none, &all, variant.is_none()));
        }
        all.retain(|port| params.outputs.iter().any(|pattern| fits(pattern, port)));
    }
    if all.is_empty() {
        let what = format!("{} has no values of the source of stage `{}`", recording.path().display(), planned.name());
        return Err(Fault::new(what).remedy("select outputs of its nodes with `outputs`"));
    }
    Ok(all)
}

fn no_output(recording: &Recording, pattern: &str, all: &[RecordedPort], of_all_variants: bool) -> Fault {
    let fault = Fault::new(format!("{} has no output `{pattern}`", recording.path().display()));
    let names = || all.iter().map(|port| port.port.name);
    let remedy = match nearest(pattern, names()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("it has {}", names().collect::<Vec<_>>().join(", ")),
    };
    match of_all_variants && recording.plan().variants.len() > 1 {
        true => fault.remedy(format!("{remedy}; set `variant` to read nodes that differ between variants")),
        false => fault.remedy(remedy),
    }
}
