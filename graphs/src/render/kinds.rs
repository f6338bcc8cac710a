//! Kinds as JSON, for programs.

use serde_json::{Value as Json, json};

use crate::contracts::Port;
use crate::registry::Registry;

/// All kinds: `{ kinds: [{ kind, contract, version, summary }] }`; the contract of a source is `source`.
#[must_use]
pub fn kinds_json(registry: &Registry) -> Json {
    let sources = registry.sources().map(|source| {
        let declared = &source.declaration;
        head(declared.kind, "source", declared.version, declared.summary)
    });
    let nodes = registry.nodes().map(|node| {
        let declared = &node.declaration;
        head(declared.kind, declared.contract.name(), declared.version, declared.summary)
    });
    json!({ "kinds": sources.chain(nodes).collect::<Vec<_>>() })
}

/// Everything about one kind: the same, with `doc`, `inputs`, `outputs` and the JSON Schema of its `parameters`; and `own_ports: true`
/// where ports follow from these. `None` if there is no such kind.
#[must_use]
pub fn kind_json(registry: &Registry, kind: &str) -> Option<Json> {
    let (mut json, doc, inputs, outputs, schema) = if let Some(node) = registry.node_kind(kind) {
        let declared = &node.declaration;
        let head = head(declared.kind, declared.contract.name(), declared.version, declared.summary);
        (head, declared.doc, &declared.inputs[..], &declared.outputs, &node.schema)
    } else {
        let source = registry.source_kind(kind)?;
        let declared = &source.declaration;
        let head = head(declared.kind, "source", declared.version, declared.summary);
        (head, declared.doc, &[][..], &declared.outputs, &source.schema)
    };
    if registry.node_kind(kind).is_some_and(|node| node.own_ports) {
        json["own_ports"] = true.into();
    }
    json["doc"] = doc.trim().into();
    json["inputs"] = inputs.iter().map(port).collect();
    json["outputs"] = outputs.iter().map(port).collect();
    json["parameters"] = schema.clone();
    Some(json)
}

fn head(kind: &str, contract: &str, version: u32, summary: &str) -> Json {
    json!({ "kind": kind, "contract": contract, "version": version, "summary": summary })
}

fn port(port: &Port) -> Json {
    json!({
        "port": port.name,
        "type": port.value_type.name(),
        "rate": port.rate.name(),
        "optional": port.optional,
        "doc": port.doc,
    })
}
