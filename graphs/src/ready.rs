//! A plan with opened sources and built nodes: everything that can be missing has been found.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::Value as Json;

use crate::contracts::{
    Context, Fault, Frame, Inputs, Instance, Outputs, Port, Source, SourceOutputs, StreamingSource,
};
use crate::fingerprints;
use crate::key::Key;
use crate::language::changed_since;
use crate::plan::{FrameIndex, NodeId, NodeRef, Origin, Plan, PlannedInput, PlannedNode, PlannedSource, RunId};
use crate::registry::Registry;
use crate::regular_file;
use crate::values::{Artifact, Value, ValueType};

/// A plan that can be run.
pub struct Ready {
    /// The plan, its node hashes with the fingerprints of this machine's engines.
    pub plan: Plan,
    /// By stage run.
    pub runs: Vec<ReadyRun>,
    /// The aggregate values that come from files, by path.
    pub files: BTreeMap<PathBuf, Value>,
    /// Warnings of the sources, each once, with the source's name.
    pub warnings: Vec<String>,
    /// By node, how to build another instance, for the audit.
    pub builders: BTreeMap<NodeRef, NodeBuilder>,
}

/// Builds another instance of a node.
#[derive(Clone, Debug)]
pub struct NodeBuilder {
    build: fn(&Json) -> Result<Instance, Fault>,
    params: Json,
}

impl NodeBuilder {
    /// Another instance of the node.
    ///
    /// # Errors
    /// As [`Node::build`](crate::Node::build).
    pub fn build(&self) -> Result<Instance, Fault> {
        (self.build)(&self.params)
    }
}

/// The source and nodes of a stage run.
pub struct ReadyRun {
    /// Its source, opened.
    pub source: Box<dyn Source>,
    /// Its nodes, in plan order.
    pub nodes: Vec<Instance>,
}

/// Why a plan cannot be run on this machine, with this data.
#[derive(Debug, thiserror::Error)]
pub enum NotReady {
    /// A source could not be opened.
    #[error("source `{name}` ({kind})")]
    Source {
        /// Its name under `sources:`.
        name: String,
        /// Its kind.
        kind: String,
        /// What is wrong.
        #[source]
        fault: Fault,
    },
    /// A node could not be built.
    #[error("node `{stage}.{name}` ({kind})")]
    Node {
        /// Its stage.
        stage: String,
        /// Its name.
        name: String,
        /// Its kind.
        kind: String,
        /// What is wrong.
        #[source]
        fault: Fault,
    },
    /// An aggregate value's file could not be read.
    #[error("input `{port}` of node `{stage}.{name}`")]
    File {
        /// The node's stage.
        stage: String,
        /// The node's name.
        name: String,
        /// The input port.
        port: &'static str,
        /// What is wrong.
        #[source]
        fault: Fault,
    },
}

impl NotReady {
    /// The cause.
    pub const fn fault(&self) -> &Fault {
        match self {
            Self::Source { fault, .. } | Self::Node { fault, .. } | Self::File { fault, .. } => fault,
        }
    }
}

impl Ready {
    /// Opens the sources, builds the nodes and reads the files of a plan.
    ///
    /// # Errors
    /// Everything that is missing, in plan order.
    pub fn new(plan: Plan, registry: &Registry) -> Result<Self, Vec<NotReady>> {
        Self::opened(plan, registry, |_, source| open(source, registry))
    }

    /// As [`Ready::new`], for a plan with a stage whose frames arrive by themselves. Its source in the result has no
    /// frames; the frames come from the second value.
    ///
    /// # Errors
    /// As [`Ready::new`].
    pub fn live(plan: Plan, registry: &Registry, live: RunId) -> Result<(Self, LiveInput), Vec<NotReady>> {
        let mut input = None;
        let ready = Self::opened(plan, registry, |run, source| {
            if run != live {
                return open(source, registry);
            }
            input = Some(open_live(source, registry)?);
            Ok(Box::new(NoFrames))
        })?;
        match input {
            Some(input) => Ok((ready, input)),
            None => unreachable!("the stage to run live is one of the plan's"),
        }
    }

    fn opened(
        plan: Plan,
        registry: &Registry,
        mut open: impl FnMut(RunId, &PlannedSource) -> Result<Box<dyn Source>, Box<NotReady>>,
    ) -> Result<Self, Vec<NotReady>> {
        let mut missing = Vec::new();
        let mut files = BTreeMap::new();
        let mut prints = BTreeMap::new();
        let mut runs = Vec::with_capacity(plan.runs.len());
        for (run_id, run) in RunId::enumerate(&plan.runs) {
            let source = open(run_id, &run.source).map_err(|error| missing.push(*error)).ok();
            let mut nodes = Vec::with_capacity(run.nodes.len());
            for node in NodeId::all(run.nodes.len()) {
                let node = NodeRef { run: run_id, node };
                match build(&plan, node, registry, &mut files) {
                    Ok((instance, fingerprint)) => {
                        prints.extend(fingerprint.map(|key| (node, key)));
                        nodes.push(instance);
                    }
                    Err(errors) => missing.extend(errors),
                }
            }
            if let Some(source) = source {
                runs.push(ReadyRun { source, nodes });
            }
        }
        if !missing.is_empty() {
            return Err(missing);
        }
        let builders = builders(&plan, registry);
        Ok(Self { builders, ..Self::from_parts(plan, runs, files, &prints) })
    }

    /// A plan whose sources and nodes come from elsewhere; `fingerprints` by node.
    pub fn from_parts(
        mut plan: Plan,
        runs: Vec<ReadyRun>,
        files: BTreeMap<PathBuf, Value>,
        fingerprints: &BTreeMap<NodeRef, Key>,
    ) -> Self {
        fingerprints::add(&mut plan, fingerprints);
        let mut warnings: Vec<String> = Vec::new();
        for (run, ready) in plan.runs.iter().zip(&runs) {
            let source_warnings =
                ready.source.warnings().iter().map(|what| format!("source `{}`: {what}", run.source.name));
            for warning in source_warnings {
                if !warnings.contains(&warning) {
                    warnings.push(warning);
                }
            }
        }
        Self { plan, runs, files, warnings, builders: BTreeMap::new() }
    }
}

fn builders(plan: &Plan, registry: &Registry) -> BTreeMap<NodeRef, NodeBuilder> {
    let mut builders = BTreeMap::new();
    for (run, planned) in RunId::enumerate(&plan.runs) {
        for (node, planned) in NodeId::enumerate(&planned.nodes) {
            let Some(kind) = registry.node_kind(&planned.kind) else { continue };
            let builder = NodeBuilder { build: kind.build, params: planned.params.clone() };
            builders.insert(NodeRef { run, node }, builder);
        }
    }
    builders
}

/// Builds a node. Reads the files among its inputs into `files`. Returns the fingerprint of its engine, if that
/// decides its results.
///
/// # Errors
/// Everything that is missing.
pub fn build(
    plan: &Plan,
    node: NodeRef,
    registry: &Registry,
    files: &mut BTreeMap<PathBuf, Value>,
) -> Result<(Instance, Option<Key>), Vec<NotReady>> {
    let run = &plan.runs[node.run];
    let node = &run.nodes[node.node];
    let at_node =
        |fault| NotReady::Node { stage: run.stage.clone(), name: node.name.clone(), kind: node.kind.clone(), fault };
    let built =
        registry.node_kind(&node.kind).ok_or_else(|| Fault::new("this engine has no such kind")).and_then(|kind| {
            let built = (kind.build(&node.params)?, (kind.fingerprint)(&node.params)?);
            // The node hash has the contents as they were when the experiment was loaded.
            match changed_since(&node.portable, &node.params, &kind.schema) {
                None => Ok(built),
                Some(name) => {
                    let what = format!("what `{name}` names changed since the experiment was loaded");
                    Err(Fault::new(what).remedy("run again"))
                }
            }
        });
    let mut missing = read_files(&run.stage, node, files);
    let built = built.map_err(|fault| missing.push(at_node(fault))).ok();
    if let Some((instance, _)) = &built
        && missing.is_empty()
        && let Err(fault) = show_files(instance, node, files)
    {
        missing.push(at_node(fault));
    }
    built.filter(|_| missing.is_empty()).ok_or(missing)
}

/// Reads the files among a node's inputs; returns what cannot be read.
pub fn read_files(stage: &str, node: &PlannedNode, files: &mut BTreeMap<PathBuf, Value>) -> Vec<NotReady> {
    let mut missing = Vec::new();
    for input in &node.inputs {
        let Some(Origin::File(path)) = &input.from else { continue };
        if files.contains_key(path) {
            continue;
        }
        match read_aggregate_value(path, input.port.value_type) {
            Ok(value) => {
                files.insert(path.clone(), value);
            }
            Err(fault) => missing.push(NotReady::File {
                stage: stage.to_owned(),
                name: node.name.clone(),
                port: input.port.name,
                fault,
            }),
        }
    }
    missing
}

/// Checks aggregate values from files before any frame.
fn show_files(instance: &Instance, node: &PlannedNode, files: &BTreeMap<PathBuf, Value>) -> Result<(), Fault> {
    let value = |input: &PlannedInput| match &input.from {
        Some(Origin::File(path)) => files.get(path).cloned(),
        _ => None,
    };
    let values: Vec<Option<Value>> = node.inputs.iter().map(value).collect();
    if values.iter().all(Option::is_none) {
        return Ok(());
    }
    let ports: Vec<Port> = node.inputs.iter().map(|input| input.port.clone()).collect();
    instance.prepare(&Inputs::new(&ports, &values)).map_err(|fault| {
        let chain = fault.chain();
        let paths = node.inputs.iter().filter_map(|input| match &input.from {
            Some(Origin::File(path)) => Some(path.display().to_string()),
            _ => None,
        });
        let paths: Vec<String> = paths.filter(|path| !chain.contains(path)).collect();
        match paths.as_slice() {
            [path] => fault.map_what(|what| format!("{path}: {what}")),
            _ => fault,
        }
    })
}

/// ONNX's own limit.
const MOST_BYTES: u64 = 2 << 30;

fn read_aggregate_value(path: &Path, value_type: ValueType) -> Result<Value, Fault> {
    let bytes = regular_file::read(path, MOST_BYTES)
        .map_err(|error| Fault::new(format!("failed to read {}", path.display())).because(error))?;
    Artifact::of_type(value_type, bytes)
        .ok_or_else(|| Fault::new(format!("a value of type {value_type} cannot be read from a file")))
}

/// Where the frames of a live stage come from.
pub enum LiveInput {
    /// A stream.
    Stream(Box<dyn StreamingSource>),
    /// A source whose frames can be listed, to be played at a rate.
    Listed(Box<dyn Source>),
}

/// The source of a live stage, until its frames arrive.
struct NoFrames;

impl Source for NoFrames {
    fn frames(&self) -> &[Frame] {
        &[]
    }

    fn key(&self, _position: FrameIndex) -> Result<Key, Fault> {
        Err(Fault::new("a stream has no frames in advance"))
    }

    fn read(&self, position: FrameIndex, _ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let key = self.key(position)?;
        Ok(SourceOutputs { outputs: Outputs::none(), key })
    }
}

fn open_live(source: &PlannedSource, registry: &Registry) -> Result<LiveInput, Box<NotReady>> {
    if let [part] = source.parts.as_slice()
        && let Some(kind) = registry.source_kind(&part.kind)
    {
        let (name, kind_name) = (source.name.clone(), part.kind.clone());
        let stream = kind.stream(&part.params);
        let stream = stream.map_err(|fault| Box::new(NotReady::Source { name, kind: kind_name, fault }))?;
        if let Some(stream) = stream {
            return Ok(LiveInput::Stream(stream));
        }
    }
    open(source, registry).map(LiveInput::Listed)
}

/// Opens a stage's source.
///
/// # Errors
/// What is missing, with the kind of the part at fault.
pub fn open(source: &PlannedSource, registry: &Registry) -> Result<Box<dyn Source>, Box<NotReady>> {
    let mut parts = Vec::with_capacity(source.parts.len());
    for part in &source.parts {
        let opened = registry
            .source_kind(&part.kind)
            .ok_or_else(|| Fault::new("this engine has no such kind"))
            .and_then(|kind| kind.open(&part.params));
        let (name, kind) = (source.name.clone(), part.kind.clone());
        parts.push(opened.map_err(|fault| Box::new(NotReady::Source { name, kind, fault }))?);
    }
    match parts.pop() {
        Some(only) if parts.is_empty() => Ok(only),
        last => {
            parts.extend(last);
            Ok(Box::new(Joined::new(parts)))
        }
    }
}

/// Indices and times continue after those of the source before.
struct Joined {
    parts: Vec<Box<dyn Source>>,
    frames: Vec<Frame>,
    places: Vec<(usize, FrameIndex)>,
    warnings: Vec<String>,
}

impl Joined {
    fn new(parts: Vec<Box<dyn Source>>) -> Self {
        let warnings = parts.iter().flat_map(|part| part.warnings()).cloned().collect();
        let (mut frames, mut places): (Vec<Frame>, Vec<_>) = (Vec::new(), Vec::new());
        for (part, source) in parts.iter().enumerate() {
            let first_index = frames.last().map_or(0, |f| f.index + 1);
            let first_time = frames.last().map_or(0, |f| f.time_ns + 100_000_000);
            let own_time = source.frames().first().map_or(0, |f| f.time_ns);
            for (position, frame) in FrameIndex::enumerate(source.frames()) {
                let (index, time_ns) = match part {
                    0 => (frame.index, frame.time_ns),
                    _ => (first_index + position.0 as u64, first_time + frame.time_ns.saturating_sub(own_time)),
                };
                frames.push(Frame { id: frame.id.clone(), index, time_ns });
                places.push((part, position));
            }
        }
        Self { parts, frames, places, warnings }
    }
}

impl Source for Joined {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        let (part, position) = self.places[position];
        self.parts[part].key(position)
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let (part, position) = self.places[position];
        self.parts[part].read(position, ctx)
    }

    fn files(&self, position: FrameIndex) -> Vec<(&'static str, PathBuf)> {
        let (part, position) = self.places[position];
        self.parts[part].files(position)
    }
}
