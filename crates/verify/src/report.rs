//! The report of a replay: as text and as JSON.

use depthloom_graphs::counted;
use depthloom_graphs::plan::NodeRef;
use depthloom_graphs::values::{Differs, Place, number};
use depthloom_recording::Recording;
use depthloom_terminal::aligned;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Value as Json, json};

use crate::plan::{Replayed, Unchecked};
use crate::tally::{Placed, Tally};

/// The number of differing nodes that are shown; `--json` lists all.
pub const SHOWN: usize = 20;

/// The name of a node.
#[derive(JsonSchema, Serialize)]
pub struct NodeName {
    stage: String,
    node: String,
    kind: String,
    version: u32,
    variants: Vec<String>,
}

/// A node that was recomputed and compared.
#[derive(JsonSchema, Serialize)]
pub struct ComparedNode {
    #[serde(flatten)]
    node: NodeName,
    /// The number of values that were compared.
    compared: u64,
    different: u64,
    numbers: u64,
    different_numbers: u64,
    first: Option<NumberDifference>,
    worst: Option<NumberDifference>,
    remarks: Vec<String>,
}

/// A node that was not compared, or failed.
#[derive(JsonSchema, Serialize)]
pub struct OtherNode {
    #[serde(flatten)]
    node: NodeName,
    why: String,
}

/// The place where a value differs.
#[derive(JsonSchema, Serialize)]
pub struct NumberDifference {
    frame: Option<String>,
    topic: String,
    #[serde(rename = "type")]
    value_type: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pixel: Option<[u32; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    channel: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    byte: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    /// A number, a text, or null for an invalid value.
    recorded: Json,
    now: Json,
    // Of numbers; null where they do not differ by a finite number.
    #[serde(skip_serializing_if = "Option::is_none")]
    by: Option<Option<f64>>,
}

/// The result of a replay, as text and as JSON.
pub struct Report<'a> {
    /// The recording.
    pub recording: &'a Recording,
    /// The nodes that were compared, with their stage runs.
    pub checked: Vec<(NodeRef, Replayed, Tally)>,
    /// The nodes that were not compared.
    pub unchecked: Vec<Unchecked>,
    /// The nodes that failed in a way that would have ended a run.
    pub failed: Vec<Unchecked>,
    /// The bytes of the recording that could not be read.
    pub damage: Vec<String>,
}

impl Report<'_> {
    fn different(&self) -> impl Iterator<Item = &(NodeRef, Replayed, Tally)> {
        self.checked.iter().filter(|(.., tally)| tally.different > 0)
    }

    /// Whether all values are equal.
    pub fn is_equal(&self) -> bool {
        self.different().next().is_none() && self.failed.is_empty()
    }

    /// What is wrong; `None` if all values are equal.
    pub fn verdict(&self) -> Option<String> {
        let has_failed = |node: NodeRef| self.failed.iter().any(|failed| failed.node == node);
        let different = self.different().filter(|(node, ..)| !has_failed(*node)).count() as u64;
        let all = counted(self.checked.len(), "node");
        let differ = (different > 0).then(|| format!("{different} of {all} computed other values than recorded"));
        let failed = self.failed.len() as u64;
        let failed = (failed > 0).then(|| format!("{} failed", counted(failed, "node")));
        let damaged = (!self.damage.is_empty()).then(|| "the recording is damaged".to_owned());
        let what: Vec<String> = [differ, failed].into_iter().flatten().collect();
        if what.is_empty() { damaged } else { Some(what.join(", ")) }
    }

    /// The comparison as text.
    pub fn text(&self) -> String {
        let mut rows = vec![["node", "kind", "compared", "different"].map(str::to_owned)];
        rows.extend(self.checked.iter().map(|(node, _, tally)| self.row(*node, tally)));
        let mut text = aligned(&rows, &[2, 3]);
        for (node, _, tally) in self.different().take(SHOWN) {
            text.push_str(&format!("\n{}\n", self.differences(*node, tally)));
        }
        if let more @ 1.. = self.different().count().saturating_sub(SHOWN) {
            text.push_str(&format!("\nand {more} more that differ: use --json to list all\n"));
        }
        for (node, replayed, _) in self.checked.iter().filter(|(_, replayed, _)| !replayed.remarks.is_empty()) {
            let name = node_name(self.recording, *node);
            text.push_str(&format!("{name}: {}\n", replayed.remarks.join("; ")));
        }
        for node in &self.unchecked {
            let name = node_name(self.recording, node.node);
            text.push_str(&format!("not compared: {name}: {}\n", node.why));
        }
        for node in &self.failed {
            let name = node_name(self.recording, node.node);
            text.push_str(&format!("failed: {name}: {}\n", node.why));
        }
        let plan = self.recording.plan();
        if plan.every > 1 {
            text.push_str(&format!("only the frames with recorded values were compared: one in {}\n", plan.every));
        }
        if self.is_equal() {
            let values: u64 = self.checked.iter().map(|(.., tally)| tally.values).sum();
            text.push_str(&format!("equal: {} of {}\n", counted(values, "value"), counted(self.checked.len(), "node")));
        }
        text
    }

    fn row(&self, node: NodeRef, tally: &Tally) -> [String; 4] {
        let different = if tally.different == 0 { "-".to_owned() } else { tally.different.to_string() };
        let kind = self.recording.plan().runs[node.run].nodes[node.node].kind.clone();
        [node_name(self.recording, node), kind, tally.values.to_string(), different]
    }

    fn differences(&self, node: NodeRef, tally: &Tally) -> String {
        let name = node_name(self.recording, node);
        let (different, of) = (tally.different, counted(tally.values, "value"));
        let numbers = format!("{} of {}", tally.different_numbers, counted(tally.numbers, "number"));
        let mut text = format!("{name}: {different} of {of}, {numbers}");
        for (what, placed) in [("first", &tally.first), ("worst", &tally.worst)] {
            if let Some(placed) = placed {
                text.push_str(&format!("\n  {what}  {}", placed_text(placed)));
            }
        }
        text
    }

    /// The compared nodes for JSON.
    pub fn compared(&self) -> Vec<ComparedNode> {
        let compared = self.checked.iter().map(|(node, replayed, tally)| ComparedNode {
            node: self.node(*node),
            compared: tally.values,
            different: tally.different,
            numbers: tally.numbers,
            different_numbers: tally.different_numbers,
            first: tally.first.as_ref().map(difference),
            worst: tally.worst.as_ref().map(difference),
            remarks: replayed.remarks.clone(),
        });
        compared.collect()
    }

    /// Other nodes for JSON: those that were not compared, or failed.
    pub fn others(&self, nodes: &[Unchecked]) -> Vec<OtherNode> {
        let other = |node: &Unchecked| OtherNode { node: self.node(node.node), why: node.why.clone() };
        nodes.iter().map(other).collect()
    }

    fn node(&self, node: NodeRef) -> NodeName {
        let plan = self.recording.plan();
        let (run, node) = (&plan.runs[node.run], &plan.runs[node.run].nodes[node.node]);
        NodeName {
            stage: run.stage.clone(),
            node: node.name.clone(),
            kind: node.kind.clone(),
            version: node.version,
            variants: node.variants.iter().map(|variant| plan.variants[*variant].clone()).collect(),
        }
    }
}

/// A node's name, with its stage, and with its variants if it does not serve all variants of the stage.
pub fn node_name(recording: &Recording, node: NodeRef) -> String {
    let plan = recording.plan();
    let (run, node) = (&plan.runs[node.run], &plan.runs[node.run].nodes[node.node]);
    let name = format!("{}.{}", run.name().replace('/', "."), node.name);
    if node.variants.len() == run.variants.len() {
        return name;
    }
    let first = node.variants.first().map_or("", |variant| plan.variants[*variant].as_str());
    match node.variants.len() {
        0 | 1 => format!("{name} ({first})"),
        several => format!("{name} ({first} and {} more)", several - 1),
    }
}

fn placed_text(placed: &Placed) -> String {
    let differs = placed.differs.text(placed.value_type);
    match &placed.frame {
        Some(frame) => format!("frame {frame}, {}, {differs}", placed.topic),
        None => format!("{}, {differs}", placed.topic),
    }
}

/// A single with the digits that tell it from its neighbours, instead of those of the double it was widened to.
fn rounded(value: f64) -> Option<f64> {
    number(value).parse().ok()
}

/// A missing number is null; an infinite one is text.
fn number_json(value: Option<f64>) -> Json {
    match value {
        Some(value) if value.is_finite() => json!(rounded(value)),
        Some(value) => json!(value.to_string()),
        None => Json::Null,
    }
}

fn difference(placed: &Placed) -> NumberDifference {
    let (mut pixel, mut channel, mut byte, mut name) = (None, None, None, None);
    let (recorded, now, by) = match &placed.differs {
        Differs::Whole { recorded, now } => (json!(recorded), json!(now), None),
        Differs::Number { place, recorded, now } => {
            match place {
                Place::Pixel(x, y) => pixel = Some([*x, *y]),
                Place::Channel(x, y, of) => (pixel, channel) = (Some([*x, *y]), Some(u64::from(*of))),
                Place::Byte(at) => byte = Some(*at),
                Place::Named(of) => name = Some(of.clone()),
            }
            let by = Some(placed.differs.by()).filter(|by| by.is_finite());
            (number_json(*recorded), number_json(*now), Some(by.and_then(rounded)))
        }
    };
    NumberDifference {
        frame: placed.frame.as_deref().map(str::to_owned),
        topic: placed.topic.clone(),
        value_type: placed.value_type.name(),
        pixel,
        channel,
        byte,
        name,
        recorded,
        now,
        by,
    }
}
