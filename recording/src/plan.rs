//! The plan that is stored in a recording: enough to analyse it without the experiment file.

mod check;

use std::collections::BTreeMap;

use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{
    Factor, Labels, NodeId, Origin, Plan, PlannedInput, PlannedOutput, PlannedSource, PortId, RunId, StageRun,
    VariantId,
};
use depthloom_graphs::{Key, Rate, ValueType};
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

/// The plan of a recording, as stored in its metadata.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedPlan {
    /// The experiment's name.
    pub experiment: String,
    /// Its description.
    pub description: String,
    /// The variants' names, in the order of the file; one empty name if it declared none.
    pub variants: Vec<String>,
    /// By variant, the values of the axes of the experiment's `matrix`, in the order of the variant's name; empty
    /// without a matrix.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub factors: Vec<Vec<Factor>>,
    /// The labels of estimates, variants and axes.
    #[serde(default, skip_serializing_if = "Labels::is_empty")]
    pub labels: Labels,
    /// Only the first of this many frames of a stage run has its values recorded (in 0.1.0: frames whose index is a
    /// multiple of it).
    pub every: u64,
    /// Whether maps were also recorded as previews.
    pub view: bool,
    /// The stage runs, in the order of execution.
    pub runs: Vec<RecordedRun>,
}

/// A stage run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedRun {
    /// The stage's name.
    pub stage: String,
    /// The prefix of its topics.
    pub prefix: String,
    /// The variants it served.
    pub variants: Vec<VariantId>,
    /// Its source.
    pub source: RecordedSource,
    /// Its nodes, by plan position.
    pub nodes: Vec<RecordedNode>,
    /// What was scored.
    pub estimates: Vec<RecordedEstimate>,
}

/// The source of a stage run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedSource {
    /// Its name under `sources:`.
    pub name: String,
    /// The sources that are concatenated; usually one.
    pub parts: Vec<RecordedSourcePart>,
    /// Its output ports.
    pub outputs: Vec<RecordedOutput>,
}

/// One of the sources that are concatenated into a stage's source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedSourcePart {
    /// The source kind.
    pub kind: String,
    /// Its version.
    pub version: u32,
    /// Its parameters, every default filled in; paths by content or last name, so that equal runs write equal files.
    pub params: Json,
}

/// A node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedNode {
    /// Its name in the YAML file.
    pub name: String,
    /// The kind.
    pub kind: String,
    /// The kind's version.
    pub version: u32,
    /// `pure`, `ordered` or `once`.
    pub contract: String,
    /// Its parameters, every default filled in.
    pub params: Json,
    /// Its input ports and what was wired to them.
    pub inputs: Vec<RecordedInput>,
    /// Its output ports.
    pub outputs: Vec<RecordedOutput>,
    /// Its node hash.
    pub node_hash: Key,
    /// The variants that use it.
    pub variants: Vec<VariantId>,
}

/// An input port and where its value came from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedInput {
    /// The port.
    pub port: String,
    /// `topic`, `once stage.node/port` or `file name`; `None` for an optional port that is not wired.
    pub from: Option<String>,
}

/// An output port.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedOutput {
    /// The port.
    pub port: String,
    /// What it carries: the name of a [`ValueType`].
    #[serde(rename = "type")]
    pub value_type: String,
    /// Whether it has one value for the whole stage.
    pub once: bool,
    /// Its topic.
    pub topic: String,
    /// The other names of its topic, one for each variant that shares it.
    pub aliases: Vec<String>,
    /// Whether its values are in the recording.
    pub recorded: bool,
}

/// An estimate that was evaluated against ground truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedEstimate {
    /// `name` if the value is the same in all variants, else `variant/name`.
    pub label: String,
    /// The estimate's name under `estimates:`.
    pub name: String,
    /// The variant; `None` if the value is the same in all.
    pub variant: Option<VariantId>,
    /// The topic of the estimated depth; `None` if it was not recorded.
    pub estimate_topic: Option<String>,
    /// The topic of the ground truth; `None` if it was not recorded.
    pub truth_topic: Option<String>,
    /// The topic of the scores; `None` if they were not recorded.
    pub score_topic: Option<String>,
    /// The score node.
    pub score_node: NodeId,
    /// The score node's parameters (preset, pixel sets, clamp, crop), every default filled in.
    pub score_params: Json,
}

impl RecordedPlan {
    /// The recorded part of a plan: nothing that depends on the machine, the time, or the number of workers.
    #[must_use]
    pub fn from_plan(plan: &Plan) -> Self {
        Self {
            experiment: plan.experiment.clone(),
            description: plan.description.clone(),
            variants: plan.variants.clone(),
            factors: plan.factors.clone(),
            labels: plan.labels.clone(),
            every: plan.record.every,
            view: plan.record.view,
            runs: plan.runs.iter().map(|run| recorded_run(plan, run)).collect(),
        }
    }

    /// The plan as it reads from a recording: numbers may differ in the last bit.
    ///
    /// # Errors
    /// If a recording with this plan could not be read, in words.
    pub fn read_back(plan: &Plan) -> Result<Self, String> {
        Self::from_json(&json(&Self::from_plan(plan)))
    }

    /// The values of the matrix axes in a variant; empty without a matrix.
    #[must_use]
    pub fn factors_of(&self, variant: VariantId) -> &[Factor] {
        self.factors.get(variant.0).map_or(&[], Vec::as_slice)
    }

    /// The topic that each alias stands for.
    #[must_use]
    pub fn aliases(&self) -> BTreeMap<&str, &str> {
        let outputs = RunId::all(self.runs.len()).flat_map(|run| self.outputs(run));
        let aliases = outputs.flat_map(|(_, output)| output.aliases.iter().map(|alias| (alias, &output.topic)));
        aliases.filter(|(alias, topic)| alias != topic).map(|(alias, topic)| (alias.as_str(), topic.as_str())).collect()
    }

    /// All output ports of a stage run: the source's, then the nodes', in plan order.
    pub fn outputs(&self, run: RunId) -> impl Iterator<Item = (Slot, &RecordedOutput)> {
        let run = &self.runs[run];
        let source = PortId::enumerate(&run.source.outputs).map(|(port, output)| (Slot::Source { port }, output));
        let nodes = NodeId::enumerate(&run.nodes).flat_map(|(node, planned)| {
            PortId::enumerate(&planned.outputs).map(move |(port, output)| (Slot::Node { node, port }, output))
        });
        source.chain(nodes)
    }

    /// The output port recorded under a topic, or under an alias of it.
    #[must_use]
    pub fn find(&self, run: RunId, topic: &str) -> Option<(Slot, &RecordedOutput)> {
        self.outputs(run).find(|(_, output)| output.topic == topic || output.aliases.iter().any(|alias| alias == topic))
    }
}

impl RecordedRun {
    /// The name in messages: the stage, and the variant if the source differs between variants.
    #[must_use]
    pub fn name(&self) -> &str {
        self.prefix.trim_start_matches('/')
    }
}

impl RecordedOutput {
    /// What type its values have; `None` if a later version wrote a type that this version does not know.
    #[must_use]
    pub fn value_type(&self) -> Option<ValueType> {
        ValueType::from_name(&self.value_type)
    }
}

fn recorded_run(plan: &Plan, run: &StageRun) -> RecordedRun {
    let nodes = run.nodes.iter().map(|node| RecordedNode {
        name: node.name.clone(),
        kind: node.kind.clone(),
        version: node.version,
        contract: node.contract.name().to_owned(),
        params: node.portable.clone(),
        inputs: node.inputs.iter().map(|input| recorded_input(plan, run, input)).collect(),
        outputs: node.outputs.iter().map(recorded_output).collect(),
        node_hash: node.node_hash,
        variants: node.variants.clone(),
    });
    let estimates = run.estimates.iter().map(|estimate| {
        let score = &run.nodes[estimate.score_node];
        let scores = score.outputs.iter().find(|output| output.port.value_type == ValueType::Scores);
        RecordedEstimate {
            label: estimate.label.clone(),
            name: estimate.name.clone(),
            variant: estimate.variant,
            estimate_topic: recorded_topic(run.output(estimate.estimate)),
            truth_topic: recorded_topic(run.output(estimate.truth)),
            score_topic: scores.and_then(recorded_topic),
            score_node: estimate.score_node,
            score_params: score.portable.clone(),
        }
    });
    RecordedRun {
        stage: run.stage.clone(),
        prefix: run.prefix.clone(),
        variants: run.variants.clone(),
        source: recorded_source(&run.source),
        nodes: nodes.collect(),
        estimates: estimates.collect(),
    }
}

fn recorded_source(source: &PlannedSource) -> RecordedSource {
    let parts = source.parts.iter().map(|part| RecordedSourcePart {
        kind: part.kind.clone(),
        version: part.version,
        params: part.portable.clone(),
    });
    RecordedSource {
        name: source.name.clone(),
        parts: parts.collect(),
        outputs: source.outputs.iter().map(recorded_output).collect(),
    }
}

fn recorded_output(output: &PlannedOutput) -> RecordedOutput {
    RecordedOutput {
        port: output.port.name.to_owned(),
        value_type: output.port.value_type.name().to_owned(),
        once: output.port.rate == Rate::Once,
        topic: output.topic.clone(),
        aliases: output.aliases.clone(),
        recorded: output.recorded,
    }
}

fn recorded_input(plan: &Plan, run: &StageRun, input: &PlannedInput) -> RecordedInput {
    let from = input.from.as_ref().map(|from| match from {
        Origin::Here(slot) => run.output(*slot).topic.clone(),
        Origin::Once { run, node, port } => {
            let (run, node) = (&plan.runs[*run], &plan.runs[*run].nodes[*node]);
            format!("once {}.{}/{}", run.stage, node.name, node.outputs[*port].port.name)
        }
        Origin::File(path) => match (&input.shown, path.file_name()) {
            (Some(shown), _) => format!("file {shown}"),
            (None, Some(name)) => format!("file {}", name.to_string_lossy()),
            (None, None) => "file".to_owned(),
        },
    });
    RecordedInput { port: input.port.name.to_owned(), from }
}

fn recorded_topic(output: &PlannedOutput) -> Option<String> {
    output.recorded.then(|| output.topic.clone())
}

/// The JSON of a plan, or of a part of one.
pub(crate) fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plans hold nothing that JSON cannot")
}
