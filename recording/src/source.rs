//! A recording as a source: what it has of a stage, as output ports.

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
    /// Which stage of it. Need not be said where there is one.
    pub stage: Option<String>,
    /// Whose values, of nodes that differ between the variants recorded. Without it, such nodes have no outputs here.
    pub variant: Option<String>,
    /// What it gives: the outputs of the recorded source by their names (`left`), those of nodes with the node's
    /// (`stereo.disparity`); `*` stands for any run of characters. By default all that the recorded source gave: then
    /// it stands for that source, with the same keys.
    pub outputs: Vec<String>,
    /// Which frames, by the index they had: `1..=40`, `0..48`, `[3, 7]` or a file of ids. By default (`available`) all
    /// whose values are recorded.
    pub frames: FrameSelection,
}

/// The kind `mcap`.
pub struct Mcap {
    recording: Recording,
    run: RunId,
    given: Vec<RecordedPort>,
    frames: Vec<Frame>,
    /// By frame, its position among the recorded.
    positions: Vec<FrameIndex>,
    warnings: Vec<String>,
}

/// An output port, and what was recorded of it.
struct RecordedPort {
    port: Port,
    topic: String,
    /// The node that gave it; `None`: the source.
    node: Option<NodeId>,
}

impl SourceKind for Mcap {
    type Params = McapParams;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "A recording of ours: what it has of a stage, as outputs.",
            doc: "\
`path` is a `recording.mcap`, or the folder of a run. Its outputs are declared by the recording: what its source gave has the same names (`left`, \
`calibration`, `depth`), what a node gave is `node.output`, so that `source/stereo.disparity` reads recorded disparities; `outputs` says which are \
there. `depthloom info` lists the topics of a recording.\n\n\
Frames keep id, index and time; their key is that of the recorded values, so that nothing is decoded for it. With the outputs of its source alone it \
*is* that source to everything behind it: what earlier runs made of the same frames is taken from them. Of `record: { every: n }` there are the \
frames whose values were kept. Scores, and values once a stage (models, samples), are no outputs of a source: a model is read with `{ file: PATH }`. A \
recording that was cut off gives the frames that are whole, and says so.",
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
        Ok(given(&recording, run, params)?.into_iter().map(|given| given.port).collect())
    }

    fn open(params: McapParams) -> Result<Box<dyn Source>, Fault> {
        Ok(Box::new(Self::opened(&params)?))
    }

    fn survey(params: McapParams) -> Survey {
        match Self::opened(&params) {
            Ok(source) => {
                let faults = if params.frames == FrameSelection::All { lost(&source.recording) } else { None };
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
            // A file of somebody else, or of no MCAP at all, is nothing of ours, except within a run.
            let is_recording = root.join(IN_A_RUN).is_file() || is_of_ours(&path_of(&params));
            let damaged = || Recognised::new("a recording of ours that cannot be opened", json!({ "path": root }));
            return is_recording.then(damaged).into_iter().collect();
        };
        let one = |run: &RecordedRun| {
            let what = format!("a recording of ours, stage {}", run.name());
            Recognised::new(what, json!({ "path": root, "stage": run.name() }))
        };
        recording.plan().runs.iter().map(one).collect()
    }
}

impl Mcap {
    fn opened(params: &McapParams) -> Result<Self, Fault> {
        let recording = open(params)?;
        if !recording.is_of_this_format() {
            let what = format!(
                "{} was recorded by depthloom 0.1, which may have stored values of other variants",
                recording.path().display()
            );
            return Err(Fault::new(what).remedy(
                "run its experiment again with --fresh; `depthloom report` and `depthloom info` still read it",
            ));
        }
        let run = run_of(&recording, params)?;
        let given = given(&recording, run, params)?;
        let every = usize::try_from(recording.plan().every).unwrap_or(usize::MAX).max(1);
        let recorded = recording.frames(run);
        let mut kept: Vec<FrameIndex> = FrameIndex::all(recorded.len()).step_by(every).collect();
        kept.sort_by_key(|position| recorded[*position].index);
        let known: Vec<(u64, &str)> = kept.iter().map(|at| (recorded[*at].index, &*recorded[*at].id)).collect();
        if known.is_empty() {
            let (path, stage) = (recording.path().display(), recording.plan().runs[run].name());
            let what = match recording.condition() {
                Condition::Whole => format!("{path} holds no frame of stage `{stage}`"),
                condition => format!("{path} holds no whole frame of stage `{stage}`: it is {condition}"),
            };
            return Err(Fault::new(what).remedy(
                "repeat `depthloom run` with the same --out to resume after the complete frames; `depthloom info` lists what a recording holds",
            ));
        }
        let chosen = params.frames.select(&known)?;
        let mut warnings: Vec<String> = params.frames.left_out(&known).into_iter().collect();
        if *recording.condition() != Condition::Whole {
            let path = recording.path().display();
            warnings.push(format!(
                "{path} is {}: {} frames of the stage can be read",
                recording.condition(),
                known.len()
            ));
        }
        let positions: Vec<FrameIndex> = chosen.into_iter().map(|at| kept[at]).collect();
        let frame = |position: &FrameIndex| {
            let of = &recorded[*position];
            Frame { id: of.id.clone(), index: of.index, time_ns: of.time_ns }
        };
        let frames = positions.iter().map(frame).collect();
        Ok(Self { run, given, frames, positions, warnings, recording })
    }
}

/// Whether a path is called as a recording or a run's folder is.
fn may_be_one(root: &Path) -> bool {
    root.is_file() && root.extension().is_some_and(|ending| ending == "mcap") || root.join(IN_A_RUN).is_file()
}

/// Whether a file's head names our library as its writer, whatever follows.
fn is_of_ours(path: &Path) -> bool {
    let mut head = [0; 64];
    let read = std::fs::File::open(path).and_then(|mut file| std::io::Read::read(&mut file, &mut head));
    read.is_ok_and(|count| head[..count].windows(LIBRARY.len()).any(|window| window == LIBRARY.as_bytes()))
}

/// That a recording does not hold all frames of its run.
fn lost(recording: &Recording) -> Option<Fault> {
    let is_lost = match recording.condition() {
        Condition::Whole => false,
        Condition::Unfinished { .. } | Condition::Recovered => true,
        Condition::Damaged { cut, .. } => *cut,
    };
    is_lost.then(|| {
        let what = format!("{} is {}: frames of the run are missing", recording.path().display(), recording.condition());
        Fault::new(what).remedy(
            "repeat `depthloom run` with the same --out to record them; a run reads the frames that are there, and `frames:` selects among \
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
            Fault::new(format!("{what}: its source failed when it was recorded")).remedy("leave the frame out")
        })?;
        if self.given.iter().all(|given| given.node.is_none()) {
            return Ok(of_source);
        }
        let of_node = |node: NodeId| frame.keys.iter().find(|of| of.node == node).map(|SlotKey { key, .. }| *key);
        let mut key = Key::build(KIND).number(VERSION.into());
        for given in &self.given {
            let of = given.node.map_or(Some(of_source), of_node);
            // What was not there is named by no bytes.
            key = key.text(given.port.name).bytes(of.as_ref().map_or(&[][..], |of| of.as_bytes()));
        }
        Ok(key.finish())
    }

    fn read(&self, position: FrameIndex, _: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let key = self.key(position)?;
        let topics: Vec<&str> = self.given.iter().map(|given| given.topic.as_str()).collect();
        let mut reader = self.recording.reader(self.run, &topics).map_err(fault)?;
        let values = reader.read(self.positions[position]).map_err(fault)?;
        let there = self.given.iter().zip(values).filter_map(|(given, value)| Some((given.port.name, value?)));
        let outputs = there.fold(Outputs::none(), |outputs, (port, value)| outputs.with(port, value));
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

/// What there is of a stage run and is asked for.
fn given(recording: &Recording, run: RunId, params: &McapParams) -> Result<Vec<RecordedPort>, Fault> {
    let planned = &recording.plan().runs[run];
    let variant = variant_of(recording, params)?;
    let of = |node: Option<NodeId>, name: String, output: &RecordedOutput| {
        let value_type = output.value_type().filter(|of| *of != ValueType::Scores)?;
        let doc = Port::intern(&format!("As recorded under {}.", output.topic));
        let port = Port::frame(Port::intern(&name), value_type, doc).optional();
        (output.recorded && !output.once).then(|| RecordedPort { port, topic: output.topic.clone(), node })
    };
    let mut all: Vec<RecordedPort> =
        planned.source.outputs.iter().filter_map(|output| of(None, output.port.clone(), output)).collect();
    let serves = |node: &RecordedNode| match variant {
        Some(variant) => node.variants.contains(&variant),
        None => node.variants.len() == planned.variants.len(),
    };
    for (index, node) in NodeId::enumerate(&planned.nodes).filter(|(_, node)| serves(node)) {
        let outputs = node.outputs.iter();
        let outputs = outputs.filter_map(|output| of(Some(index), format!("{}.{}", node.name, output.port), output));
        let outputs: Vec<RecordedPort> = outputs.collect();
        if outputs.iter().all(|given| all.iter().all(|known| known.port.name != given.port.name)) {
            all.extend(outputs);
        }
    }
    if params.outputs.is_empty() {
        all.retain(|given| given.node.is_none());
    } else {
        let fits = |pattern: &String, given: &RecordedPort| glob(pattern, given.port.name);
        if let Some(none) = params.outputs.iter().find(|pattern| !all.iter().any(|given| fits(pattern, given))) {
            return Err(no_output(recording, none, &all, variant.is_none()));
        }
        all.retain(|given| params.outputs.iter().any(|pattern| fits(pattern, given)));
    }
    if all.is_empty() {
        let what = format!("{} has no values of the source of stage `{}`", recording.path().display(), planned.name());
        return Err(Fault::new(what).remedy("say with `outputs` which values of its nodes are wanted"));
    }
    Ok(all)
}

fn no_output(recording: &Recording, pattern: &str, all: &[RecordedPort], of_all_variants: bool) -> Fault {
    let fault = Fault::new(format!("{} has no output `{pattern}`", recording.path().display()));
    let names = || all.iter().map(|given| given.port.name);
    let remedy = match nearest(pattern, names()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("it has {}", names().collect::<Vec<_>>().join(", ")),
    };
    match of_all_variants && recording.plan().variants.len() > 1 {
        true => fault.remedy(format!("{remedy}; what differs between variants needs `variant`")),
        false => fault.remedy(remedy),
    }
}
