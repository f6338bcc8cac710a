//! The plan as a picture: an SVG whose colours are the page's.
//!
//! A box is a source or a node as the experiment names it; nodes that differ between variants in parameters or inputs
//! alone are one box. Columns go by the longest way from the source; within a column boxes are near their inputs.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use depthloom_graphs::plan::VariantId;
use depthloom_recording::RecordedPlan;

use crate::xml::escaped;

const BOX: (f64, f64) = (168.0, 46.0);
const GAP: (f64, f64) = (56.0, 16.0);
const STAGE_HEAD: f64 = 26.0;
const MARGIN: f64 = 14.0;
/// The number of characters of a name that fit into a box.
const ROOM: usize = 21;
/// How often the order within columns is made better.
const SWEEPS: usize = 8;

struct Node {
    stage: usize,
    name: String,
    kinds: BTreeSet<String>,
    is_source: bool,
    variants: BTreeSet<VariantId>,
    /// Several nodes that differ between variants.
    several: usize,
    column: usize,
    row: usize,
}

#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    from: usize,
    to: usize,
    once: bool,
    ports: String,
}

/// A plan as SVG.
#[must_use]
pub fn plan_drawing(plan: &RecordedPlan) -> String {
    let (stages, mut nodes, edges) = graph(plan);
    arrange(&mut nodes, &edges, stages.len());
    let tops = tops(&nodes, stages.len());
    let columns = nodes.iter().map(|node| node.column + 1).max().unwrap_or(1);
    let width = 2.0 * MARGIN + columns as f64 * (BOX.0 + GAP.0) - GAP.0;
    let height = tops[stages.len()];
    let place = |node: &Node| {
        let x = MARGIN + node.column as f64 * (BOX.0 + GAP.0);
        (x, tops[node.stage] + STAGE_HEAD + node.row as f64 * (BOX.1 + GAP.1))
    };
    let mut svg = format!(
        "<svg class=\"plan\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" role=\"img\" aria-label=\"the plan: which node reads what\">\n"
    );
    for (stage, name) in stages.iter().enumerate() {
        let _ = writeln!(
            svg,
            "<text class=\"stage\" x=\"{MARGIN}\" y=\"{}\">stage {}</text>",
            tops[stage] + 14.0,
            escaped(name)
        );
    }
    for edge in &edges {
        let ((fx, fy), (tx, ty)) = (place(&nodes[edge.from]), place(&nodes[edge.to]));
        let once = if edge.once { " once" } else { "" };
        let title = escaped(&edge.ports);
        let (fy, ty) = (fy + BOX.1 / 2.0, ty + BOX.1 / 2.0);
        let (fx, bend) = (fx + BOX.0, (GAP.0 * 0.9).max((tx - fx - BOX.0) / 2.5));
        if nodes[edge.from].stage != nodes[edge.to].stage {
            // Down from one stage into another.
            let (fx, fy) = (fx - BOX.0 / 2.0, fy + BOX.1 / 2.0);
            let _ = writeln!(
                svg,
                "<path class=\"edge{once}\" d=\"M{fx} {fy} C{fx} {} {} {ty} {tx} {ty}\"><title>{title}</title></path>",
                fy + 60.0,
                tx - GAP.0,
            );
            continue;
        }
        let _ = writeln!(
            svg,
            "<path class=\"edge{once}\" d=\"M{fx} {fy} C{} {fy} {} {ty} {tx} {ty}\"><title>{title}</title></path>",
            fx + bend,
            tx - bend
        );
    }
    for node in &nodes {
        let (x, y) = place(node);
        let class = if node.is_source { "source" } else { "node" };
        let kinds = node.kinds.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        let few = node.variants.len() < plan.variants.len();
        let variants = format!("{} of {} variants", node.variants.len(), plan.variants.len());
        let title = format!(
            "{}: {kinds}{}{}",
            node.name,
            if few { format!("; in {variants}") } else { String::new() },
            if node.several > 1 {
                format!("; {} nodes that differ between variants", node.several)
            } else {
                String::new()
            }
        );
        let mark = if node.several > 1 { format!(" ×{}", node.several) } else { String::new() };
        let _ = writeln!(
            svg,
            "<g class=\"{class}\"><title>{}</title><rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\" rx=\"6\"/><text class=\"name\" x=\"{}\" y=\"{}\">{}{mark}</text><text class=\"kind\" x=\"{}\" y=\"{}\">{}</text></g>",
            escaped(&title),
            BOX.0,
            BOX.1,
            x + 10.0,
            y + 19.0,
            escaped(&short(&node.name, ROOM - mark.chars().count())),
            x + 10.0,
            y + 35.0,
            escaped(&short(&kinds, ROOM + 4)),
        );
    }
    svg.push_str("</svg>\n");
    svg
}

fn short(text: &str, room: usize) -> String {
    if text.chars().count() <= room { text.to_owned() } else { text.chars().take(room - 1).chain(['…']).collect() }
}

/// Stages, boxes and arrows.
fn graph(plan: &RecordedPlan) -> (Vec<String>, Vec<Node>, Vec<Edge>) {
    let mut stages: Vec<String> = Vec::new();
    let mut nodes: Vec<Node> = Vec::new();
    let mut known: BTreeMap<(usize, bool, String), usize> = BTreeMap::new();
    let mut node_of =
        |nodes: &mut Vec<Node>, stage: usize, is_source: bool, name: &str, kinds: Vec<&str>, variants: &[VariantId]| {
            let place = *known.entry((stage, is_source, name.to_owned())).or_insert_with(|| {
                let (kinds, variants) = (BTreeSet::new(), BTreeSet::new());
                nodes.push(Node {
                    stage,
                    name: name.to_owned(),
                    kinds,
                    is_source,
                    variants,
                    several: 0,
                    column: 0,
                    row: 0,
                });
                nodes.len() - 1
            });
            nodes[place].kinds.extend(kinds.into_iter().map(str::to_owned));
            nodes[place].variants.extend(variants);
            nodes[place].several += 1;
            place
        };
    // By stage run the boxes of its source and nodes.
    let mut places: Vec<(usize, Vec<usize>)> = Vec::new();
    for run in &plan.runs {
        let stage = stages.iter().position(|stage| *stage == run.stage).unwrap_or_else(|| {
            stages.push(run.stage.clone());
            stages.len() - 1
        });
        let kinds = run.source.parts.iter().map(|part| part.kind.as_str()).collect();
        let source = node_of(&mut nodes, stage, true, &run.source.name, kinds, &run.variants);
        let stage_nodes = run
            .nodes
            .iter()
            .map(|node| node_of(&mut nodes, stage, false, &node.name, vec![&node.kind], &node.variants));
        let stage_nodes = stage_nodes.collect();
        places.push((source, stage_nodes));
    }
    let mut edges = BTreeSet::new();
    for (run, (source, own)) in plan.runs.iter().zip(&places) {
        let mut by_topic: BTreeMap<&str, (usize, &str)> = BTreeMap::new();
        let outputs = run.source.outputs.iter().map(|output| (*source, output));
        let outputs = outputs.chain(
            run.nodes.iter().zip(own).flat_map(|(node, &place)| node.outputs.iter().map(move |output| (place, output))),
        );
        for (place, output) in outputs {
            for topic in std::iter::once(&output.topic).chain(&output.aliases) {
                by_topic.insert(topic, (place, &output.port));
            }
        }
        for (node, &to) in run.nodes.iter().zip(own) {
            for input in &node.inputs {
                let Some(from) = &input.from else { continue };
                let here = by_topic.get(from.as_str()).copied();
                let once = || -> Option<(usize, &str)> {
                    let (stage, rest) = from.strip_prefix("once ")?.split_once('.')?;
                    let (name, port) = rest.rsplit_once('/')?;
                    let is = |node: &Node| !node.is_source && node.name == name && stages[node.stage] == stage;
                    Some((nodes.iter().position(is)?, port))
                };
                if let Some((from, port)) = here.or_else(once) {
                    let ports = format!("{}/{port} → {}/{}", nodes[from].name, nodes[to].name, input.port);
                    edges.insert(Edge { from, to, once: here.is_none(), ports });
                }
            }
        }
    }
    (stages, nodes, edges.into_iter().filter(|edge| edge.from != edge.to).collect())
}

/// Columns and rows.
fn arrange(nodes: &mut [Node], edges: &[Edge], stages: usize) {
    // Plans have no circles, but boxes of several variants might: no way is longer than all boxes.
    for _ in 0..nodes.len() {
        let mut changed = false;
        for edge in edges {
            if nodes[edge.from].stage != nodes[edge.to].stage {
                continue;
            }
            let least = nodes[edge.from].column + 1;
            if nodes[edge.to].column < least && least < nodes.len() {
                nodes[edge.to].column = least;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    for stage in 0..stages {
        let columns = nodes.iter().filter(|node| node.stage == stage).map(|node| node.column + 1).max().unwrap_or(0);
        let mut order: Vec<Vec<usize>> = (0..columns)
            .map(|column| (0..nodes.len()).filter(|&i| nodes[i].stage == stage && nodes[i].column == column).collect())
            .collect();
        let mut rows: Vec<f64> = vec![0.0; nodes.len()];
        let number = |column: &[usize], rows: &mut [f64]| {
            column.iter().enumerate().for_each(|(row, &node)| rows[node] = row as f64);
        };
        order.iter().for_each(|column| number(column, &mut rows));
        for sweep in 0..SWEEPS {
            let forwards = sweep % 2 == 0;
            let columns: Vec<usize> = if forwards { (0..columns).collect() } else { (0..columns).rev().collect() };
            for column in columns {
                let middle = |node: usize| {
                    let near = edges.iter().filter(|edge| if forwards { edge.to == node } else { edge.from == node });
                    let near: Vec<f64> = near.map(|edge| rows[if forwards { edge.from } else { edge.to }]).collect();
                    if near.is_empty() { rows[node] } else { near.iter().sum::<f64>() / near.len() as f64 }
                };
                let middles: BTreeMap<usize, f64> = order[column].iter().map(|&node| (node, middle(node))).collect();
                order[column].sort_by(|a, b| middles[a].total_cmp(&middles[b]).then(a.cmp(b)));
                number(&order[column], &mut rows);
            }
        }
        for column in order {
            for (row, node) in column.into_iter().enumerate() {
                nodes[node].row = row;
            }
        }
    }
}

/// Where each stage begins, and where the last ends.
fn tops(nodes: &[Node], stages: usize) -> Vec<f64> {
    let mut tops = vec![MARGIN];
    for stage in 0..stages {
        let rows = nodes.iter().filter(|node| node.stage == stage).map(|node| node.row + 1).max().unwrap_or(0);
        tops.push(tops[stage] + STAGE_HEAD + rows as f64 * (BOX.1 + GAP.1) + 10.0);
    }
    tops
}

#[cfg(test)]
mod tests {
    use serde::Deserialize as _;
    use serde_json::json;

    use super::*;
    use depthloom_graphs::plan::VariantId;

    #[test]
    fn a_plan_is_drawn_with_what_differs_between_variants_in_one_box_and_names_escaped() {
        let output = |topic: &str| json!([{ "port": "depth", "type": "depth", "once": false, "topic": topic, "aliases": [], "recorded": true }]);
        let node = |name: &str, from: &str, topic: &str, variants: &[VariantId]| {
            json!({ "name": name, "kind": "filter/median", "version": 1, "contract": "pure", "params": {},
                    "inputs": [{ "port": "depth", "from": from }], "outputs": output(topic),
                    "node_hash": "00".repeat(16), "variants": variants })
        };
        let plan = json!({
            "experiment": "x", "description": "", "variants": ["a", "b"], "every": 1, "view": false,
            "runs": [{
                "stage": "s", "prefix": "/s", "variants": [0, 1], "estimates": [],
                "source": { "name": "<street>", "parts": [{ "kind": "k", "version": 1, "params": {} }], "outputs": output("/s/source/depth") },
                "nodes": [node("shared", "/s/source/depth", "/s/shared", &[VariantId(0), VariantId(1)]), node("own", "/s/shared", "/s/a/own", &[VariantId(0)]), node("own", "/s/shared", "/s/b/own", &[VariantId(1)])],
            }],
        });
        let plan = RecordedPlan::deserialize(plan).unwrap();
        let svg = plan_drawing(&plan);
        assert_eq!(svg.matches("<g class=").count(), 3, "{svg}");
        assert_eq!(svg.matches("<path").count(), 2, "{svg}");
        assert!(svg.contains("own ×2") && svg.contains("&lt;street&gt;") && !svg.contains("<street>"), "{svg}");
        let (_, nodes, _) = graph(&plan);
        assert_eq!(nodes[2].variants.len(), 2);
    }
}
