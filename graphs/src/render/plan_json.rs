//! Plans as JSON, as far as they may be shown.

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use super::by_name::ByName;
use crate::plan::{self, VariantId};

/// Of `plan`: what would be run.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct Plan {
    experiment: String,
    description: String,
    variants: Vec<String>,
    /// By variant: the values of the axes of `matrix:`, as written; none without a matrix.
    factors: Vec<ByName<String>>,
    record: Record,
    /// The stages, each once for each source that variants give it.
    runs: Vec<StageRun>,
}

/// Which values are kept.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct Record {
    /// Of how many frames of a stage the first.
    every: u64,
    /// Whether maps are kept as pictures too.
    view: bool,
}

/// A stage on one source.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct StageRun {
    stage: String,
    variants: Vec<String>,
    source: Source,
    nodes: Vec<Node>,
    estimates: Vec<Estimate>,
}

/// A stage's source.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct Source {
    name: String,
    /// Those that are joined, one behind the other; usually one.
    parts: Vec<SourcePart>,
    /// By port.
    outputs: ByName<PlannedPort>,
}

/// A source, with its parameters.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct SourcePart {
    kind: String,
    version: u32,
    with: Json,
}

/// An output, and its topic.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct PlannedPort {
    #[serde(rename = "type")]
    value_type: String,
    /// `frame` or `once`.
    rate: String,
    topic: String,
    aliases: Vec<String>,
    recorded: bool,
}

/// A node, with its parameters.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct Node {
    name: String,
    kind: String,
    version: u32,
    /// `pure`, `ordered` or `once`.
    contract: String,
    does: String,
    /// Whether variants share it.
    shared: bool,
    /// Those that use it.
    variants: Vec<String>,
    node_hash: String,
    /// Its parameters, every default filled in.
    with: Json,
    /// The parameters that follow others.
    auto: Vec<String>,
    /// By port, what is wired to it.
    inputs: ByName<String>,
    /// By port.
    outputs: ByName<PlannedPort>,
}

/// What is scored.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct Estimate {
    label: String,
    name: String,
    variant: Option<String>,
    estimate: String,
    truth: String,
    /// The node that scores it.
    score: String,
}

impl plan::Plan {
    /// The plan as JSON.
    pub fn summary_json(&self) -> Plan {
        let factors = |factors: &Vec<plan::Factor>| {
            factors.iter().map(|factor| (factor.axis.clone(), factor.value.clone())).collect()
        };
        Plan {
            experiment: self.experiment.clone(),
            description: self.description.clone(),
            variants: self.variants.clone(),
            factors: self.factors.iter().map(factors).collect(),
            record: Record { every: self.record.every, view: self.record.view },
            runs: self.runs.iter().map(|run| self.run_json(run)).collect(),
        }
    }

    fn run_json(&self, run: &plan::StageRun) -> StageRun {
        let part = |part: &plan::SourcePart| SourcePart {
            kind: part.kind.clone(),
            version: part.version,
            with: part.shown.clone(),
        };
        let estimate = |estimate: &plan::Estimate| Estimate {
            label: estimate.label.clone(),
            name: estimate.name.clone(),
            variant: estimate.variant.map(|variant| self.variants[variant].clone()),
            estimate: self.slot_text(run, estimate.estimate),
            truth: self.slot_text(run, estimate.truth),
            score: run.nodes[estimate.score_node].name.clone(),
        };
        StageRun {
            stage: run.stage.clone(),
            variants: self.names(&run.variants),
            source: Source {
                name: run.source.name.clone(),
                parts: run.source.parts.iter().map(part).collect(),
                outputs: outputs_json(&run.source.outputs),
            },
            nodes: run.nodes.iter().map(|node| self.node_json(run, node)).collect(),
            estimates: run.estimates.iter().map(estimate).collect(),
        }
    }

    fn node_json(&self, run: &plan::StageRun, node: &plan::PlannedNode) -> Node {
        let input = |input: &plan::PlannedInput| Some((input.port.name.to_owned(), self.input_text(run, input)?));
        Node {
            name: node.name.clone(),
            kind: node.kind.clone(),
            version: node.version,
            contract: node.contract.name().to_owned(),
            does: "run".to_owned(),
            shared: self.is_shared(node),
            variants: self.names(&node.variants),
            node_hash: node.node_hash.to_string(),
            with: node.shown.clone(),
            auto: node.auto.clone(),
            inputs: node.inputs.iter().filter_map(input).collect(),
            outputs: outputs_json(&node.outputs),
        }
    }

    pub(super) fn names(&self, served: &[VariantId]) -> Vec<String> {
        served.iter().map(|&variant| self.variants[variant].clone()).collect()
    }
}

fn outputs_json(outputs: &[plan::PlannedOutput]) -> ByName<PlannedPort> {
    let entry = |output: &plan::PlannedOutput| {
        let port = PlannedPort {
            value_type: output.port.value_type.name().to_owned(),
            rate: output.port.rate.name().to_owned(),
            topic: output.topic.clone(),
            aliases: output.aliases.clone(),
            recorded: output.recorded,
        };
        (output.port.name.to_owned(), port)
    };
    outputs.iter().map(entry).collect()
}
