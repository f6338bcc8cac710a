//! Boxes and arrows of a plan, for all diagram languages.

use std::collections::BTreeMap;

use crate::contracts::{Contract, Slot};
use crate::plan::{NodeId, Origin, Plan, RunId, StageRun, VariantId};

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    Source,
    File,
    Node(Contract),
}

pub(super) struct Box {
    pub(super) id: String,
    pub(super) shape: Shape,
    pub(super) lines: Vec<String>,
}

pub(super) struct Group {
    pub(super) id: String,
    pub(super) title: String,
    pub(super) boxes: Vec<Box>,
}

pub(super) struct Edge {
    pub(super) from: String,
    /// `None` for a file.
    pub(super) output: Option<&'static str>,
    pub(super) to: String,
    pub(super) input: &'static str,
    pub(super) once: bool,
}

/// All edges between two boxes.
pub(super) struct Arrow {
    pub(super) from: String,
    pub(super) to: String,
    pub(super) ports: Vec<String>,
    pub(super) once: bool,
}

pub(super) struct Diagram {
    pub(super) groups: Vec<Group>,
    pub(super) files: Vec<Box>,
    pub(super) edges: Vec<Edge>,
}

impl Diagram {
    pub(super) fn arrows(&self) -> Vec<Arrow> {
        let mut arrows: Vec<Arrow> = Vec::new();
        for edge in &self.edges {
            let port = edge.output.unwrap_or(edge.input).to_owned();
            // The edges to a box are consecutive.
            let mut into = arrows.iter_mut().rev().take_while(|arrow| arrow.to == edge.to);
            match into.find(|arrow| arrow.from == edge.from) {
                Some(arrow) => arrow.ports.push(port),
                None => arrows.push(Arrow {
                    from: edge.from.clone(),
                    to: edge.to.clone(),
                    ports: vec![port],
                    once: edge.once,
                }),
            }
        }
        arrows
    }
}

/// `None` if it serves all.
pub(super) fn variants(plan: &Plan, served: &[VariantId]) -> Option<String> {
    (served.len() < plan.variants.len())
        .then(|| served.iter().map(|&v| plan.variants[v].as_str()).collect::<Vec<_>>().join(", "))
}

pub(super) fn from_plan(plan: &Plan) -> Diagram {
    let mut diagram = Diagram { groups: Vec::new(), files: Vec::new(), edges: Vec::new() };
    let mut files: BTreeMap<String, String> = BTreeMap::new();
    for (r, run) in RunId::enumerate(&plan.runs) {
        let mut group = Group { id: format!("r{r}"), title: title(plan, run), boxes: Vec::new() };
        let kinds: Vec<&str> = run.source.parts.iter().map(|part| part.kind.as_str()).collect();
        let lines = vec![run.source.name.clone(), kinds.join(", then ")];
        group.boxes.push(Box { id: format!("r{r}s"), shape: Shape::Source, lines });
        for (n, node) in NodeId::enumerate(&run.nodes) {
            let mut lines = vec![node.name.clone(), node.kind.clone()];
            lines.extend(variants(plan, &node.variants));
            let id = format!("r{r}n{n}");
            group.boxes.push(Box { id: id.clone(), shape: Shape::Node(node.contract), lines });
            for input in &node.inputs {
                let Some(from) = &input.from else { continue };
                let (from, output, once) = match from {
                    Origin::Here(Slot::Source { port }) => {
                        (format!("r{r}s"), Some(run.source.outputs[*port].port.name), false)
                    }
                    Origin::Here(Slot::Node { node, port }) => {
                        (format!("r{r}n{node}"), Some(run.nodes[*node].outputs[*port].port.name), false)
                    }
                    Origin::Once { run, node, port } => {
                        let output = &plan.runs[*run].nodes[*node].outputs[*port];
                        (format!("r{run}n{node}"), Some(output.port.name), true)
                    }
                    Origin::File(path) => {
                        let next = format!("f{}", files.len());
                        let id = files.entry(input.shown_path(path)).or_insert(next).clone();
                        (id, None, true)
                    }
                };
                diagram.edges.push(Edge { from, output, to: id.clone(), input: input.port.name, once });
            }
        }
        diagram.groups.push(group);
    }
    let mut boxes: Vec<Box> =
        files.into_iter().map(|(path, id)| Box { id, shape: Shape::File, lines: vec![path] }).collect();
    boxes.sort_by(|a, b| a.id.cmp(&b.id));
    diagram.files = boxes;
    diagram
}

fn title(plan: &Plan, run: &StageRun) -> String {
    match variants(plan, &run.variants) {
        Some(variants) => format!("{} ({variants})", run.stage),
        None => run.stage.clone(),
    }
}
