//! What is printed of experiments, data, kinds and the machine.
#![expect(dead_code, reason = "these types are the schemas of what is printed")]

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde_json::Value as Json;

use crate::commands::check_data::DataFact;
use crate::diagnostics::Error;

/// Of `data`: what a folder holds.
#[derive(JsonSchema)]
pub struct Data {
    root: String,
    /// The data sets it is; none where it is laid out as nothing that is known.
    found: Vec<DataSet>,
    /// The contact sheet that was written.
    #[schemars(skip_serializing_if = "Option::is_none")]
    sheet: Option<Option<String>>,
    /// What to paste into an experiment.
    #[schemars(skip_serializing_if = "Option::is_none")]
    stanza: Option<Option<String>>,
    /// What lies in a folder that is nothing known.
    #[schemars(skip_serializing_if = "Option::is_none")]
    contents: Option<Vec<Contents>>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// Files of one ending in a folder.
#[derive(JsonSchema)]
pub struct Contents {
    folder: String,
    ending: String,
    files: u64,
}

/// A data set.
#[derive(JsonSchema)]
pub struct DataSet {
    what: String,
    /// The kind of the source.
    kind: String,
    name: String,
    /// Its parameters.
    with: BTreeMap<String, Json>,
    /// Other ways to read it.
    alternatives: Json,
    frames: u64,
    /// How many frames were looked at.
    looked_at: u64,
    sizes: Vec<ImageSize>,
    calibration: Option<Calibration>,
    /// By port.
    truth: BTreeMap<String, Truth>,
    facts: Vec<DataFact>,
    faults: Vec<DataSetFault>,
    warnings: Vec<String>,
}

/// What is wrong with a data set.
#[derive(JsonSchema)]
pub struct DataSetFault {
    message: String,
    help: Option<String>,
}

/// Images of one size, pixels.
#[derive(JsonSchema)]
pub struct ImageSize {
    width: u32,
    height: u32,
    colour: bool,
    frames: u64,
}

/// The first calibration.
#[derive(JsonSchema)]
pub struct Calibration {
    focal_px: f64,
    cx_px: f64,
    cy_px: f64,
    baseline_m: f64,
    doffs_px: f64,
    same_for_all: bool,
    /// Whether it is no measured one.
    assumed: bool,
}

/// A truth of the frames that were looked at.
#[derive(JsonSchema)]
pub struct Truth {
    frames: u64,
    /// The share of pixels that have one.
    density: f64,
    unit: String,
    min: Option<f64>,
    median: Option<f64>,
    max: Option<f64>,
}

/// Of `onnx`: what an ONNX file takes, gives and costs.
#[derive(JsonSchema)]
pub struct Onnx {
    file: String,
    bytes: u64,
    /// The hash of its content, by which it enters keys.
    hash: String,
    producer: String,
    ir_version: i64,
    opsets: Vec<Opset>,
    inputs: Vec<Tensor>,
    outputs: Vec<Tensor>,
    metadata: BTreeMap<String, String>,
    /// How often each operator stands in it.
    operators: BTreeMap<String, u64>,
    /// Numbers in its weights.
    parameters: u64,
    /// The first file of weights that is not in its own.
    external: Option<String>,
    /// Of one run with inputs of `counted_for`; `null` where they cannot be counted.
    multiply_adds: Option<u64>,
    /// Why they cannot.
    not_counted: Option<String>,
    /// By input, the shape that multiply-adds are counted for.
    counted_for: Vec<Vec<u64>>,
    /// The kind that the stanza is of: `mono/onnx`, `stereo/onnx` or `onnx`; `null` if none runs the model.
    kind: Option<String>,
    /// YAML: the node, to put under `nodes:`; `null` if no kind runs the model.
    stanza: Option<String>,
    /// Why no kind runs the model; `null` if one does.
    refusal: Option<String>,
}

/// An operator set.
#[derive(JsonSchema)]
pub struct Opset {
    /// Empty of the standard one.
    domain: String,
    version: i64,
}

/// An input or output of a model.
#[derive(JsonSchema)]
pub struct Tensor {
    name: String,
    element: String,
    /// -1 where a side is open.
    shape: Vec<i64>,
}

/// Of `doctor`: what this machine offers.
#[derive(JsonSchema)]
pub struct Doctor {
    /// The version of the program.
    depthloom: String,
    cores: u64,
    simd: Vec<String>,
    networks: Option<Engine>,
    data: Vec<DataRoot>,
}

/// The engine of networks.
#[derive(JsonSchema)]
pub struct Engine {
    engine: String,
    version: String,
    build: Option<String>,
    path: Option<String>,
    found_by: String,
    /// Why it is not the one that was looked for first.
    instead_of: Option<String>,
    refused: Vec<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    providers: Option<Vec<String>>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    looked_at: Option<Vec<String>>,
    /// The providers that networks ran on.
    #[schemars(skip_serializing_if = "Option::is_none")]
    ran_on: Option<Vec<String>>,
}

/// A variable that names a data set's folder.
#[derive(JsonSchema)]
pub struct DataRoot {
    variable: String,
    root: Option<String>,
    found: bool,
}

/// Of `nodes`: all kinds.
#[derive(JsonSchema)]
pub struct Nodes {
    kinds: Vec<Kind>,
}

/// A kind of node or source.
#[derive(JsonSchema)]
pub struct Kind {
    kind: String,
    /// `source`, `pure`, `ordered` or `once`.
    contract: String,
    version: u32,
    summary: String,
}

/// Of `nodes KIND`: everything about one.
#[derive(JsonSchema)]
pub struct NodesKind {
    kind: String,
    /// `source`, `pure`, `ordered` or `once`.
    contract: String,
    version: u32,
    summary: String,
    /// Of a kind whose ports follow from its parameters: those below are the usual ones.
    #[schemars(skip_serializing_if = "Option::is_none")]
    own_ports: Option<bool>,
    doc: String,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    /// The JSON Schema of its parameters.
    parameters: Json,
}

/// A port.
#[derive(JsonSchema)]
pub struct Port {
    port: String,
    #[schemars(rename = "type")]
    value_type: String,
    /// `frame` or `once`.
    rate: String,
    optional: bool,
    doc: String,
}

/// Of `plan`: what would be run.
#[derive(JsonSchema)]
pub struct Plan {
    experiment: String,
    about: String,
    variants: Vec<String>,
    /// By variant: the values of the axes of `matrix:`, as written; none without a matrix.
    factors: Vec<BTreeMap<String, String>>,
    record: Record,
    /// The stages, each once for each source that variants give it.
    runs: Vec<StageRun>,
}

/// Which values are kept.
#[derive(JsonSchema)]
pub struct Record {
    /// Of how many frames of a stage the first.
    every: u64,
    /// Whether maps are kept as pictures too.
    view: bool,
}

/// A stage on one source.
#[derive(JsonSchema)]
pub struct StageRun {
    stage: String,
    variants: Vec<String>,
    source: Source,
    nodes: Vec<Node>,
    estimates: Vec<Estimate>,
}

/// A stage's source.
#[derive(JsonSchema)]
pub struct Source {
    name: String,
    /// Those that are joined, one behind the other; usually one.
    parts: Vec<SourcePart>,
    /// By port.
    outputs: BTreeMap<String, PlannedPort>,
}

/// A source, with its parameters.
#[derive(JsonSchema)]
pub struct SourcePart {
    kind: String,
    version: u32,
    with: Json,
}

/// An output, and its topic.
#[derive(JsonSchema)]
pub struct PlannedPort {
    #[schemars(rename = "type")]
    value_type: String,
    /// `frame` or `once`.
    rate: String,
    topic: String,
    aliases: Vec<String>,
    recorded: bool,
}

/// A node, with its parameters.
#[derive(JsonSchema)]
pub struct Node {
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
    recipe: String,
    /// Its parameters, every default filled in.
    with: Json,
    /// The parameters that follow others.
    auto: Vec<String>,
    /// By port, what is wired to it.
    inputs: BTreeMap<String, String>,
    /// By port.
    outputs: BTreeMap<String, PlannedPort>,
}

/// What is scored.
#[derive(JsonSchema)]
pub struct Estimate {
    label: String,
    name: String,
    variant: Option<String>,
    estimate: String,
    truth: String,
    /// The node that scores it.
    score: String,
}

/// Of `plan --reuse`: what would be taken from earlier runs.
#[derive(JsonSchema)]
pub struct PlanReuse {
    /// The run that is nearest.
    nearest: Option<String>,
    nodes: Vec<ReusedNode>,
    warnings: Vec<String>,
}

/// How often a node would run.
#[derive(JsonSchema)]
pub struct ReusedNode {
    stage: String,
    node: String,
    /// Those that use it; none where all do.
    variants: Vec<String>,
    runs: u64,
    taken: u64,
    /// Why it runs.
    why: Option<String>,
}

/// Of `graph`: boxes and arrows.
#[derive(JsonSchema)]
pub struct Graph {
    experiment: String,
    nodes: Vec<GraphNode>,
    edges: Vec<Edge>,
}

/// A box.
#[derive(JsonSchema)]
pub struct GraphNode {
    id: String,
    /// `source`, `node` or `file`.
    #[schemars(rename = "type")]
    of: String,
    name: String,
    /// Of a node.
    #[schemars(skip_serializing_if = "Option::is_none")]
    kind: Option<String>,
    /// Of a source.
    #[schemars(skip_serializing_if = "Option::is_none")]
    kinds: Option<Vec<String>>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    contract: Option<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    stage: Option<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    variants: Option<Vec<String>>,
}

/// An arrow.
#[derive(JsonSchema)]
pub struct Edge {
    from: EdgeEnd,
    to: EdgeEnd,
    /// `frame` or `once`.
    rate: String,
}

/// An end of an arrow.
#[derive(JsonSchema)]
pub struct EdgeEnd {
    id: String,
    port: Option<String>,
}
