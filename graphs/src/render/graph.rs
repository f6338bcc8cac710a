//! Plans as nodes and edges in JSON, for programs that draw or look through them.

use serde_json::{Value as Json, json};

use super::diagram;
use crate::plan::Plan;

impl Plan {
    /// `{ experiment, nodes, edges }`, under the identifiers of the drawings.
    ///
    /// A node is `{ id, type, name, kind, contract, stage, variants }` of the type `source` (with `kinds`, joined one after
    /// the other), `node` or `file`, of which a file has its
    /// path for a name and nothing else; an edge is `{ from: { id, port }, to: { id, port }, rate }`, without a port where it comes
    /// from a file.
    #[must_use]
    pub fn graph_json(&self) -> Json {
        let diagram = diagram::of(self);
        let names = |served: &[usize]| served.iter().map(|&v| self.variants[v].as_str()).collect::<Vec<_>>();
        let mut nodes = Vec::new();
        for (group, run) in diagram.groups.iter().zip(&self.runs) {
            // The first box of a stage run is its source.
            let mut boxes = group.boxes.iter();
            if let Some(source) = boxes.next() {
                nodes.push(json!({
                    "id": source.id,
                    "type": "source",
                    "name": run.source.name,
                    "kinds": run.source.parts.iter().map(|part| part.kind.as_str()).collect::<Vec<_>>(),
                    "stage": run.stage,
                    "variants": names(&run.variants),
                }));
            }
            nodes.extend(boxes.zip(&run.nodes).map(|(shown, node)| {
                json!({
                    "id": shown.id,
                    "type": "node",
                    "name": node.name,
                    "kind": node.kind,
                    "contract": node.contract.name(),
                    "stage": run.stage,
                    "variants": names(&node.variants),
                })
            }));
        }
        nodes.extend(
            diagram.files.iter().map(|file| json!({ "id": file.id, "type": "file", "name": file.lines.concat() })),
        );
        let edges = diagram.edges.iter().map(|edge| {
            json!({
                "from": { "id": edge.from, "port": edge.output },
                "to": { "id": edge.to, "port": edge.input },
                "rate": if edge.once { "once" } else { "frame" },
            })
        });
        json!({ "experiment": self.experiment, "nodes": nodes, "edges": edges.collect::<Vec<_>>() })
    }
}
