//! Kinds as JSON, for programs.

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use crate::contracts;
use crate::registry::Registry;

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
#[must_use]
pub fn kinds_json(registry: &Registry) -> Nodes {
    let sources = registry.sources().map(|source| {
        let declared = &source.declaration;
        head(declared.kind, "source", declared.version, declared.summary)
    });
    let nodes = registry.nodes().map(|node| {
        let declared = &node.declaration;
        head(declared.kind, declared.contract.name(), declared.version, declared.summary)
    });
    Nodes { kinds: sources.chain(nodes).collect() }
}

/// Everything about one kind. `None` if there is no such kind.
#[must_use]
pub fn kind_json(registry: &Registry, kind: &str) -> Option<NodesKind> {
    let (head, doc, inputs, outputs, schema) = if let Some(node) = registry.node_kind(kind) {
        let declared = &node.declaration;
        let head = head(declared.kind, declared.contract.name(), declared.version, declared.summary);
        (head, declared.doc, &declared.inputs[..], &declared.outputs, &node.schema)
    } else {
        let source = registry.source_kind(kind)?;
        let declared = &source.declaration;
        let head = head(declared.kind, "source", declared.version, declared.summary);
        (head, declared.doc, &[][..], &declared.outputs, &source.schema)
    };
    let Kind { kind, contract, version, summary } = head;
    Some(NodesKind {
        own_ports: registry.node_kind(&kind).is_some_and(|node| node.own_ports).then_some(true),
        kind,
        contract,
        version,
        summary,
        doc: doc.trim().to_owned(),
        inputs: inputs.iter().map(Port::from).collect(),
        outputs: outputs.iter().map(Port::from).collect(),
        parameters: schema.clone(),
    })
}

fn head(kind: &str, contract: &str, version: u32, summary: &str) -> Kind {
    Kind { kind: kind.to_owned(), contract: contract.to_owned(), version, summary: summary.to_owned() }
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
