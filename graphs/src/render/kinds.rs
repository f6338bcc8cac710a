//! Kinds as JSON, for programs.

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use crate::contracts;
use crate::registry::{KindInfo, NodeKind, Registry, SourceEntry};

/// Of `nodes`: all kinds.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct Nodes {
    kinds: Vec<Kind>,
}

/// A kind of node or source.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct Kind {
    kind: String,
    /// `source`, `pure`, `ordered` or `once`.
    contract: String,
    version: u32,
    summary: String,
}

/// Of `nodes KIND`: everything about one.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct NodesKind {
    kind: String,
    /// `source`, `pure`, `ordered` or `once`.
    contract: String,
    version: u32,
    summary: String,
    /// Of a kind whose ports follow from its parameters: those below are the usual ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    own_ports: Option<bool>,
    doc: String,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    /// The JSON Schema of its parameters.
    parameters: Json,
}

/// A port.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct Port {
    port: String,
    #[serde(rename = "type")]
    value_type: String,
    /// `frame` or `once`.
    rate: String,
    optional: bool,
    doc: String,
}

/// All kinds; the contract of a source is `source`.
pub fn kinds_json(registry: &Registry) -> Nodes {
    let sources = registry.sources().map(SourceEntry::info);
    let kind = |info: KindInfo<'_>| Kind {
        kind: info.kind.to_owned(),
        contract: info.contract_name().to_owned(),
        version: info.version,
        summary: info.summary.to_owned(),
    };
    Nodes { kinds: sources.chain(registry.nodes().map(NodeKind::info)).map(kind).collect() }
}

/// Everything about one kind; `None` if there is no such kind.
pub fn kind_json(registry: &Registry, kind: &str) -> Option<NodesKind> {
    let info = registry.kind(kind)?;
    Some(NodesKind {
        kind: info.kind.to_owned(),
        contract: info.contract_name().to_owned(),
        version: info.version,
        summary: info.summary.to_owned(),
        own_ports: info.own_ports.then_some(true),
        doc: info.doc.trim().to_owned(),
        inputs: info.inputs.iter().map(Port::from).collect(),
        outputs: info.outputs.iter().map(Port::from).collect(),
        parameters: info.schema.clone(),
    })
}

impl From<&contracts::Port> for Port {
    fn from(port: &contracts::Port) -> Self {
        Self {
            port: port.name.to_owned(),
            value_type: port.value_type.name().to_owned(),
            rate: port.rate.name().to_owned(),
            optional: port.optional,
            doc: port.doc.to_owned(),
        }
    }
}
