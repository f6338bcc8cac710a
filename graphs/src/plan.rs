//! A checked, shared plan: what will be run.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use crate::contracts::{Contract, Fault, Frame, Observation, Port, Slot};
pub use crate::ids::{FrameIndex, NodeId, NodeRef, PartId, PortId, RunId, VariantId};
use crate::key::Key;
pub use crate::labels::{AxisLabels, Label, Labels};
use crate::language::glob;

/// An experiment, ready to be built and run.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The experiment's name.
    pub experiment: String,
    /// Its description.
    pub description: String,
    /// The variants' names, in the order of the file; one empty name if it declares none.
    pub variants: Vec<String>,
    /// By variant, the values of the axes of `matrix`; empty without a matrix.
    pub factors: Vec<Vec<Factor>>,
    /// The labels of estimates, variants and axes.
    pub labels: Labels,
    /// The stage runs, in the order they are executed.
    pub runs: Vec<StageRun>,
    /// What is recorded.
    pub record: Record,
    /// The files of the experiment as written: name and text, the main file first.
    pub written: Vec<(String, String)>,
    /// The experiment as resolved: `extends`, graph files, environment and `--set` applied, in YAML.
    pub resolved: String,
}

/// An axis of `matrix` and its value in a variant. `variants` multiplied by a matrix are the axis `variant`.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Factor {
    /// The axis: its name, or the suffix of its path that is used in the variant's name.
    pub axis: String,
    /// The value as written in the file, or its name there.
    pub value: String,
}

impl Factor {
    pub(crate) const VARIANT: &'static str = "variant";
}

/// What is recorded of every stage run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// Record values of every n-th frame; scores of all.
    pub every: u64,
    /// Whether maps are also kept as pictures.
    pub view: bool,
    /// Depths that are also kept as points.
    pub points: Vec<OutputPattern>,
}

/// A pattern of outputs, with `*` for any characters; the source of a stage is its node `source`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputPattern {
    /// The stage.
    pub stage: String,
    /// The node.
    pub node: String,
    /// The port.
    pub port: String,
}

impl OutputPattern {
    /// Whether an output matches.
    pub fn names(&self, stage: &str, node: &str, port: &str) -> bool {
        glob(&self.stage, stage) && glob(&self.node, node) && glob(&self.port, port)
    }
}

/// A stage on one source. A stage has several runs if variants change its source.
#[derive(Clone, Debug)]
pub struct StageRun {
    /// The stage's name.
    pub stage: String,
    /// The prefix of its topics: `/<stage>`, or `/<stage>/<variant>` where the source differs between variants.
    pub prefix: String,
    /// Where its frames come from.
    pub source: PlannedSource,
    /// The nodes, each after all those it reads. The index is the plan position.
    pub nodes: Vec<PlannedNode>,
    /// What is scored.
    pub estimates: Vec<Estimate>,
    /// The variants that this run serves.
    pub variants: Vec<VariantId>,
}

impl StageRun {
    /// All output ports: those of the source, then those of the nodes, in plan order.
    pub fn slots(&self) -> impl Iterator<Item = Slot> {
        let source = PortId::all(self.source.outputs.len()).map(|port| Slot::Source { port });
        let nodes = NodeId::enumerate(&self.nodes)
            .flat_map(|(node, planned)| PortId::all(planned.outputs.len()).map(move |port| Slot::Node { node, port }));
        source.chain(nodes)
    }

    /// The output port of a slot.
    pub fn output(&self, slot: Slot) -> &PlannedOutput {
        match slot {
            Slot::Source { port } => &self.source.outputs[port],
            Slot::Node { node, port } => &self.nodes[node].outputs[port],
        }
    }
}

/// A source of a stage run.
#[derive(Clone, Debug)]
pub struct PlannedSource {
    /// Its name under `sources:`.
    pub name: String,
    /// The sources joined, one after the other; usually one. All have the same output ports.
    pub parts: Vec<SourcePart>,
    /// The output ports.
    pub outputs: Vec<PlannedOutput>,
}

/// One of the sources joined into a stage's source.
#[derive(Clone, Debug)]
pub struct SourcePart {
    /// The source kind.
    pub kind: String,
    /// Its version.
    pub version: u32,
    /// Its parameters, resolved.
    pub params: Json,
    /// With `${NAME}` for values of environment variables: may be shown.
    pub shown: Json,
    /// With the content's hash or the last name for every path: equal on every machine, may be recorded.
    pub portable: Json,
}

/// Parts with equal parameters are equal, whether or not these come from the environment.
impl PartialEq for SourcePart {
    fn eq(&self, other: &Self) -> bool {
        (&self.kind, self.version, &self.params) == (&other.kind, other.version, &other.params)
    }
}

/// A node, shared by every variant in which it is the same.
#[derive(Clone, Debug)]
pub struct PlannedNode {
    /// Its name in the YAML file.
    pub name: String,
    /// The kind.
    pub kind: String,
    /// The kind's version.
    pub version: u32,
    /// How it is called.
    pub contract: Contract,
    /// Its parameters, with every default.
    pub params: Json,
    /// See [`SourcePart::shown`].
    pub shown: Json,
    /// See [`SourcePart::portable`].
    pub portable: Json,
    /// Its parameters that follow others ([`Auto`](crate::contracts::Auto)).
    pub auto: Vec<String>,
    /// Its input ports, in the order of the declaration.
    pub inputs: Vec<PlannedInput>,
    /// Its output ports, in the order of the declaration.
    pub outputs: Vec<PlannedOutput>,
    /// See [`Signature::observes`](crate::contracts::Signature::observes).
    pub observes: Option<Observation>,
    /// `H(kind, version, parameters, node hashes of inputs)`; in a [`ready`](crate::ready) plan, with the fingerprints
    /// of the engines of this machine.
    pub node_hash: Key,
    /// The variants that use it.
    pub variants: Vec<VariantId>,
}

impl PlannedNode {
    /// A hash of the files that the node itself reads for a frame; `None` if it reads none.
    ///
    /// # Errors
    /// The file that cannot be read.
    pub fn files_content(&self, frame: &Frame) -> Result<Option<Key>, Fault> {
        self.observes.as_ref().map_or(Ok(None), |observes| observes.content(frame))
    }

    /// The names of the variants it serves; empty if it serves all.
    pub fn variant_names<'a>(&self, plan: &'a Plan) -> Vec<&'a str> {
        if self.variants.len() == plan.variants.len() {
            return Vec::new();
        }
        self.variants.iter().map(|&v| plan.variants[v].as_str()).collect()
    }
}

/// An input port and what is wired to it.
#[derive(Clone, Debug)]
pub struct PlannedInput {
    /// The port.
    pub port: Port,
    /// Where its value comes from; `None` for an optional port left unwired.
    pub from: Option<Origin>,
    /// The path of its file with `${NAME}`, if it contains variables.
    pub shown: Option<String>,
}

impl PlannedInput {
    /// The node that it reads; `None` for the source, a file or an unwired input. `run` is the input's stage run.
    pub const fn node_read(&self, run: RunId) -> Option<NodeRef> {
        match self.from {
            Some(Origin::Here(Slot::Node { node, .. })) => Some(NodeRef { run, node }),
            Some(Origin::Once { run, node, .. }) => Some(NodeRef { run, node }),
            Some(Origin::Here(Slot::Source { .. }) | Origin::File(_)) | None => None,
        }
    }

    pub(crate) fn shown_path(&self, path: &Path) -> String {
        self.shown.clone().unwrap_or_else(|| path.display().to_string())
    }
}

/// Where a value comes from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Origin {
    /// An output of the same stage run, per frame.
    Here(Slot),
    /// A once-output of a node of this or an earlier stage run.
    Once {
        /// The stage run.
        run: RunId,
        /// The node.
        node: NodeId,
        /// The node's output port.
        port: PortId,
    },
    /// An aggregate value read from a file.
    File(PathBuf),
}

/// An output port, its topic, and whether it is recorded.
#[derive(Clone, Debug)]
pub struct PlannedOutput {
    /// The port.
    pub port: Port,
    /// The topic it is recorded under.
    pub topic: String,
    /// Its topics in variants that share it: `/<stage>/<variant>/<node>/<port>`.
    pub aliases: Vec<String>,
    /// Whether it is recorded.
    pub recorded: bool,
}

/// Something that is compared with ground truth.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// `name` if the value is the same in all variants, else `variant/name`.
    pub label: String,
    /// The estimate's name under `estimates:`.
    pub name: String,
    /// The variant; `None` if the value is the same in all.
    pub variant: Option<VariantId>,
    /// The estimated depth.
    pub estimate: Slot,
    /// The ground truth.
    pub truth: Slot,
    /// The node that computes its scores (`score/depth`).
    pub score_node: NodeId,
}
