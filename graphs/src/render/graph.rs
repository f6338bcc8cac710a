//! Plans as nodes and edges in JSON.

use schemars::JsonSchema;
use serde::Serialize;

use super::diagram;
use crate::plan::Plan;

/// Of `graph`: boxes and arrows.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct Graph {
    experiment: String,
    nodes: Vec<GraphNode>,
    edges: Vec<Edge>,
}

/// A box.
#[derive(Clone, Debug, Default, PartialEq, JsonSchema, Serialize)]
pub(super) struct GraphNode {
    id: String,
    /// `source`, `node` or `file`.
    #[serde(rename = "type")]
    of: String,
    name: String,
    /// Of a node.
    #[serde(skip_serializing_if = "Option::is_none")]
    kind: Option<String>,
    /// Of a source.
    #[serde(skip_serializing_if = "Option::is_none")]
    kinds: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    contract: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stage: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    variants: Option<Vec<String>>,
}

/// An arrow.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct Edge {
    from: EdgeEnd,
    to: EdgeEnd,
    /// `frame` or `once`.
    rate: String,
}

/// An end of an arrow.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(super) struct EdgeEnd {
    id: String,
    port: Option<String>,
}

impl Plan {
    /// The plan as `{ experiment, nodes, edges }`, with the identifiers of the diagrams.
    pub fn graph_json(&self) -> Graph {
        let diagram = diagram::from_plan(self);
        let mut nodes = Vec::new();
        for (group, run) in diagram.groups.iter().zip(&self.runs) {
            // The first box of a stage run is its source.
            let mut boxes = group.boxes.iter();
            if let Some(source) = boxes.next() {
                nodes.push(GraphNode {
                    id: source.id.clone(),
                    of: "source".to_owned(),
                    name: run.source.name.clone(),
                    kinds: Some(run.source.parts.iter().map(|part| part.kind.clone()).collect()),
                    stage: Some(run.stage.clone()),
                    variants: Some(self.names(&run.variants)),
                    ..GraphNode::default()
                });
            }
            nodes.extend(boxes.zip(&run.nodes).map(|(shown, node)| GraphNode {
                id: shown.id.clone(),
                of: "node".to_owned(),
                name: node.name.clone(),
                kind: Some(node.kind.clone()),
                contract: Some(node.contract.name().to_owned()),
                stage: Some(run.stage.clone()),
                variants: Some(self.names(&node.variants)),
                ..GraphNode::default()
            }));
        }
        nodes.extend(diagram.files.iter().map(|file| GraphNode {
            id: file.id.clone(),
            of: "file".to_owned(),
            name: file.lines.concat(),
            ..GraphNode::default()
        }));
        let edge = |edge: &diagram::Edge| Edge {
            from: EdgeEnd { id: edge.from.clone(), port: edge.output.map(ToOwned::to_owned) },
            to: EdgeEnd { id: edge.to.clone(), port: Some(edge.input.to_owned()) },
            rate: if edge.once { "once" } else { "frame" }.to_owned(),
        };
        Graph { experiment: self.experiment.clone(), nodes, edges: diagram.edges.iter().map(edge).collect() }
    }
}
