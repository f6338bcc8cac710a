//! The differences between two plans, which explain why their values differ: parameter, version, input or file of a
//! node.
//!
//! Nodes with equal node hashes compute the same from equal inputs, whatever their names and stages. For other nodes,
//! the differences are what a user would change to make them equal.

use std::fmt;

use depthloom_graphs::Key;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{NodeId, NodeRef, RunId};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use crate::plan::{RecordedInput, RecordedNode, RecordedPlan, RecordedRun, RecordedSource, RecordedSourcePart};

/// A node of two plans, or of one of them.
#[derive(Clone, Debug, PartialEq)]
pub struct NodePair {
    /// Its stage.
    pub stage: String,
    /// Its name in the experiment.
    pub name: String,
    /// The variants of the later plan that the node belongs to; for a removed node, those of the earlier plan. Empty if
    /// the plan declares no variants.
    pub variants: Vec<String>,
    /// The node in the earlier plan; `None` if it has no such node.
    pub before: Option<NodeRef>,
    /// The node in the later plan; `None` if it has no such node.
    pub after: Option<NodeRef>,
    /// What differs; empty if the node hashes are equal, or one of the plans lacks the node.
    pub differences: Vec<PlanDifference>,
}

/// A difference between two nodes or sources. In JSON, `what` is the name of the variant.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
#[serde(tag = "what", rename_all = "lowercase")]
pub enum PlanDifference {
    /// They are of different kinds.
    Kind {
        /// The earlier one's.
        before: String,
        /// The later one's.
        after: String,
    },
    /// The version of the kind differs: its outputs have changed.
    Version {
        /// The earlier one's.
        before: u32,
        /// The later one's.
        after: u32,
    },
    /// A parameter; a file is compared by the hash of its content.
    Parameter {
        /// Its path, with dots between nested names.
        path: String,
        /// The earlier value; `None` where there was no such parameter.
        before: Option<Json>,
        /// The later value.
        after: Option<Json>,
    },
    /// An input is wired differently.
    Input {
        /// The port.
        port: String,
        /// The earlier wiring; `None` if the input was not wired.
        before: Option<String>,
        /// The later wiring.
        after: Option<String>,
    },
    /// An input is wired to the same node as before, but that node differs.
    Upstream {
        /// The port.
        port: String,
        /// The node, and its output.
        from: String,
    },
    /// The plans do not show the difference. It is the content of these input files. Without such files it is the
    /// engine that computes the node, what its program imports, or a variable of the environment.
    Unseen {
        /// The names of the files.
        files: Vec<String>,
    },
}

impl NodePair {
    /// `stage.node`, with at most `most` of its variants if it does not serve all variants of `plan`.
    #[must_use]
    pub fn label(&self, plan: &RecordedPlan, most: usize) -> String {
        let Self { stage, name, variants, .. } = self;
        if variants.is_empty() || variants.len() == plan.variants.len() {
            return format!("{stage}.{name}");
        }
        let more = if variants.len() > most { ", ..." } else { "" };
        format!("{stage}.{name} of {}{more}", variants[..variants.len().min(most)].join(", "))
    }
}

impl PlanDifference {
    /// Whether the node differs only because a node that it reads differs.
    #[must_use]
    pub const fn is_upstream(&self) -> bool {
        matches!(self, Self::Upstream { .. })
    }
}

/// The nodes of two plans in pairs: those of the later plan in plan order, then those that only the earlier plan has.
///
/// A node is paired with the node of the same name in the same stage and variant. If no variant has the same name, it
/// is paired with a node of the same node hash, or with the first node of that name.
#[must_use]
pub fn node_pairs(before: &RecordedPlan, after: &RecordedPlan) -> Vec<NodePair> {
    let mut pairs: Vec<NodePair> = Vec::new();
    for place in places(after) {
        for variant in names(after, node(after, place)) {
            let found = counterpart(before, after, place, variant);
            add(&mut pairs, after, (found, Some(place)), (place, variant));
        }
    }
    for place in
        places(before).filter(|place| !pairs.iter().any(|pair| pair.before == Some(*place))).collect::<Vec<_>>()
    {
        for variant in names(before, node(before, place)) {
            add(&mut pairs, before, (Some(place), None), (place, variant));
        }
    }
    for pair in &mut pairs {
        if let (Some(one), Some(other)) = (pair.before, pair.after) {
            pair.differences = differences(before, one, after, other);
        }
    }
    pairs
}

/// The differences between the sources of two stage runs.
#[must_use]
pub fn source_differences(before: &RecordedSource, after: &RecordedSource) -> Vec<PlanDifference> {
    if before.parts.len() != after.parts.len() {
        let kinds = |parts: &[RecordedSourcePart]| {
            parts.iter().map(|part| part.kind.as_str()).collect::<Vec<_>>().join(", then ")
        };
        return vec![PlanDifference::Kind { before: kinds(&before.parts), after: kinds(&after.parts) }];
    }
    let mut found = Vec::new();
    for (one, other) in before.parts.iter().zip(&after.parts) {
        add_kind_differences(
            (&one.kind, one.version, &one.params),
            (&other.kind, other.version, &other.params),
            &mut found,
        );
    }
    found
}

fn places(plan: &RecordedPlan) -> impl Iterator<Item = NodeRef> {
    RunId::enumerate(&plan.runs)
        .flat_map(|(run, planned)| NodeId::all(planned.nodes.len()).map(move |node| NodeRef { run, node }))
}

fn node(plan: &RecordedPlan, NodeRef { run, node }: NodeRef) -> &RecordedNode {
    &plan.runs[run].nodes[node]
}

fn names<'a>(plan: &'a RecordedPlan, node: &'a RecordedNode) -> impl Iterator<Item = &'a str> {
    node.variants.iter().filter_map(|&variant| plan.variants.get(variant.0)).map(String::as_str)
}

/// Adds a variant to the pair of these nodes, or adds the pair.
fn add(
    pairs: &mut Vec<NodePair>,
    plan: &RecordedPlan,
    (before, after): (Option<NodeRef>, Option<NodeRef>),
    (place, variant): (NodeRef, &str),
) {
    let known = pairs.iter().position(|pair| (pair.before, pair.after) == (before, after));
    let known = known.unwrap_or_else(|| {
        let (stage, name) = (plan.runs[place.run].stage.clone(), node(plan, place).name.clone());
        pairs.push(NodePair { stage, name, variants: Vec::new(), before, after, differences: Vec::new() });
        pairs.len() - 1
    });
    if !variant.is_empty() {
        pairs[known].variants.push(variant.to_owned());
    }
}

fn counterpart(before: &RecordedPlan, after: &RecordedPlan, place: NodeRef, variant: &str) -> Option<NodeRef> {
    let (stage, later) = (&after.runs[place.run].stage, node(after, place));
    let of_stage = || places(before).filter(|place| before.runs[place.run].stage == *stage);
    let named = || of_stage().filter(|&place| node(before, place).name == later.name);
    let of_variant = named().find(|&place| names(before, node(before, place)).any(|name| name == variant));
    let same = || of_stage().find(|&place| node(before, place).node_hash == later.node_hash);
    of_variant.or_else(same).or_else(|| named().next())
}

/// The differences between two nodes; empty if their node hashes are equal.
fn differences(before: &RecordedPlan, one: NodeRef, after: &RecordedPlan, other: NodeRef) -> Vec<PlanDifference> {
    let (earlier, later) = (node(before, one), node(after, other));
    if earlier.node_hash == later.node_hash {
        return Vec::new();
    }
    let mut found = Vec::new();
    let kind_of = |node: &RecordedNode| (node.kind.clone(), node.version, node.params.clone());
    let ((one_kind, one_version, one_params), (kind, version, params)) = (kind_of(earlier), kind_of(later));
    add_kind_differences((&one_kind, one_version, &one_params), (&kind, version, &params), &mut found);
    let mut files = Vec::new();
    for input in &later.inputs {
        let wire = wire(after, other, input);
        let counterpart = earlier.inputs.iter().find(|other| other.port == input.port);
        let was = counterpart.map_or(Wire::Nothing, |input| self::wire(before, one, input));
        let port = input.port.clone();
        match (&was, &wire) {
            (Wire::File(was), Wire::File(is)) if was == is => files.push(is.clone()),
            (Wire::Node(_, was), Wire::Node(_, is)) if was == is => {}
            (Wire::Node(was, _), Wire::Node(from, _)) if was == from => {
                found.push(PlanDifference::Upstream { port, from: from.clone() });
            }
            (was, is) if was == is => {}
            (was, is) => found.push(PlanDifference::Input { port, before: was.text(), after: is.text() }),
        }
    }
    for input in earlier.inputs.iter().filter(|input| !later.inputs.iter().any(|other| other.port == input.port)) {
        let was = wire(before, one, input);
        if was != Wire::Nothing {
            found.push(PlanDifference::Input { port: input.port.clone(), before: was.text(), after: None });
        }
    }
    if found.is_empty() {
        found.push(PlanDifference::Unseen { files });
    }
    found
}

fn add_kind_differences(before: (&str, u32, &Json), after: (&str, u32, &Json), found: &mut Vec<PlanDifference>) {
    if before.0 != after.0 {
        found.push(PlanDifference::Kind { before: before.0.to_owned(), after: after.0.to_owned() });
        // Only the parameters that both kinds have: a new kind drops the values of the old one's parameters.
        let shared = |params: &Json, other: &Json| {
            let entries = params.as_object().into_iter().flatten();
            let entries = entries.filter(|(name, _)| other.get(name.as_str()).is_some());
            Json::Object(entries.map(|(name, value)| (name.clone(), value.clone())).collect())
        };
        return found.extend(json_differences(&shared(before.2, after.2), &shared(after.2, before.2)));
    }
    if before.1 != after.1 {
        found.push(PlanDifference::Version { before: before.1, after: after.1 });
    }
    found.extend(json_differences(before.2, after.2));
}

/// The paths at which two values differ, each a [`PlanDifference::Parameter`]. Lists are compared as one value.
#[must_use]
pub fn json_differences(before: &Json, after: &Json) -> Vec<PlanDifference> {
    fn add(path: &str, before: Option<&Json>, after: Option<&Json>, found: &mut Vec<PlanDifference>) {
        let (one, other) = match (before, after) {
            (before, after) if before == after => return,
            (Some(Json::Object(one)), Some(Json::Object(other))) => (one, other),
            (before, after) => {
                let (path, before, after) = (path.to_owned(), before.cloned(), after.cloned());
                return found.push(PlanDifference::Parameter { path, before, after });
            }
        };
        let gone = one.keys().filter(|key| !other.contains_key(*key));
        for key in other.keys().chain(gone) {
            let inner = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            add(&inner, one.get(key), other.get(key), found);
        }
    }
    let mut found = Vec::new();
    add("", Some(before), Some(after), &mut found);
    found
}

#[derive(Debug, PartialEq)]
enum Wire {
    Nothing,
    Source(String),
    /// The output of a node, and the node hash.
    Node(String, Key),
    File(String),
}

impl Wire {
    fn text(&self) -> Option<String> {
        match self {
            Self::Nothing => None,
            Self::Source(text) | Self::Node(text, _) => Some(text.clone()),
            Self::File(name) => Some(format!("file {name}")),
        }
    }
}

fn wire(plan: &RecordedPlan, place: NodeRef, input: &RecordedInput) -> Wire {
    let Some(from) = &input.from else { return Wire::Nothing };
    if let Some(name) = from.strip_prefix("file") {
        return Wire::File(name.trim_start().to_owned());
    }
    if let Some(once) = from.strip_prefix("once ") {
        let is_read = |of: &&RecordedNode| of.variants.iter().any(|of| node(plan, place).variants.contains(of));
        let has_output = |run: &RecordedRun, node: &RecordedNode| {
            node.outputs.iter().any(|output| format!("{}.{}/{}", run.stage, node.name, output.port) == once)
        };
        let mut found =
            plan.runs.iter().flat_map(|run| run.nodes.iter().filter(|node| has_output(run, node)).filter(is_read));
        return found
            .next()
            .map_or_else(|| Wire::Source(once.to_owned()), |of| Wire::Node(once.to_owned(), of.node_hash));
    }
    match plan.find(place.run, from) {
        Some((Slot::Source { .. }, output)) => Wire::Source(format!("source/{}", output.port)),
        Some((Slot::Node { node, .. }, output)) => {
            let node = &plan.runs[place.run].nodes[node];
            Wire::Node(format!("{}/{}", node.name, output.port), node.node_hash)
        }
        None => Wire::Source(from.clone()),
    }
}

impl fmt::Display for PlanDifference {
    /// As a lower-case fragment, the earlier value first.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let wired = |to: &Option<String>| to.clone().unwrap_or_else(|| "nothing".to_owned());
        match self {
            Self::Kind { before, after } => write!(f, "kind: {before} -> {after}"),
            Self::Version { before, after } => write!(f, "version of the kind: {before} -> {after}"),
            Self::Parameter { path, before, after } => {
                write!(f, "{path}: {} -> {}", one_line(before.as_ref()), one_line(after.as_ref()))
            }
            Self::Input { port, before, after } => write!(f, "input {port}: {} -> {}", wired(before), wired(after)),
            Self::Upstream { port, from } => write!(f, "input {port}: {from} differs"),
            Self::Unseen { files } if files.is_empty() => {
                f.write_str(
                    "the engine that computes it (version, build or provider), what its program imports (with neither `code` nor `version` it is new in every run), the order of its parameters, or the value of a variable in them",
                )
            }
            Self::Unseen { files } => write!(f, "what is in {}", files.join(" or ")),
        }
    }
}

/// A value on one line; for a file, the beginning of its content hash.
fn one_line(value: Option<&Json>) -> String {
    const SHOWN: usize = 60;
    let text = match value {
        None => return "(none)".to_owned(),
        Some(Json::String(text)) => text.clone(),
        Some(Json::Object(map)) if map.len() == 1 && map.contains_key("content") => {
            let hash = map["content"].as_str().unwrap_or_default();
            return format!("a file of content {}", hash.get(..12).unwrap_or(hash));
        }
        Some(value) => value.to_string(),
    };
    let mut line: String = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if let Some((end, _)) = line.char_indices().nth(SHOWN) {
        line.truncate(end);
        line.push_str("...");
    }
    line
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Key;
    use depthloom_graphs::plan::VariantId;
    use serde::Deserialize;
    use serde_json::{Value as Json, json};

    use super::{RecordedPlan, node_pairs, source_differences};

    fn node_hash(text: &str) -> Json {
        json!(Key::of_content(text.as_bytes()).to_string())
    }

    fn node(name: &str, params: &Json, inputs: &Json, node_hash: &Json, variants: &[VariantId]) -> Json {
        let outputs = json!([{
            "port": "out", "type": "depth", "once": false, "topic": format!("/s/{name}{variants:?}/out"), "aliases": [],
            "recorded": true,
        }]);
        json!({
            "name": name, "kind": "k", "version": 1, "contract": "pure", "params": params, "inputs": inputs,
            "outputs": outputs, "node_hash": node_hash, "variants": variants,
        })
    }

    fn plan(variants: &[&str], nodes: &[Json]) -> RecordedPlan {
        let all: Vec<VariantId> = VariantId::all(variants.len()).collect();
        let part = json!({ "kind": "made", "version": 1, "params": { "seed": nodes.len() } });
        let plan = json!({
            "experiment": "x", "description": "", "variants": variants, "every": 1, "view": false,
            "runs": [{
                "stage": "s", "prefix": "/s", "variants": all, "nodes": nodes, "estimates": [],
                "source": { "name": "street", "parts": [part], "outputs": [] },
            }],
        });
        RecordedPlan::deserialize(&plan).unwrap()
    }

    fn pair_lines(before: &RecordedPlan, after: &RecordedPlan) -> Vec<String> {
        let line = |pair: &super::NodePair| {
            let change = match (pair.before, pair.after) {
                (Some(_), Some(_)) => "",
                (None, _) => " new",
                (_, None) => " gone",
            };
            let what: Vec<String> = pair.differences.iter().map(ToString::to_string).collect();
            format!("{}{:?}{change} {}", pair.name, pair.variants, what.join("; "))
        };
        node_pairs(before, after).iter().map(line).collect()
    }

    #[test]
    fn a_difference_is_reported_once_and_nodes_after_it_as_upstream() {
        let reads = |topic: &str| json!([{ "port": "in", "from": topic }]);
        let none = json!({});
        let before = plan(
            &[""],
            &[
                node("a", &json!({ "block": 5, "deep": { "p": 1 } }), &json!([]), &node_hash("a"), &[VariantId(0)]),
                node("b", &none, &reads("/s/a[0]/out"), &node_hash("b"), &[VariantId(0)]),
                node(
                    "c",
                    &none,
                    &json!([{ "port": "model", "from": "file net.onnx" }]),
                    &node_hash("c"),
                    &[VariantId(0)],
                ),
                node("d", &none, &reads("/s/a[0]/out"), &node_hash("d"), &[VariantId(0)]),
                node("e", &none, &json!([]), &node_hash("e"), &[VariantId(0)]),
                node("old", &none, &json!([]), &node_hash("old"), &[VariantId(0)]),
            ],
        );
        let after = plan(
            &[""],
            &[
                node(
                    "a",
                    &json!({ "block": 9, "deep": { "p": 1, "q": [1, 2] } }),
                    &json!([]),
                    &node_hash("a2"),
                    &[VariantId(0)],
                ),
                node("b", &none, &reads("/s/a[0]/out"), &node_hash("b2"), &[VariantId(0)]),
                node(
                    "c",
                    &none,
                    &json!([{ "port": "model", "from": "file net.onnx" }]),
                    &node_hash("c2"),
                    &[VariantId(0)],
                ),
                node("d", &none, &reads("/s/b[0]/out"), &node_hash("d2"), &[VariantId(0)]),
                node("e", &none, &json!([]), &node_hash("e2"), &[VariantId(0)]),
                node("renamed", &none, &json!([]), &node_hash("old"), &[VariantId(0)]),
                node("new", &none, &json!([]), &node_hash("new"), &[VariantId(0)]),
            ],
        );
        assert_eq!(
            pair_lines(&before, &after),
            [
                "a[] block: 5 -> 9; deep.q: (none) -> [1,2]",
                "b[] input in: a/out differs",
                "c[] what is in net.onnx",
                "d[] input in: a/out -> b/out",
                "e[] the engine that computes it (version, build or provider), what its program imports (with neither `code` nor `version` it is new in every run), the order of its parameters, or the value of a variable in them",
                "renamed[] ",
                "new[] new ",
            ]
        );
        assert!(pair_lines(&after, &before).contains(&"new[] gone ".to_owned()));
        let seed = source_differences(&before.runs[0].source, &after.runs[0].source);
        assert_eq!(seed.iter().map(ToString::to_string).collect::<Vec<_>>(), ["seed: 6 -> 7"]);
    }

    #[test]
    fn variants_are_compared_by_name() {
        let capped = |cap: u32, variants: &[VariantId]| {
            node("a", &json!({ "cap": cap }), &json!([]), &node_hash(&cap.to_string()), variants)
        };
        let before = plan(&["x", "y"], &[capped(1, &[VariantId(0)]), capped(2, &[VariantId(1)])]);
        let after = plan(&["y", "x", "z"], &[capped(2, &[VariantId(0)]), capped(3, &[VariantId(1), VariantId(2)])]);
        // `z` is new: it is compared with the first node of that name.
        assert_eq!(pair_lines(&before, &after), ["a[\"y\"] ", "a[\"x\", \"z\"] cap: 1 -> 3"]);
    }
}
