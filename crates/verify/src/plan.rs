//! The plan of a replay: the requested nodes, with inputs from the recording, for the runner.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, Instance, Port, Signature, Slot};
use depthloom_graphs::language::glob;
use depthloom_graphs::plan::{
    NodeId, NodeRef, Origin, Plan, PlannedInput, PlannedNode, PlannedOutput, PlannedSource, PortId, Record, RunId,
    StageRun, VariantId,
};
use depthloom_graphs::ready::{Ready, ReadyRun};
use depthloom_graphs::registry::{NodeKind, ParamError};
use depthloom_graphs::{Rate, Registry, Value};
use depthloom_recording::{
    Condition, RecordedAggregate, RecordedContent, RecordedInput, RecordedNode, RecordedOutput, RecordedWindow,
    Recording,
};

use crate::guard::Failures;
use crate::source::RecordedFrames;

/// The nodes that are recomputed, and what they are compared with.
pub struct Replay {
    /// The plan with its nodes built; its stage runs are the recording's.
    pub ready: Ready,
    /// By stage run and node of that plan.
    pub nodes: Vec<Vec<Replayed>>,
    /// The requested nodes that cannot be recomputed.
    pub unchecked: Vec<Unchecked>,
    /// The failures of nodes while they are recomputed.
    pub failures: Failures,
}

/// A node that is recomputed.
pub struct Replayed {
    /// The node of the recording.
    pub recorded: NodeId,
    /// By output port, what it is compared with; `None` if nothing was recorded, or the node only provides inputs for
    /// others.
    pub expected: Vec<Option<Expected>>,
    /// Remarks about it for the report.
    pub remarks: Vec<String>,
}

/// What an output is compared with.
pub enum Expected {
    /// The values at that port of the source.
    Frames {
        /// The source's port.
        port: PortId,
    },
    /// An aggregate value of the recording.
    Once {
        /// The aggregate value; `None` if it is known that there was none.
        value: Option<RecordedAggregate>,
    },
}

enum Baseline {
    Frames,
    Once(Option<RecordedAggregate>),
}

/// A node that cannot be recomputed.
pub struct Unchecked {
    /// The node of the recording.
    pub node: NodeRef,
    /// Why, as a lower-case fragment.
    pub why: String,
    /// Whether the recording is damaged where it would have to be read.
    pub is_damage: bool,
}

struct Obstacle {
    why: String,
    is_damage: bool,
}

impl From<String> for Obstacle {
    fn from(why: String) -> Self {
        Self { why, is_damage: false }
    }
}

enum Feed {
    Nothing,
    Topic(String),
    Recorded(RecordedAggregate),
    /// An output of a node that is recomputed too.
    Made {
        node: NodeRef,
        port: PortId,
    },
}

struct Builder<'a> {
    recording: &'a Recording,
    registry: &'a Registry,
    /// By node, why it cannot be recomputed; `None` if it can.
    known: HashMap<NodeRef, Option<String>>,
    runs: Vec<MadeRun>,
    files: BTreeMap<PathBuf, Value>,
    failures: Failures,
}

#[derive(Default)]
struct MadeRun {
    topics: Vec<&'static str>,
    planned: Vec<PlannedNode>,
    built: Vec<Instance>,
    nodes: Vec<Replayed>,
}

impl Replay {
    /// The nodes of a recording whose names match one of the patterns, or all with recorded outputs; nothing is
    /// computed yet.
    ///
    /// # Errors
    /// The first pattern that matches no node.
    pub fn new(recording: &Arc<Recording>, registry: &Registry, patterns: &[String]) -> Result<Self, String> {
        let recorded = recording.plan();
        let mut making = Builder {
            recording,
            registry,
            known: HashMap::new(),
            runs: recorded.runs.iter().map(|_| MadeRun::default()).collect(),
            files: BTreeMap::new(),
            failures: Failures::default(),
        };
        let mut unchecked = Vec::new();
        for node in requested(recording, patterns)? {
            if let Err(Obstacle { why, is_damage }) = making.check(node) {
                unchecked.push(Unchecked { node, why, is_damage });
            }
        }
        let Builder { runs, files, failures, .. } = making;
        let (mut planned, mut ready, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
        for (run, made) in RunId::enumerate(runs) {
            let recorded_run = &recorded.runs[run];
            let outputs = made.topics.iter().map(|topic| source_output(recording, run, topic)).collect();
            planned.push(StageRun {
                stage: recorded_run.stage.clone(),
                prefix: recorded_run.prefix.clone(),
                source: PlannedSource { name: recorded_run.source.name.clone(), parts: Vec::new(), outputs },
                nodes: made.planned,
                estimates: Vec::new(),
                variants: recorded_run.variants.clone(),
            });
            let source = Box::new(RecordedFrames::new(Arc::clone(recording), run, made.topics));
            ready.push(ReadyRun { source, nodes: made.built });
            nodes.push(made.nodes);
        }
        let plan = Plan {
            experiment: recorded.experiment.clone(),
            description: recorded.description.clone(),
            variants: recorded.variants.clone(),
            factors: recorded.factors.clone(),
            labels: recorded.labels.clone(),
            runs: planned,
            record: Record { every: 1, view: false, points: Vec::new() },
            written: Vec::new(),
            resolved: String::new(),
        };
        Ok(Self {
            ready: Ready { plan, runs: ready, files, warnings: Vec::new(), builders: BTreeMap::new() },
            nodes,
            unchecked,
            failures,
        })
    }
}

/// The nodes that patterns name: `stereo`, `compare.stereo`, `compare.*`; without patterns all with recorded outputs.
fn requested(recording: &Recording, patterns: &[String]) -> Result<BTreeSet<NodeRef>, String> {
    let mut requested = BTreeSet::new();
    let mut unmatched: BTreeSet<&String> = patterns.iter().collect();
    for (run, recorded_run) in RunId::enumerate(&recording.plan().runs) {
        for (node, recorded) in NodeId::enumerate(&recorded_run.nodes) {
            let name = format!("{}.{}", recorded_run.stage, recorded.name);
            let matching = patterns.iter().filter(|pattern| glob(pattern, &recorded.name) || glob(pattern, &name));
            let matched = matching.map(|pattern| unmatched.remove(pattern)).count() > 0;
            if matched || patterns.is_empty() && recorded.outputs.iter().any(|output| output.recorded) {
                requested.insert(NodeRef { run, node });
            }
        }
    }
    match patterns.iter().find(|pattern| unmatched.contains(pattern)) {
        Some(pattern) => Err(pattern.clone()),
        None => Ok(requested),
    }
}

impl<'a> Builder<'a> {
    fn check(&mut self, node: NodeRef) -> Result<(), Obstacle> {
        let recorded = self.node(node);
        let expected: Vec<_> = PortId::all(recorded.outputs.len()).map(|port| self.expected(node, port)).collect();
        if expected.iter().all(Option::is_none) {
            return Err("none of its values are in the recording".to_owned().into());
        }
        if let Some(why) = self.obstacle(node) {
            return Err(why.into());
        }
        let index = self.add(node)?;
        let made = &mut self.runs[node.run];
        for (recorded, expected) in recorded.outputs.iter().zip(expected) {
            let mut outputs = made.planned[index].outputs.iter();
            let Some(port) = outputs.position(|output| output.port.name == recorded.port) else { continue };
            made.planned[index].outputs[port].recorded = expected.is_some();
            made.nodes[index].expected[port] = expected.map(|expected| match expected {
                Baseline::Frames => Expected::Frames { port: made.topic(&recorded.topic) },
                Baseline::Once(value) => Expected::Once { value },
            });
        }
        Ok(())
    }

    /// The recorded values of an output.
    fn expected(&self, node: NodeRef, port: PortId) -> Option<Baseline> {
        let output = &self.node(node).outputs[port];
        if !output.recorded {
            return None;
        }
        if !output.once {
            return Some(Baseline::Frames);
        }
        let value = self.aggregate_value(node, port).cloned();
        // A value that is missing in an interrupted recording may have existed.
        (value.is_some() || *self.recording.condition() == Condition::Complete).then_some(Baseline::Once(value))
    }

    fn aggregate_value(&self, node: NodeRef, port: PortId) -> Option<&'a RecordedAggregate> {
        let matches_port = |once: &&RecordedAggregate| (once.run, once.node, once.port) == (node.run, node.node, port);
        self.recording.aggregate_values().iter().find(matches_port)
    }

    fn node(&self, node: NodeRef) -> &'a RecordedNode {
        &self.recording.plan().runs[node.run].nodes[node.node]
    }

    /// Why a node cannot be recomputed; `None` if it can.
    fn obstacle(&mut self, node: NodeRef) -> Option<String> {
        if let Some(known) = self.known.get(&node) {
            return known.clone();
        }
        let obstacle = self.obstacle_of(node).err();
        self.known.insert(node, obstacle.clone());
        obstacle
    }

    fn obstacle_of(&mut self, node: NodeRef) -> Result<(), String> {
        let recorded = self.node(node);
        let kind = self.kind(recorded)?;
        let params = kind.resolve(&recorded.params).map_err(|error| misfit(recorded, &error))?;
        let signature = kind.signature(&params).map_err(|fault| fault.chain())?;
        fits(&signature, recorded)?;
        if signature.contract == Contract::Ordered && self.recording.plan().every > 1 {
            let every = self.recording.plan().every;
            return Err(format!("it reads every frame, but the recording has the values of only one in {every}"));
        }
        let windows = self.recording.windows();
        if signature.contract != Contract::Pure && !windows.is_empty() {
            match windows.iter().find(|window| window.run == node.run) {
                None => return Err("it reads the frames of its stage, which are not in the recording".to_owned()),
                Some(RecordedWindow { first, .. }) if first.0 > 0 => {
                    return Err(format!(
                        "it reads every frame, but the recording starts with the frame at position {first}"
                    ));
                }
                Some(_) => {}
            }
        }
        for input in &recorded.inputs {
            self.feed(node, input).map_err(|why| format!("input `{}` {why}", input.port))?;
        }
        Ok(())
    }

    fn kind(&self, recorded: &RecordedNode) -> Result<&'a NodeKind, String> {
        let kind = self.registry.node_kind(&recorded.kind);
        kind.ok_or_else(|| format!("this version has no kind `{}`", recorded.kind))
    }

    /// The origin of an input, or why it is not available.
    fn feed(&mut self, reader: NodeRef, input: &RecordedInput) -> Result<Feed, String> {
        let Some(from) = &input.from else { return Ok(Feed::Nothing) };
        if let Some(file) = from.strip_prefix("file") {
            return Err(format!("was the file `{}`, which is not in the recording", file.trim()));
        }
        let (node, port) = match from.strip_prefix("once ") {
            Some(from) => self.aggregate_output(from, &self.node(reader).variants)?,
            None => match self.recording.plan().outputs(reader.run).find(|(_, output)| output.topic == *from) {
                Some((_, output)) if output.recorded => return Ok(Feed::Topic(from.clone())),
                Some((Slot::Node { node, port }, _)) => (NodeRef { run: reader.run, node }, port),
                Some((Slot::Source { .. }, _)) | None => {
                    return Err(format!("was {from}, which is not in the recording"));
                }
            },
        };
        if let Some(once) = self.aggregate_value(node, port)
            && matches!(once.content, RecordedContent::Attachment { .. })
        {
            return Ok(Feed::Recorded(once.clone()));
        }
        match self.obstacle(node) {
            None => Ok(Feed::Made { node, port }),
            Some(why) => {
                let name = &self.node(node).name;
                Err(format!(
                    "was of node `{name}`, whose values are neither in the recording nor can be recomputed: {why}"
                ))
            }
        }
    }

    /// The output whose aggregate value a node of these variants read: of several nodes with that name, the one that
    /// served all of them.
    fn aggregate_output(&self, from: &str, variants: &[VariantId]) -> Result<(NodeRef, PortId), String> {
        let mut found = Vec::new();
        for (run_id, run) in RunId::enumerate(&self.recording.plan().runs) {
            for (id, node) in NodeId::enumerate(&run.nodes) {
                let of_port = |output: &RecordedOutput| format!("{}.{}/{}", run.stage, node.name, output.port) == from;
                if let Some(port) = node.outputs.iter().position(of_port)
                    && variants.iter().all(|variant| node.variants.contains(variant))
                {
                    found.push((NodeRef { run: run_id, node: id }, PortId(port)));
                }
            }
        }
        match found.as_slice() {
            [one] => Ok(*one),
            [] => Err(format!("was {from}, which the recording's plan does not have")),
            _ => Err(format!("was {from}, and several nodes of that name serve its variants")),
        }
    }

    /// Adds a node and the nodes that it reads whose values are not recorded. Returns its index in the plan.
    fn add(&mut self, node: NodeRef) -> Result<NodeId, Obstacle> {
        if let Some(index) = self.runs[node.run].nodes.iter().position(|made| made.recorded == node.node) {
            return Ok(NodeId(index));
        }
        let recorded = self.node(node);
        let kind = self.kind(recorded)?;
        let version = kind.declaration.version;
        let mut remarks = Vec::new();
        if version != recorded.version {
            remarks
                .push(format!("recorded by version {} of its kind, recomputed by version {version}", recorded.version));
        }
        let params = kind.resolve(&recorded.params).map_err(|error| misfit(recorded, &error))?;
        let signature = kind.signature(&params).map_err(|fault| Obstacle::from(fault.chain()))?;
        let mut inputs = Vec::with_capacity(signature.inputs.len());
        for port in &signature.inputs {
            let wired = recorded.inputs.iter().find(|input| input.port == port.name);
            let feed = match wired.map_or(Ok(Feed::Nothing), |input| self.feed(node, input))? {
                Feed::Nothing => repeated(recorded, port),
                feed => feed,
            };
            if let Feed::Made { node, .. } = &feed {
                remarks.push(format!("reads `{}` recomputed, which is not recorded", self.node(*node).name));
            }
            inputs.push(PlannedInput { port: port.clone(), from: self.origin(node.run, feed)?, shown: None });
        }
        let built = kind.build(&params).map_err(|fault| Obstacle::from(fault.chain()))?;
        let is_guarded = signature.contract != Contract::Pure;
        let output = |port: &Port| {
            let topic = recorded.outputs.iter().find(|output| output.port == port.name);
            let topic = topic.map(|output| output.topic.clone()).unwrap_or_default();
            // A node that failed has no outputs.
            let port = if is_guarded { port.clone().optional() } else { port.clone() };
            PlannedOutput { port, topic, aliases: Vec::new(), recorded: false }
        };
        let outputs: Vec<PlannedOutput> = signature.outputs.iter().map(output).collect();
        let expected = outputs.iter().map(|_| None).collect();
        let made = &mut self.runs[node.run];
        let added = NodeId(made.built.len());
        let built = self.failures.guard(NodeRef { run: node.run, node: added }, built, &signature.outputs);
        made.planned.push(PlannedNode {
            name: recorded.name.clone(),
            kind: recorded.kind.clone(),
            version,
            contract: signature.contract,
            shown: recorded.params.clone(),
            portable: recorded.params.clone(),
            params,
            auto: Vec::new(),
            inputs,
            outputs,
            observes: signature.observes,
            // It distinguishes the node from others of the plan, as the runner requires.
            node_hash: recorded.node_hash,
            variants: recorded.variants.clone(),
        });
        made.built.push(built);
        made.nodes.push(Replayed { recorded: node.node, expected, remarks });
        Ok(added)
    }

    fn origin(&mut self, run: RunId, feed: Feed) -> Result<Option<Origin>, Obstacle> {
        Ok(match feed {
            Feed::Nothing => None,
            Feed::Topic(topic) => Some(Origin::Here(Slot::Source { port: self.runs[run].topic(&topic) })),
            Feed::Made { node, port } => {
                let recorded = &self.node(node).outputs[port];
                let index = self.add(node)?;
                let mut outputs = self.runs[node.run].planned[index].outputs.iter();
                let port = outputs.position(|output| output.port.name == recorded.port).map(PortId);
                let port = port.ok_or_else(|| format!("its kind has no output `{}` any more", recorded.port))?;
                Some(if recorded.once {
                    Origin::Once { run: node.run, node: index, port }
                } else {
                    Origin::Here(Slot::Node { node: index, port })
                })
            }
            Feed::Recorded(once) => {
                let name = PathBuf::from(format!("{}.{}.{}", once.run, once.node, once.port));
                if !self.files.contains_key(&name) {
                    let value = self.recording.aggregate_value(&once);
                    let value = value.map_err(|error| Obstacle { why: error.to_string(), is_damage: true })?;
                    self.files.insert(name.clone(), value);
                }
                Some(Origin::File(name))
            }
        })
    }
}

impl MadeRun {
    fn topic(&mut self, topic: &str) -> PortId {
        let known = self.topics.iter().position(|known| *known == topic);
        PortId(known.unwrap_or_else(|| {
            self.topics.push(Port::intern(topic));
            self.topics.len() - 1
        }))
    }
}

/// The recorded output that an unwired input repeats.
fn repeated(recorded: &RecordedNode, input: &Port) -> Feed {
    let output = recorded.outputs.iter().find(|output| Some(output.port.as_str()) == input.repeats);
    let output = output.filter(|output| output.recorded && !output.once);
    output.map_or(Feed::Nothing, |output| Feed::Topic(output.topic.clone()))
}

/// Whether a node still fits its kind, by contract and ports.
fn fits(declared: &Signature, recorded: &RecordedNode) -> Result<(), String> {
    if declared.contract.name() != recorded.contract {
        return Err(format!("its kind is {} now, and was {}", declared.contract.name(), recorded.contract));
    }
    let is_wired = |port: &Port| recorded.inputs.iter().any(|input| input.port == port.name && input.from.is_some());
    if let Some(port) = declared.inputs.iter().find(|port| !port.optional && !is_wired(port)) {
        return Err(format!("its kind now needs an input `{}`, which was not wired", port.name));
    }
    let is_known = |input: &RecordedInput| declared.inputs.iter().any(|port| port.name == input.port);
    if let Some(input) = recorded.inputs.iter().find(|input| input.from.is_some() && !is_known(input)) {
        return Err(format!("its kind has no input `{}` any more", input.port));
    }
    for output in recorded.outputs.iter().filter(|output| output.recorded) {
        let port = declared.outputs.iter().find(|port| port.name == output.port);
        let port = port.ok_or_else(|| format!("its kind has no output `{}` any more", output.port))?;
        if port.value_type.name() != output.value_type || (port.rate == Rate::Once) != output.once {
            return Err(format!("output `{}` is {} now, and was {}", output.port, port.value_type, output.value_type));
        }
    }
    Ok(())
}

/// Why a kind does not accept the recorded parameters.
fn misfit(recorded: &RecordedNode, error: &ParamError) -> String {
    let name = error.path.join(".");
    let at = error
        .path
        .iter()
        .try_fold(&recorded.params, |at, key| at.get(key).or_else(|| at.get(key.parse::<usize>().ok()?)));
    match at.and_then(|at| at.as_object()) {
        Some(file) if file.contains_key("content") || file.contains_key("name") => {
            format!("parameter `{name}` was a file, which is not in the recording")
        }
        _ => format!("its kind does not take the recorded parameters: `{name}`: {}", error.what),
    }
}

fn source_output(recording: &Recording, run: RunId, topic: &'static str) -> PlannedOutput {
    let found = recording.plan().find(run, topic).and_then(|(_, output)| output.value_type());
    let value_type = found.expect("a topic was found in the plan before, whose types were checked");
    let port = Port::frame(topic, value_type, "As recorded.").optional();
    PlannedOutput { port, topic: topic.to_owned(), aliases: Vec::new(), recorded: true }
}
