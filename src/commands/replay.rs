//! `depthloom replay`: nodes made again from a recording, and compared with it.

use depthloom_graphs::plan::NodeRef;
use std::sync::Arc;

use depthloom_graphs::language::nearest;
use depthloom_graphs::values::{Differs, Place, number};
use depthloom_graphs::{Registry, counted};
use depthloom_recording::Recording;
use depthloom_runner::{Options, run};
use depthloom_runs::open;
use depthloom_runs::{recording_of, run_failed};
use depthloom_terminal::{CliError, ExitCode, aligned, print, say};
use depthloom_verify::{Checker, Outcome, Placed, Tally, Tolerances, Unchecked};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Value as Json, json};

use crate::allow_exec;
use crate::args::ReplayArgs;
use crate::diagnostics::Error;
use crate::output;
use crate::progress::Progress;
use crate::signals;

/// How many nodes that differ are told one by one; with `--json` all are.
const TOLD: usize = 20;

/// Of `replay`: whether nodes make again what was recorded.
#[derive(JsonSchema, Serialize)]
pub struct Replay {
    run: String,
    /// The nodes that were named.
    asked: Vec<String>,
    equal: bool,
    /// Of how many frames values were kept.
    every: u64,
    nodes: Vec<Replayed>,
    not_compared: Vec<NotReplayed>,
    failed: Vec<NotReplayed>,
    damage: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// A node that was made again.
#[derive(JsonSchema, Serialize)]
pub struct Replayed {
    stage: String,
    node: String,
    kind: String,
    version: u32,
    variants: Vec<String>,
    /// How many values were compared.
    compared: u64,
    different: u64,
    numbers: u64,
    different_numbers: u64,
    first: Option<Difference>,
    worst: Option<Difference>,
    remarks: Vec<String>,
}

/// A node that was not compared, or failed.
#[derive(JsonSchema, Serialize)]
pub struct NotReplayed {
    stage: String,
    node: String,
    kind: String,
    version: u32,
    variants: Vec<String>,
    why: String,
}

/// Where a value differs.
#[derive(JsonSchema, Serialize)]
pub struct Difference {
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
    /// A number, a text, or null where there is no answer.
    recorded: Json,
    now: Json,
    // Of numbers; null where they do not differ by a finite number.
    #[serde(skip_serializing_if = "Option::is_none")]
    by: Option<Option<f64>>,
}

/// Makes nodes again and says whether their values are those recorded.
pub fn replay(args: &ReplayArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    allow_exec::decide(args.exec, None)?;
    let path = recording_of(&args.run, "replay")?;
    let interrupt = signals::listen("stopping: nothing is written")?;
    let recording = Arc::new(open(&path)?);
    let mut replay = depthloom_verify::Replay::new(&recording, registry, &args.nodes)
        .map_err(|pattern| unknown(&recording, &pattern))?;
    let unchecked = std::mem::take(&mut replay.unchecked);
    refuse(args, &recording, &replay, &unchecked)?;

    let default = Options::default();
    let options = Options { workers: args.workers.map_or(default.workers, usize::from), keep_going: true, ..default };
    let progress = Progress::new(&replay.ready.plan, true);
    let checker = Checker::new(Arc::clone(&recording), &mut replay, Tolerances::of(&args.tolerance));
    let report = run(replay.ready, &checker, &options, &progress, &interrupt).map_err(|error| run_failed(&error))?;
    if report.interrupted {
        return Err(CliError::new(ExitCode::Interrupted, "interrupted: not all was compared"));
    }

    let Outcome { checked, behind, failed, mut damage } = checker.finish();
    damage.extend(unchecked.iter().filter(|unchecked| unchecked.is_damage).map(|unchecked| unchecked.why.clone()));
    let unchecked = unchecked.into_iter().chain(behind).collect();
    let told = Told { recording: &recording, checked, unchecked, failed };
    let verdict = told.verdict(&damage);
    if args.output.json {
        output::print(&told.output(args, damage, verdict.as_ref()))?;
    } else {
        print(told.text())?;
        damage.iter().take(TOLD).for_each(|what| say(format_args!("damaged: {what}")));
    }
    Ok(verdict.map_or(ExitCode::Success, |stop| {
        say(&stop.message.what);
        stop.exit
    }))
}

/// What is to be said where a pattern names no node.
fn unknown(recording: &Recording, pattern: &str) -> CliError {
    let runs = &recording.plan().runs;
    let names: Vec<String> = runs
        .iter()
        .flat_map(|run| run.nodes.iter().flat_map(|node| [node.name.clone(), format!("{}.{}", run.stage, node.name)]))
        .collect();
    let mut nodes: Vec<&str> = runs.iter().flat_map(|run| &run.nodes).map(|node| node.name.as_str()).collect();
    nodes.sort_unstable();
    nodes.dedup();
    let near = nearest(pattern, names.iter().map(String::as_str));
    let what = format!("the recording has no node `{pattern}`");
    CliError::unknown(what, near, format!("its nodes are {}", nodes.join(", ")))
}

/// Refuses what would pass without a comparison: nothing at all to compare, or not what was asked for by name.
fn refuse(
    args: &ReplayArgs,
    recording: &Recording,
    replay: &depthloom_verify::Replay,
    unchecked: &[Unchecked],
) -> Result<(), CliError> {
    let is_named = |node: &Unchecked| {
        let run = &recording.plan().runs[node.node.run];
        let name = &run.nodes[node.node.node].name;
        args.nodes.iter().any(|of| of == name || *of == format!("{}.{name}", run.stage))
    };
    let compares = replay.nodes.iter().flatten().any(|node| node.expected.iter().any(Option::is_some));
    let told = |node: &Unchecked| format!("`{}`: {}", name(recording, node.node), node.why);
    let in_the_way = unchecked.iter().find(|node| is_named(node)).or_else(|| unchecked.first().filter(|_| !compares));
    match in_the_way {
        Some(node) if node.is_damage => {
            Err(CliError::new(ExitCode::FrameFailures, format!("the recording is damaged: {}", told(node))))
        }
        Some(node) => Err(CliError::usage(
            format!("cannot make again {}", told(node)),
            "`record:` of the experiment says what is recorded; without names, the nodes that can be are compared",
        )),
        None if !compares => Err(CliError::new(ExitCode::Usage, "nothing is recorded that could be compared")),
        None => Ok(()),
    }
}

/// A node's name, with its stage, and with its variants where it does not serve all of the stage's.
fn name(recording: &Recording, node: NodeRef) -> String {
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

/// What there is to tell.
struct Told<'a> {
    recording: &'a Recording,
    checked: Vec<(NodeRef, depthloom_verify::Replayed, Tally)>,
    unchecked: Vec<Unchecked>,
    /// The nodes that failed where a run would have ended.
    failed: Vec<Unchecked>,
}

impl Told<'_> {
    fn different(&self) -> impl Iterator<Item = &(NodeRef, depthloom_verify::Replayed, Tally)> {
        self.checked.iter().filter(|(.., tally)| tally.different > 0)
    }

    fn is_equal(&self) -> bool {
        self.different().next().is_none() && self.failed.is_empty()
    }

    fn verdict(&self, damage: &[String]) -> Option<CliError> {
        let has_failed = |node: NodeRef| self.failed.iter().any(|failed| failed.node == node);
        let different = self.different().filter(|(node, ..)| !has_failed(*node)).count() as u64;
        let of = counted(self.checked.len(), "node");
        let differ = (different > 0).then(|| format!("{different} of {of} gave other values than recorded"));
        let failed = self.failed.len() as u64;
        let failed = (failed > 0).then(|| format!("{} failed", counted(failed, "node")));
        let damaged = (!damage.is_empty()).then(|| "the recording is damaged".to_owned());
        let what: Vec<String> = [differ, failed].into_iter().flatten().collect();
        let what = if what.is_empty() { damaged } else { Some(what.join(", ")) };
        what.map(|what| CliError::new(ExitCode::FrameFailures, what))
    }

    fn text(&self) -> String {
        let mut rows = vec![["node", "kind", "compared", "different"].map(str::to_owned)];
        rows.extend(self.checked.iter().map(|(node, _, tally)| self.row(*node, tally)));
        let mut text = aligned(&rows, &[2, 3]);
        for (node, _, tally) in self.different().take(TOLD) {
            text.push_str(&format!("\n{}\n", self.differences(*node, tally)));
        }
        if let more @ 1.. = self.different().count().saturating_sub(TOLD) {
            text.push_str(&format!("\nand {more} more that differ: --json tells all\n"));
        }
        for (node, replayed, _) in self.checked.iter().filter(|(_, replayed, _)| !replayed.remarks.is_empty()) {
            let name = name(self.recording, *node);
            text.push_str(&format!("{name}: {}\n", replayed.remarks.join("; ")));
        }
        for node in &self.unchecked {
            let name = name(self.recording, node.node);
            text.push_str(&format!("not compared: {name}: {}\n", node.why));
        }
        for node in &self.failed {
            let name = name(self.recording, node.node);
            text.push_str(&format!("failed: {name}: {}\n", node.why));
        }
        let plan = self.recording.plan();
        if plan.every > 1 {
            text.push_str(&format!("compared are the frames whose values are recorded: one in {}\n", plan.every));
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
        [name(self.recording, node), kind, tally.values.to_string(), different]
    }

    fn differences(&self, node: NodeRef, tally: &Tally) -> String {
        let name = name(self.recording, node);
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

    /// For programs.
    fn output(&self, args: &ReplayArgs, damage: Vec<String>, verdict: Option<&CliError>) -> Replay {
        let checked = self.checked.iter().map(|(node, replayed, tally)| {
            let NotReplayed { stage, node: name, kind, version, variants, .. } = self.node(*node, "");
            Replayed {
                stage,
                node: name,
                kind,
                version,
                variants,
                compared: tally.values,
                different: tally.different,
                numbers: tally.numbers,
                different_numbers: tally.different_numbers,
                first: tally.first.as_ref().map(difference),
                worst: tally.worst.as_ref().map(difference),
                remarks: replayed.remarks.clone(),
            }
        });
        let why = |node: &Unchecked| self.node(node.node, &node.why);
        Replay {
            run: args.run.to_string_lossy().into_owned(),
            asked: args.nodes.clone(),
            equal: self.is_equal(),
            every: self.recording.plan().every,
            nodes: checked.collect(),
            not_compared: self.unchecked.iter().map(why).collect(),
            failed: self.failed.iter().map(why).collect(),
            damage,
            error: verdict.map(Error::from),
        }
    }

    fn node(&self, node: NodeRef, why: &str) -> NotReplayed {
        let plan = self.recording.plan();
        let (run, node) = (&plan.runs[node.run], &plan.runs[node.run].nodes[node.node]);
        NotReplayed {
            stage: run.stage.clone(),
            node: node.name.clone(),
            kind: node.kind.clone(),
            version: node.version,
            variants: node.variants.iter().map(|variant| plan.variants[*variant].clone()).collect(),
            why: why.to_owned(),
        }
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

/// A number that is none is null: no answer; one beyond all is text.
fn number_json(value: Option<f64>) -> Json {
    match value {
        Some(value) if value.is_finite() => json!(rounded(value)),
        Some(value) => json!(value.to_string()),
        None => Json::Null,
    }
}

fn difference(placed: &Placed) -> Difference {
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
    Difference {
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
