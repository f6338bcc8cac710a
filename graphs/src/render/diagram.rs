//! What a diagram of a plan shows, whatever language draws it: boxes and arrows.

use std::collections::BTreeMap;

use crate::contracts::{Contract, Slot};
use crate::plan::{Origin, Plan, StageRun};

/// What a box stands for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    Source,
    File,
    Node(Contract),
}

/// A box: an identifier and lines of text.
pub(super) struct Box {
    pub(super) id: String,
    pub(super) shape: Shape,
    pub(super) lines: Vec<String>,
}

/// The boxes of one stage run.
pub(super) struct Group {
    pub(super) id: String,
    pub(super) title: String,
    pub(super) boxes: Vec<Box>,
}

/// An arrow with the ports it carries.
pub(super) struct Arrow {
    pub(super) from: String,
    pub(super) to: String,
    pub(super) ports: Vec<String>,
    /// Whether it carries once-values.
    pub(super) once: bool,
}

/// A plan as boxes and arrows, in plan order.
pub(super) struct Diagram {
    pub(super) groups: Vec<Group>,
    pub(super) files: Vec<Box>,
    pub(super) arrows: Vec<Arrow>,
}

/// The variants something serves, in words; nothing if it serves all.
pub(super) fn variants(plan: &Plan, served: &[usize]) -> Option<String> {
    (served.len() < plan.variants.len())
        .then(|| served.iter().map(|&v| plan.variants[v].as_str()).collect::<Vec<_>>().join(", "))
}

pub(super) fn of(plan: &Plan) -> Diagram {
    let mut diagram = Diagram { groups: Vec::new(), files: Vec::new(), arrows: Vec::new() };
    let mut files: BTreeMap<String, String> = BTreeMap::new();
    for (r, run) in plan.runs.iter().enumerate() {
        let mut group = Group { id: format!("r{r}"), title: title(plan, run), boxes: Vec::new() };
        let kinds: Vec<&str> = run.source.parts.iter().map(|part| part.kind.as_str()).collect();
        let lines = vec![run.source.name.clone(), kinds.join(", then ")];
        group.boxes.push(Box { id: format!("r{r}s"), shape: Shape::Source, lines });
        for (n, node) in run.nodes.iter().enumerate() {
            let mut lines = vec![node.name.clone(), node.kind.clone()];
            lines.extend(variants(plan, &node.variants));
            let id = format!("r{r}n{n}");
            group.boxes.push(Box { id: id.clone(), shape: Shape::Node(node.contract), lines });
            let mut into: Vec<Arrow> = Vec::new();
            for input in &node.inputs {
                let Some(from) = &input.from else { continue };
                let (from, port, once) = match from {
                    Origin::Here(Slot::Source { port }) => {
                        (format!("r{r}s"), run.source.outputs[*port].port.name.to_owned(), false)
                    }
                    Origin::Here(Slot::Node { node, port }) => {
                        (format!("r{r}n{node}"), run.nodes[*node].outputs[*port].port.name.to_owned(), false)
                    }
                    Origin::Once { run, node, port } => {
                        let output = &plan.runs[*run].nodes[*node].outputs[*port];
                        (format!("r{run}n{node}"), output.port.name.to_owned(), true)
                    }
                    Origin::File(path) => {
                        let next = format!("f{}", files.len());
                        let id = files.entry(path.display().to_string()).or_insert(next).clone();
                        (id, input.port.name.to_owned(), true)
                    }
                };
                match into.iter_mut().find(|arrow| arrow.from == from) {
                    Some(arrow) => arrow.ports.push(port),
                    None => into.push(Arrow { from, to: id.clone(), ports: vec![port], once }),
                }
            }
            diagram.arrows.append(&mut into);
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
