//! `depthloom runs why`: why the values of two runs differ, by what their recordings say of experiment, plan, frames and keys.

use depthloom_graphs::plan::{FrameIndex, NodeId, NodeRef, RunId};
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use depthloom_graphs::Key;
use depthloom_graphs::values;
use depthloom_recording::{
    Difference as RecordedDifference, NodePair, RecordedFrame, RecordedPlan, Recording, json_differences, node_pairs,
    source_differences,
};
use depthloom_runs::environment;
use depthloom_runs::{RECORDING, open, recording_in};
use depthloom_terminal::{CliError, ExitCode, print};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Value as Json, json};

use crate::args::{RunsArgs, WhyArgs};
use crate::output;

/// The experiment as resolved, in a recording.
const RESOLVED: &str = "experiment.resolved.yaml";

/// The largest number of frames per node on which values are compared because their chunks differ.
const MOST_COMPARED: usize = 64;

/// How many variants of a node are named.
const NAMED: usize = 4;

/// Of `runs why`: in what two runs differ.
#[derive(JsonSchema, Serialize)]
pub struct RunsWhy {
    before: String,
    after: String,
    made_by: Vec<Difference>,
    experiment: Vec<Difference>,
    frames: Vec<FramesOfBoth>,
    nodes: Vec<NodeOfBoth>,
}

/// A difference: `what` says which of the other keys there are.
#[derive(Default, JsonSchema, Serialize)]
pub struct Difference {
    /// `kind`, `version`, `parameter`, `input`, `upstream` or `unseen`.
    what: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    path: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    port: Option<String>,
    // Null where there was no such parameter, or where an input was wired to nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    before: Option<Json>,
    #[serde(skip_serializing_if = "Option::is_none")]
    after: Option<Json>,
    #[serde(skip_serializing_if = "Option::is_none")]
    from: Option<Json>,
    #[serde(skip_serializing_if = "Option::is_none")]
    files: Option<Json>,
}

/// The frames of a stage in both runs.
#[derive(JsonSchema, Serialize)]
pub struct FramesOfBoth {
    stage: String,
    source: Vec<Difference>,
    both: u64,
    /// How many have equal values.
    same: u64,
    only_before: u64,
    only_after: u64,
}

/// A node of either run.
#[derive(JsonSchema, Serialize)]
pub struct NodeOfBoth {
    stage: String,
    node: String,
    variants: Vec<String>,
    same: bool,
    /// `both`, `before` or `after`.
    #[serde(rename = "in")]
    of: &'static str,
    differences: Vec<Difference>,
    frames_in_both: u64,
    frames_of_equal_values: u64,
}

/// Prints what differs between two runs, the first of which counts as the earlier.
pub fn why(args: &RunsArgs, asked: &WhyArgs) -> Result<ExitCode, CliError> {
    let recording = |run: &Path| open(&recording_in(&args.folder, run, "runs show")?);
    let compared = Compared::of(recording(&asked.before)?, recording(&asked.after)?)?;
    if args.json {
        output::print(&compared.output())?;
    } else {
        print(compared.text())?;
    }
    Ok(ExitCode::Success)
}

impl Difference {
    fn of(difference: &RecordedDifference) -> Self {
        let both = |what, before: Json, after: Json| Self {
            what,
            before: Some(before),
            after: Some(after),
            ..Self::default()
        };
        match difference {
            RecordedDifference::Kind { before, after } => both("kind", json!(before), json!(after)),
            RecordedDifference::Version { before, after } => both("version", json!(before), json!(after)),
            RecordedDifference::Parameter { path, before, after } => {
                Self { path: Some(path.clone()), ..both("parameter", json!(before), json!(after)) }
            }
            RecordedDifference::Input { port, before, after } => {
                Self { port: Some(port.clone()), ..both("input", json!(before), json!(after)) }
            }
            RecordedDifference::Upstream { port, from } => {
                let (port, from) = (Some(port.clone()), Some(json!(from)));
                Self { what: "upstream", port, from, ..Self::default() }
            }
            RecordedDifference::Unseen { files } => {
                Self { what: "unseen", files: Some(json!(files)), ..Self::default() }
            }
        }
    }
}

/// Two recordings side by side.
struct Compared {
    before: Recording,
    after: Recording,
    experiment: Vec<RecordedDifference>,
    made_by: Vec<RecordedDifference>,
    frames: Vec<Frames>,
    nodes: Vec<Node>,
}

/// The frames of a stage run of the later recording, and of its counterpart.
struct Frames {
    stage: String,
    /// What differs between the sources.
    source: Vec<RecordedDifference>,
    /// Of the frames in both, the positions, and whether the source's values are the same.
    both: Vec<(FrameIndex, FrameIndex, bool)>,
    /// Stage runs in the earlier and later recording; one of them may have none.
    runs: (Option<RunId>, Option<RunId>),
    only_before: usize,
    only_after: usize,
}

/// A node of both, or of one.
struct Node {
    pair: NodePair,
    /// Of how many frames in both it has the same values, and of how many it has any in both.
    same: usize,
    both: usize,
    /// The first frame on which its stored values differ although their cache keys are equal.
    unequal: Option<String>,
}

impl Compared {
    fn of(before: Recording, after: Recording) -> Result<Self, CliError> {
        let experiment = json_differences(&resolved(&before)?, &resolved(&after)?);
        let made_by = json_differences(&engine(&before), &engine(&after)).into_iter().filter(is_of_both).collect();
        let frames = frames(&before, &after);
        let nodes = node_pairs(before.plan(), after.plan()).into_iter();
        let nodes = nodes.map(|pair| Node::of(pair, &before, &after, &frames)).collect();
        Ok(Self { before, after, experiment, made_by, frames, nodes })
    }

    fn text(&self) -> String {
        let mut text = format!("from {}\nto   {}\n", name(&self.before), name(&self.after));
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
        let label = |node: &Node| node.label(self.plans());
        let told: Vec<&Node> = self.nodes.iter().filter(|node| self.is_told(node)).collect();
        let of = |verdict: Verdict| told.iter().copied().filter(move |node| node.verdict() == verdict);
        let widest = of(Verdict::Differs).map(|node| label(node).chars().count()).max().unwrap_or(0);
        section(
            "nodes",
            of(Verdict::Differs).map(|node| format!("{:widest$}  {}", label(node), node.text())).collect(),
        );
        section("nodes that follow, for they read those", listed(of(Verdict::Follows).map(label)));
        let fed = |node: &Node| format!("{} ({} of {} equal)", label(node), node.same, node.both);
        section("nodes that are the same, but read other values", listed(of(Verdict::Fed).map(fed)));
        let unequal =
            |node: &Node| format!("{} (first on {})", label(node), node.unequal.as_deref().unwrap_or_default());
        section(
            "nodes with equal cache keys and different values: the keys lack what changed (a variable, a file, an order)",
            listed(of(Verdict::Unequal).map(unequal)),
        );
        let same = of(Verdict::Same).count();
        let nodes = match (told.len(), same) {
            (0, _) => "no node is of both",
            (all, same) if all == same => "all nodes are the same",
            (_, 0) => "no node is the same",
            (_, 1) => "1 node is the same",
            (_, same) => &format!("{same} nodes are the same"),
        };
        let values = match same {
            0 => "",
            _ if of(Verdict::Same).all(|node| node.both == 0) => {
                "; no values were compared, because no frame with values is in both runs"
            }
            1 => ", and so are its values on all frames in both",
            _ => ", and so are their values on all frames in both",
        };
        text.push_str(&format!("\n{nodes}{values}\n"));
        text
    }

    /// The variants that one of them alone has, where they have others in common.
    fn variants(&self) -> Vec<String> {
        let (before, after) = self.plans();
        let only = |of: &RecordedPlan, other: &RecordedPlan, which: &str| {
            let names: Vec<&str> =
                of.variants.iter().filter(|name| !other.variants.contains(name)).map(String::as_str).collect();
            (!names.is_empty() && names.len() < of.variants.len())
                .then(|| format!("only {which}: {}", names.join(", ")))
        };
        only(before, after, "before").into_iter().chain(only(after, before, "after")).collect()
    }

    /// Whether people are told of a node: not of those that are of a stage or variant which one of the runs lacks, for that is said already.
    fn is_told(&self, node: &Node) -> bool {
        let (before, after) = self.plans();
        let has_stage = |plan: &RecordedPlan| plan.runs.iter().any(|run| run.stage == node.pair.stage);
        let has_some = before.variants.iter().any(|name| after.variants.contains(name));
        let is_in_both = |name: &String| before.variants.contains(name) && after.variants.contains(name);
        let variants = &node.pair.variants;
        has_stage(before) && has_stage(after) && (!has_some || variants.is_empty() || variants.iter().any(is_in_both))
    }

    fn output(&self) -> RunsWhy {
        let list = |of: &[RecordedDifference]| of.iter().map(Difference::of).collect::<Vec<_>>();
        let frames = self.frames.iter().map(|frames| FramesOfBoth {
            stage: frames.stage.clone(),
            source: list(&frames.source),
            both: frames.both.len() as u64,
            same: frames.same() as u64,
            only_before: frames.only_before as u64,
            only_after: frames.only_after as u64,
        });
        let nodes = self.nodes.iter().map(|node| NodeOfBoth {
            stage: node.pair.stage.clone(),
            node: node.pair.name.clone(),
            variants: node.pair.variants.clone(),
            same: node.is_same(),
            of: match (node.pair.before, node.pair.after) {
                (Some(_), Some(_)) => "both",
                (Some(_), None) => "before",
                (None, _) => "after",
            },
            differences: list(&node.pair.differences),
            frames_in_both: node.both as u64,
            frames_of_equal_values: node.same as u64,
        });
        RunsWhy {
            before: name(&self.before),
            after: name(&self.after),
            made_by: list(&self.made_by),
            experiment: list(&self.experiment),
            frames: frames.collect(),
            nodes: nodes.collect(),
        }
    }

    fn plans(&self) -> (&RecordedPlan, &RecordedPlan) {
        (self.before.plan(), self.after.plan())
    }
}

/// How two nodes compare.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// The same, and so are its values.
    Same,
    /// The same, but its values are not: it was given others.
    Fed,
    /// The same by its cache keys, and with other values: the keys lack what decides them.
    Unequal,
    /// Another only for what it reads is.
    Follows,
    /// Another by itself.
    Differs,
}

/// A list on lines of a readable length, of which no more are shown than a screen takes.
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

/// How a recording is called: its run's folder, or the file if it is called otherwise.
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
        let what = format!("the experiment that {} holds is no YAML: {error}", recording.path().display());
        CliError::usage(what, "run the experiment again")
    })
}

/// What computed a run, if it lies beside its recording: version, system and engine, not how long it took.
fn engine(recording: &Recording) -> Json {
    let environment = folder(recording).map(|folder| environment::of(&folder)).unwrap_or_default();
    let Json::Object(mut environment) = environment else { return json!({}) };
    environment.retain(|key, _| ["depthloom", "os", "architecture", "networks"].contains(&key.as_str()));
    if let Some(Json::Object(networks)) = environment.get_mut("networks") {
        networks.retain(|key, _| ["engine", "version", "build", "ran_on"].contains(&key.as_str()));
    }
    Json::Object(environment)
}

/// A run that computed no network names no engine of networks.
fn is_of_both(difference: &RecordedDifference) -> bool {
    let is_something = |side: &Option<Json>| side.as_ref().is_some_and(|side| !side.is_null());
    !matches!(difference, RecordedDifference::Parameter { before, after, .. } if !(is_something(before) && is_something(after)))
}

/// The stage runs side by side: by stage, and where a stage has several, by the names of their variants.
fn frames(before: &Recording, after: &Recording) -> Vec<Frames> {
    let (one, other) = (before.plan(), after.plan());
    let names = |plan: &RecordedPlan, run: RunId| -> Vec<String> {
        plan.runs[run].variants.iter().filter_map(|&variant| plan.variants.get(variant.0).cloned()).collect()
    };
    let mut taken = Vec::new();
    let mut found: Vec<Frames> = Vec::new();
    for run in RunId::all(other.runs.len()) {
        let of_stage: Vec<RunId> =
            RunId::all(one.runs.len()).filter(|&was| one.runs[was].stage == other.runs[run].stage).collect();
        let mine = names(other, run);
        let shares = |&&was: &&RunId| names(one, was).iter().any(|name| mine.contains(name));
        let was = of_stage.iter().find(shares).or(of_stage.first()).copied();
        taken.extend(was);
        found.push(Frames::of(before, was, after, Some(run)));
    }
    let gone = RunId::all(one.runs.len()).filter(|run| !taken.contains(run));
    found.extend(gone.map(|run| Frames::of(before, Some(run), after, None)));
    found
}

impl Frames {
    fn of(before: &Recording, was: Option<RunId>, after: &Recording, is: Option<RunId>) -> Self {
        let earlier = was.map_or(&[][..], |run| before.frames(run));
        let later = is.map_or(&[][..], |run| after.frames(run));
        // Sources that are joined may repeat an id: then the first is held against the first.
        let mut places: BTreeMap<(&str, u64), VecDeque<FrameIndex>> = BTreeMap::new();
        for (position, frame) in FrameIndex::enumerate(earlier) {
            places.entry((&*frame.id, frame.index)).or_default().push_back(position);
        }
        let mut both = Vec::new();
        for (position, frame) in FrameIndex::enumerate(later) {
            let Some(was) = places.get_mut(&(&*frame.id, frame.index)).and_then(VecDeque::pop_front) else { continue };
            both.push((was, position, earlier[was].source_key == frame.source_key));
        }
        let (one, other) = (was.map(|run| &before.plan().runs[run]), is.map(|run| &after.plan().runs[run]));
        let source = match (one, other) {
            (Some(one), Some(other)) => source_differences(&one.source, &other.source),
            _ => Vec::new(),
        };
        let stage = other.or(one).map(|run| run.name().to_owned()).unwrap_or_default();
        let (only_before, only_after) = (earlier.len() - both.len(), later.len() - both.len());
        Self { stage, source, both, runs: (was, is), only_before, only_after }
    }

    fn same(&self) -> usize {
        self.both.iter().filter(|(_, _, same)| *same).count()
    }

    fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> =
            self.source.iter().map(|difference| format!("source of {}: {difference}", self.stage)).collect();
        let both = self.both.len();
        let same = match self.same() {
            _ if both == 0 => String::new(),
            0 => ", none of equal source values".to_owned(),
            same if same == both => ", all of equal source values".to_owned(),
            same => format!(", {same} of equal source values"),
        };
        let only = |count: usize, which: &str| match count {
            0 => String::new(),
            count => format!(", {count} {which}"),
        };
        let (before, after) = (only(self.only_before, "only before"), only(self.only_after, "only after"));
        lines.push(match self.runs {
            (Some(_), Some(_)) => format!("{}: {both} in both{same}{before}{after}", self.stage),
            (Some(_), None) => format!("{}: a stage that is gone", self.stage),
            (None, _) => format!("{}: a new stage", self.stage),
        });
        lines
    }
}

/// The frames of both on which stored values of a node differ although their cache keys are equal.
fn unequal(before: &Recording, one: NodeRef, after: &Recording, other: NodeRef, frames: &[Frames]) -> Vec<String> {
    let outputs = |recording: &Recording, NodeRef { run, node }: NodeRef| -> Vec<(String, String)> {
        let outputs = recording.plan().runs[run].nodes[node].outputs.iter();
        let stored = outputs.filter(|output| output.recorded && !output.once);
        stored.map(|output| (output.port.clone(), output.topic.clone())).collect()
    };
    let later = outputs(after, other);
    let key = |frame: &RecordedFrame, node: NodeId| frame.keys.iter().find(|of| of.node == node).map(|of| of.key);
    let mut found = Vec::new();
    for (port, topic) in outputs(before, one) {
        let Some((_, later_topic)) = later.iter().find(|(later, _)| *later == port) else { continue };
        let digests = (before.value_digests(one.run, &topic), after.value_digests(other.run, later_topic));
        let (Ok(earlier), Ok(later)) = digests else { continue };
        let readers = (before.reader(one.run, &[&topic]), after.reader(other.run, &[later_topic]));
        let (Ok(mut earlier_values), Ok(mut later_values)) = readers else { continue };
        for frames in frames.iter().filter(|frames| frames.runs == (Some(one.run), Some(other.run))) {
            // Chunks of equal values differ where runs have other topics: then the values are compared, of some frames.
            let mut looked = 0;
            for &(was, is, _) in &frames.both {
                let (first, second) = (&before.frames(one.run)[was], &after.frames(other.run)[is]);
                let is_suspect = key(first, one.node) == key(second, other.node)
                    && earlier[was].zip(later[is]).is_some_and(|(earlier, later)| earlier != later);
                if !is_suspect || looked == MOST_COMPARED || found.contains(&second.id.to_string()) {
                    continue;
                }
                looked += 1;
                let (Ok(earlier), Ok(later)) = (earlier_values.read(was), later_values.read(is)) else { continue };
                let differs = earlier.iter().zip(&later).any(|both| match both {
                    (Some(earlier), Some(later)) => values::Difference::between(earlier, later, 0.0).first.is_some(),
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
    fn of(pair: NodePair, before: &Recording, after: &Recording, frames: &[Frames]) -> Self {
        let (Some(one), Some(other)) = (pair.before, pair.after) else {
            return Self { pair, same: 0, both: 0, unequal: None };
        };
        let key = |frame: &RecordedFrame, node: NodeId| frame.keys.iter().find(|of| of.node == node).map(|of| of.key);
        let (mut same, mut both) = (0, 0);
        let mut add = |was: Option<Key>, is: Option<Key>| {
            if let (Some(was), Some(is)) = (was, is) {
                both += 1;
                same += usize::from(was == is);
            }
        };
        for frames in frames.iter().filter(|frames| frames.runs == (Some(one.run), Some(other.run))) {
            for &(was, is, _) in &frames.both {
                add(key(&before.frames(one.run)[was], one.node), key(&after.frames(other.run)[is], other.node));
            }
        }
        let once = |recording: &Recording, NodeRef { run, node }: NodeRef| {
            recording.once_values().iter().find(|once| (once.run, once.node) == (run, node)).map(|once| once.key)
        };
        add(once(before, one), once(after, other));
        let unequal = unequal(before, one, after, other, frames);
        same -= unequal.len();
        Self { unequal: unequal.into_iter().next(), pair, same, both }
    }

    /// Whether it is the same, and so are its values wherever both have any.
    fn is_same(&self) -> bool {
        self.verdict() == Verdict::Same
    }

    fn verdict(&self) -> Verdict {
        let is_in_both = self.pair.before.is_some() && self.pair.after.is_some();
        let follows = |difference: &RecordedDifference| matches!(difference, RecordedDifference::Upstream { .. });
        match self.pair.differences.as_slice() {
            [] if self.unequal.is_some() => Verdict::Unequal,
            [] if is_in_both && self.same == self.both => Verdict::Same,
            [] if is_in_both => Verdict::Fed,
            [] => Verdict::Differs,
            all if all.iter().all(follows) => Verdict::Follows,
            _ => Verdict::Differs,
        }
    }

    /// `stage.node`, with its variants where it does not serve them all.
    fn label(&self, (before, after): (&RecordedPlan, &RecordedPlan)) -> String {
        let NodePair { stage, name, variants, .. } = &self.pair;
        let all = if self.pair.after.is_some() { &after.variants } else { &before.variants };
        if variants.is_empty() || variants.len() == all.len() {
            return format!("{stage}.{name}");
        }
        let more = if variants.len() > NAMED { ", ..." } else { "" };
        format!("{stage}.{name} of {}{more}", variants[..variants.len().min(NAMED)].join(", "))
    }

    fn text(&self) -> String {
        match (self.pair.before, self.pair.after) {
            (None, _) => "is new".to_owned(),
            (_, None) => "is gone".to_owned(),
            _ => self.pair.differences.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
        }
    }
}
