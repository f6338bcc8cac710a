//! Why the values of two runs differ: compares experiment, plan, frames and cache keys of their recordings.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use depthloom_graphs::Key;
use depthloom_graphs::plan::{FrameIndex, NodeId, NodeRef, RunId};
use depthloom_graphs::values::ValueDifference;
use depthloom_recording::{
    NodePair, PlanDifference, RecordedFrame, RecordedPlan, Recording, json_differences, node_pairs, source_differences,
};
use depthloom_runs::{RECORDING, environment};
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Value as Json, json};

const RESOLVED: &str = "experiment.resolved.yaml";

/// The largest number of frames per node on which values are compared because their chunks differ.
const MOST_COMPARED: usize = 64;

/// The number of variants of a node that are named.
const NAMED: usize = 4;

/// The output of `runs diff`: the differences between two runs.
#[derive(JsonSchema, Serialize)]
pub struct RunDifference {
    before: String,
    after: String,
    made_by: Vec<PlanDifference>,
    experiment: Vec<PlanDifference>,
    frames: Vec<Frames>,
    nodes: Vec<Node>,
    #[serde(skip)]
    plans: (RecordedPlan, RecordedPlan),
}

/// The frames of a stage in both runs.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Frames {
    stage: String,
    source: Vec<PlanDifference>,
    both: u64,
    /// The number of frames with equal source values.
    same: u64,
    only_before: u64,
    only_after: u64,
    /// The positions of the frames in both.
    #[serde(skip)]
    positions: Vec<(FrameIndex, FrameIndex)>,
    /// The stage runs in the earlier and later recording; one of them may be missing.
    #[serde(skip)]
    runs: (Option<RunId>, Option<RunId>),
}

/// A node of either run.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Node {
    stage: String,
    node: String,
    variants: Vec<String>,
    same: bool,
    /// `both`, `before` or `after`.
    #[serde(rename = "in")]
    runs: &'static str,
    differences: Vec<PlanDifference>,
    frames_in_both: u64,
    frames_of_equal_values: u64,
    /// The first frame on which its stored values differ although their cache keys are equal.
    #[serde(skip)]
    unequal: Option<String>,
    /// Its name, with its variants if it does not serve all.
    #[serde(skip)]
    label: String,
}

impl RunDifference {
    /// Compares two runs, the first of which counts as the earlier.
    ///
    /// # Errors
    /// If a recording does not contain its experiment.
    pub fn new(before: &Recording, after: &Recording) -> Result<Self, CliError> {
        let frames = frames(before, after);
        let pairs = node_pairs(before.plan(), after.plan()).into_iter();
        Ok(Self {
            before: name(before),
            after: name(after),
            made_by: json_differences(&engine(before), &engine(after)).into_iter().filter(is_in_both).collect(),
            experiment: json_differences(&resolved(before)?, &resolved(after)?),
            nodes: pairs.map(|pair| Node::new(pair, before, after, &frames)).collect(),
            frames,
            plans: (before.plan().clone(), after.plan().clone()),
        })
    }

    /// The differences as text.
    pub fn text(&self) -> String {
        let mut text = format!("from {}\nto   {}\n", self.before, self.after);
        let mut section = |title: &str, lines: Vec<String>| {
            if !lines.is_empty() {
                text.push_str(&format!("\n{title}\n"));
                lines.iter().for_each(|line| text.push_str(&format!("  {line}\n")));
            }
        };
        section("made by", self.made_by.iter().map(ToString::to_string).collect());
        section("experiment", self.experiment.iter().map(ToString::to_string).collect());
        section("frames", self.frames.iter().flat_map(Frames::lines).collect());
        section("variants", self.variants());
        let shown: Vec<&Node> = self.nodes.iter().filter(|node| self.is_shown(node)).collect();
        let with_verdict = |verdict: Verdict| shown.iter().copied().filter(move |node| node.verdict() == verdict);
        let widest = with_verdict(Verdict::Differs).map(|node| node.label.chars().count()).max().unwrap_or(0);
        section(
            "nodes",
            with_verdict(Verdict::Differs).map(|node| format!("{:widest$}  {}", node.label, node.text())).collect(),
        );
        section(
            "nodes that differ because they read those",
            listed(with_verdict(Verdict::Follows).map(|node| node.label.clone())),
        );
        let fed =
            |node: &Node| format!("{} ({} of {} equal)", node.label, node.frames_of_equal_values, node.frames_in_both);
        section("equal nodes that read other values", listed(with_verdict(Verdict::Fed).map(fed)));
        let unequal =
            |node: &Node| format!("{} (first on {})", node.label, node.unequal.as_deref().unwrap_or_default());
        section(
            "nodes with equal cache keys but different values: the keys do not include what changed (a variable, a file, an order)",
            listed(with_verdict(Verdict::Unequal).map(unequal)),
        );
        let same = with_verdict(Verdict::Same).count();
        let nodes = match (shown.len(), same) {
            (0, _) => "no node is in both runs",
            (all, same) if all == same => "all nodes are the same",
            (_, 0) => "no node is the same",
            (_, 1) => "1 node is the same",
            (_, same) => &format!("{same} nodes are the same"),
        };
        let values = match same {
            0 => "",
            _ if with_verdict(Verdict::Same).all(|node| node.frames_in_both == 0) => {
                "; no values were compared, because no frame with values is in both runs"
            }
            1 => ", and so are its values on all frames in both",
            _ => ", and so are their values on all frames in both",
        };
        text.push_str(&format!("\n{nodes}{values}\n"));
        text
    }

    /// The variants that only one of them has, if they share others.
    fn variants(&self) -> Vec<String> {
        let (before, after) = &self.plans;
        let only = |plan: &RecordedPlan, other: &RecordedPlan, which: &str| {
            let names = plan.variants.iter().filter(|name| !other.variants.contains(name));
            let names: Vec<&str> = names.map(String::as_str).collect();
            let is_part = !names.is_empty() && names.len() < plan.variants.len();
            is_part.then(|| format!("only {which}: {}", names.join(", ")))
        };
        only(before, after, "before").into_iter().chain(only(after, before, "after")).collect()
    }

    /// Whether the text shows a node: not if one of the runs lacks its stage or variant, which is printed already.
    fn is_shown(&self, node: &Node) -> bool {
        let (before, after) = &self.plans;
        let has_stage = |plan: &RecordedPlan| plan.runs.iter().any(|run| run.stage == node.stage);
        let is_in_both = |name: &String| before.variants.contains(name) && after.variants.contains(name);
        let has_some = before.variants.iter().any(is_in_both);
        let variants = &node.variants;
        has_stage(before) && has_stage(after) && (!has_some || variants.is_empty() || variants.iter().any(is_in_both))
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// The node and its values are equal.
    Same,
    /// The node is equal, but it read other values.
    Fed,
    /// The cache keys are equal, but not the values: the keys do not include what changed.
    Unequal,
    /// It differs only because a node that it reads differs.
    Follows,
    /// The node itself differs.
    Differs,
}

/// A list in lines of readable length, limited to about a screen.
fn listed(names: impl Iterator<Item = String>) -> Vec<String> {
    const SHOWN: usize = 24;
    const WIDE: usize = 100;
    let mut names: Vec<String> = names.collect();
    if names.len() > SHOWN {
        let more = names.len() - SHOWN;
        names.truncate(SHOWN);
        names.push(format!("and {more} more, which --json lists"));
    }
    let mut lines: Vec<String> = Vec::new();
    for name in names {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 2 + name.chars().count() <= WIDE => {
                line.push_str(", ");
                line.push_str(&name);
            }
            _ => lines.push(name),
        }
    }
    lines
}

/// The name of a recording: its run's folder, or the file if it has another name.
fn name(recording: &Recording) -> String {
    folder(recording).unwrap_or_else(|| recording.path().to_owned()).display().to_string()
}

fn folder(recording: &Recording) -> Option<PathBuf> {
    let path = recording.path();
    path.parent().filter(|_| path.file_name().is_some_and(|name| name == RECORDING)).map(Path::to_owned)
}

fn resolved(recording: &Recording) -> Result<Json, CliError> {
    let bytes = recording.attachment(RESOLVED).map_err(|error| {
        let exit = if error.is_damage() { ExitCode::FrameFailures } else { ExitCode::Usage };
        CliError::remedied(exit, "failed to read the experiment", &error)
    })?;
    serde_saphyr::from_slice(&bytes).map_err(|error| {
        let what = format!("the experiment in {} is not YAML: {error}", recording.path().display());
        CliError::usage(what, "run the experiment again")
    })
}

/// What computed a run, if it is stored beside its recording: version, system and engine, but not times.
fn engine(recording: &Recording) -> Json {
    let environment = folder(recording).map(|folder| environment::read(&folder)).unwrap_or_default();
    let Json::Object(mut environment) = environment else { return json!({}) };
    environment.retain(|key, _| ["depthloom", "os", "architecture", "networks"].contains(&key.as_str()));
    if let Some(Json::Object(networks)) = environment.get_mut("networks") {
        networks.retain(|key, _| ["engine", "version", "build", "ran_on"].contains(&key.as_str()));
    }
    Json::Object(environment)
}

/// A run without networks does not name an engine.
fn is_in_both(difference: &PlanDifference) -> bool {
    let is_something = |side: &Option<Json>| side.as_ref().is_some_and(|side| !side.is_null());
    !matches!(difference, PlanDifference::Parameter { before, after, .. } if !(is_something(before) && is_something(after)))
}

/// The stage runs in pairs: by stage, and if a stage has several, by the names of their variants.
fn frames(before: &Recording, after: &Recording) -> Vec<Frames> {
    let (earlier, later) = (before.plan(), after.plan());
    let names = |plan: &RecordedPlan, run: RunId| -> Vec<String> {
        plan.runs[run].variants.iter().filter_map(|&variant| plan.variants.get(variant.0).cloned()).collect()
    };
    let mut paired = Vec::new();
    let mut frames: Vec<Frames> = Vec::new();
    for run in RunId::all(later.runs.len()) {
        let same_stage = |was: &RunId| earlier.runs[*was].stage == later.runs[run].stage;
        let candidates: Vec<RunId> = RunId::all(earlier.runs.len()).filter(same_stage).collect();
        let own = names(later, run);
        let shares = |&&was: &&RunId| names(earlier, was).iter().any(|name| own.contains(name));
        let was = candidates.iter().find(shares).or(candidates.first()).copied();
        paired.extend(was);
        frames.push(Frames::new(before, was, after, Some(run)));
    }
    let gone = RunId::all(earlier.runs.len()).filter(|run| !paired.contains(run));
    frames.extend(gone.map(|run| Frames::new(before, Some(run), after, None)));
    frames
}

impl Frames {
    fn new(before: &Recording, was: Option<RunId>, after: &Recording, is: Option<RunId>) -> Self {
        let earlier = was.map_or(&[][..], |run| before.frames(run));
        let later = is.map_or(&[][..], |run| after.frames(run));
        // Concatenated sources may repeat an id: then the first is compared with the first.
        let mut places: BTreeMap<(&str, u64), VecDeque<FrameIndex>> = BTreeMap::new();
        for (position, frame) in FrameIndex::enumerate(earlier) {
            places.entry((&*frame.id, frame.index)).or_default().push_back(position);
        }
        let (mut positions, mut same) = (Vec::new(), 0);
        for (position, frame) in FrameIndex::enumerate(later) {
            let Some(was) = places.get_mut(&(&*frame.id, frame.index)).and_then(VecDeque::pop_front) else { continue };
            positions.push((was, position));
            same += u64::from(earlier[was].source_key == frame.source_key);
        }
        let (one, other) = (was.map(|run| &before.plan().runs[run]), is.map(|run| &after.plan().runs[run]));
        Self {
            stage: other.or(one).map(|run| run.name().to_owned()).unwrap_or_default(),
            source: one
                .zip(other)
                .map(|(one, other)| source_differences(&one.source, &other.source))
                .unwrap_or_default(),
            both: positions.len() as u64,
            same,
            only_before: (earlier.len() - positions.len()) as u64,
            only_after: (later.len() - positions.len()) as u64,
            positions,
            runs: (was, is),
        }
    }

    fn lines(&self) -> Vec<String> {
        let stage = &self.stage;
        let source = self.source.iter().map(|difference| format!("source of {stage}: {difference}"));
        let same = match (self.both, self.same) {
            (0, _) => String::new(),
            (_, 0) => ", none with equal source values".to_owned(),
            (both, same) if same == both => ", all with equal source values".to_owned(),
            (_, same) => format!(", {same} with equal source values"),
        };
        let only = |count: u64, which: &str| match count {
            0 => String::new(),
            count => format!(", {count} {which}"),
        };
        let (before, after) = (only(self.only_before, "only before"), only(self.only_after, "only after"));
        let frames = match self.runs {
            (Some(_), Some(_)) => format!("{stage}: {} in both{same}{before}{after}", self.both),
            (Some(_), None) => format!("{stage}: the stage was removed"),
            (None, _) => format!("{stage}: a new stage"),
        };
        source.chain([frames]).collect()
    }
}

/// The cache key of a node's values on a frame.
fn key(frame: &RecordedFrame, node: NodeId) -> Option<Key> {
    frame.keys.iter().find(|entry| entry.node == node).map(|entry| entry.key)
}

/// The frames in both runs on which stored values of a node differ although their cache keys are equal.
fn unequal(before: &Recording, one: NodeRef, after: &Recording, other: NodeRef, frames: &[Frames]) -> Vec<String> {
    let outputs = |recording: &Recording, NodeRef { run, node }: NodeRef| -> Vec<(String, String)> {
        let outputs = recording.plan().runs[run].nodes[node].outputs.iter();
        let stored = outputs.filter(|output| output.recorded && !output.once);
        stored.map(|output| (output.port.clone(), output.topic.clone())).collect()
    };
    let later = outputs(after, other);
    let mut found = Vec::new();
    for (port, topic) in outputs(before, one) {
        let Some((_, later_topic)) = later.iter().find(|(later, _)| *later == port) else { continue };
        let digests = (before.value_digests(one.run, &topic), after.value_digests(other.run, later_topic));
        let (Ok(earlier), Ok(later)) = digests else { continue };
        let readers = (before.reader(one.run, &[&topic]), after.reader(other.run, &[later_topic]));
        let (Ok(mut earlier_values), Ok(mut later_values)) = readers else { continue };
        for frames in frames.iter().filter(|frames| frames.runs == (Some(one.run), Some(other.run))) {
            // Chunks of equal values differ if the runs have different topics: then the values of some frames are
            // compared.
            let mut compared = 0;
            for &(was, is) in &frames.positions {
                let (first, second) = (&before.frames(one.run)[was], &after.frames(other.run)[is]);
                let is_suspect = key(first, one.node) == key(second, other.node)
                    && earlier[was].zip(later[is]).is_some_and(|(earlier, later)| earlier != later);
                if !is_suspect || compared == MOST_COMPARED || found.contains(&second.id.to_string()) {
                    continue;
                }
                compared += 1;
                let (Ok(earlier), Ok(later)) = (earlier_values.read(was), later_values.read(is)) else { continue };
                let differs = earlier.iter().zip(&later).any(|both| match both {
                    (Some(earlier), Some(later)) => ValueDifference::between(earlier, later, 0.0).first.is_some(),
                    _ => false,
                });
                if differs {
                    found.push(second.id.to_string());
                }
            }
        }
    }
    found
}

impl Node {
    fn new(pair: NodePair, before: &Recording, after: &Recording, frames: &[Frames]) -> Self {
        let (mut same, mut both) = (0, 0);
        let mut unequal = Vec::new();
        if let (Some(one), Some(other)) = (pair.before, pair.after) {
            let mut add = |was: Option<Key>, is: Option<Key>| {
                if let (Some(was), Some(is)) = (was, is) {
                    both += 1;
                    same += u64::from(was == is);
                }
            };
            for frames in frames.iter().filter(|frames| frames.runs == (Some(one.run), Some(other.run))) {
                for &(was, is) in &frames.positions {
                    add(key(&before.frames(one.run)[was], one.node), key(&after.frames(other.run)[is], other.node));
                }
            }
            let once = |recording: &Recording, NodeRef { run, node }: NodeRef| {
                recording
                    .aggregate_values()
                    .iter()
                    .find(|once| (once.run, once.node) == (run, node))
                    .map(|once| once.key)
            };
            add(once(before, one), once(after, other));
            unequal = self::unequal(before, one, after, other, frames);
            same -= unequal.len() as u64;
        }
        let runs = match (pair.before, pair.after) {
            (Some(_), Some(_)) => "both",
            (Some(_), None) => "before",
            (None, _) => "after",
        };
        let label = pair.label(if pair.after.is_some() { after.plan() } else { before.plan() }, NAMED);
        let mut node = Self {
            stage: pair.stage,
            node: pair.name,
            variants: pair.variants,
            same: false,
            runs,
            differences: pair.differences,
            frames_in_both: both,
            frames_of_equal_values: same,
            unequal: unequal.into_iter().next(),
            label,
        };
        node.same = node.verdict() == Verdict::Same;
        node
    }

    fn verdict(&self) -> Verdict {
        let is_in_both = self.runs == "both";
        match self.differences.as_slice() {
            [] if self.unequal.is_some() => Verdict::Unequal,
            [] if is_in_both && self.frames_of_equal_values == self.frames_in_both => Verdict::Same,
            [] if is_in_both => Verdict::Fed,
            [] => Verdict::Differs,
            all if all.iter().all(PlanDifference::is_upstream) => Verdict::Follows,
            _ => Verdict::Differs,
        }
    }

    fn text(&self) -> String {
        match self.runs {
            "after" => "is new".to_owned(),
            "before" => "was removed".to_owned(),
            _ => self.differences.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
        }
    }
}
