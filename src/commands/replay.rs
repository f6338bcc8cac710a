//! `depthloom replay`: nodes made again from a recording, and compared with it.

use std::collections::BTreeMap;
use std::sync::Arc;

use depthloom_graphs::Registry;
use depthloom_graphs::language::nearest;
use depthloom_graphs::values::{Differs, Place, number};
use depthloom_recording::Recording;
use depthloom_runner::{Options, run};
use serde_json::{Map, Value as Json, json};

use super::report::recording_of;
use super::run::stop_of;
use super::table::open;
use crate::allow_exec;
use crate::args::ReplayArgs;
use crate::columns::aligned;
use crate::counted::counted;
use crate::diagnostics::error_json;
use crate::exit::{Exit, Stop};
use crate::outputs::Output;
use crate::progress::Progress;
use crate::replay::{Checker, Outcome, Placed, Replay, Replayed, Tally, Tolerances, Unchecked};
use crate::signals;
use crate::streams::{print, print_output, say};

/// How many nodes that differ are told one by one; with `--json` all are.
const TOLD: usize = 20;

/// Makes nodes again and says whether their values are those recorded.
pub fn replay(args: &ReplayArgs, registry: &Registry) -> Result<Exit, Stop> {
    allow_exec::decide(args.exec, None)?;
    let path = recording_of(&args.run, "replay")?;
    let interrupt = signals::listen("stopping: nothing is written")?;
    let recording = Arc::new(open(&path)?);
    let mut replay = Replay::new(&recording, registry, &args.nodes).map_err(|pattern| unknown(&recording, &pattern))?;
    let unchecked = std::mem::take(&mut replay.unchecked);
    refuse(args, &recording, &replay, &unchecked)?;

    let default = Options::default();
    let options = Options { workers: args.workers.map_or(default.workers, usize::from), keep_going: true, ..default };
    let progress = Progress::new(&replay.ready.plan, true);
    let checker = Checker::new(Arc::clone(&recording), &mut replay, Tolerances::of(&args.tolerance));
    let report = run(replay.ready, &checker, &options, &progress, &interrupt).map_err(|error| stop_of(&error))?;
    if report.interrupted {
        return Err(Stop::new(Exit::Interrupted, "interrupted: not all was compared"));
    }

    let Outcome { checked, behind, failed, mut damage } = checker.finish();
    damage.extend(unchecked.iter().filter(|unchecked| unchecked.is_damage).map(|unchecked| unchecked.why.clone()));
    let unchecked = unchecked.into_iter().chain(behind).collect();
    let told = Told { recording: &recording, checked, unchecked, failed };
    let verdict = told.verdict(&damage);
    if args.json {
        let mut object = told.json(&args.nodes);
        object["run"] = json!(args.run.to_string_lossy());
        object["damage"] = json!(damage);
        if let Some(stop) = &verdict {
            object["error"] = error_json(stop);
        }
        print_output(Output::Replay, object)?;
    } else {
        print(told.text())?;
        damage.iter().take(TOLD).for_each(|what| say(format_args!("damaged: {what}")));
    }
    Ok(verdict.map_or(Exit::Whole, |stop| {
        say(&stop.message);
        stop.exit
    }))
}

/// What is to be said where a pattern names no node.
fn unknown(recording: &Recording, pattern: &str) -> Stop {
    let runs = &recording.plan().runs;
    let names: Vec<String> = runs
        .iter()
        .flat_map(|run| run.nodes.iter().flat_map(|node| [node.name.clone(), format!("{}.{}", run.stage, node.name)]))
        .collect();
    let stop = Stop::new(Exit::Before, format!("the recording has no node `{pattern}`"));
    match nearest(pattern, names.iter().map(String::as_str)) {
        Some(near) => stop.remedy(format!("did you mean `{near}`?")),
        None => {
            let mut names: Vec<&str> = runs.iter().flat_map(|run| &run.nodes).map(|node| node.name.as_str()).collect();
            names.sort_unstable();
            names.dedup();
            stop.remedy(format!("its nodes are {}", names.join(", ")))
        }
    }
}

/// Refuses what would pass without a comparison: nothing at all to compare, or not what was asked for by name.
fn refuse(args: &ReplayArgs, recording: &Recording, replay: &Replay, unchecked: &[Unchecked]) -> Result<(), Stop> {
    let is_named = |node: &Unchecked| {
        let (run, name) = (&recording.plan().runs[node.run], &recording.plan().runs[node.run].nodes[node.node].name);
        args.nodes.iter().any(|of| of == name || *of == format!("{}.{name}", run.stage))
    };
    let compares = replay.nodes.iter().flatten().any(|node| node.expected.iter().any(Option::is_some));
    let told = |node: &Unchecked| format!("`{}`: {}", name(recording, node.run, node.node), node.why);
    let in_the_way = unchecked.iter().find(|node| is_named(node)).or_else(|| unchecked.first().filter(|_| !compares));
    match in_the_way {
        Some(node) if node.is_damage => {
            Err(Stop::new(Exit::Frames, format!("the recording is damaged: {}", told(node))))
        }
        Some(node) => Err(Stop::new(Exit::Before, format!("cannot make again {}", told(node))).remedy(
            "`record:` of the experiment says what is recorded; without names, the nodes that can be are compared",
        )),
        None if !compares => Err(Stop::new(Exit::Before, "nothing is recorded that could be compared")),
        None => Ok(()),
    }
}

/// A node's name, with its stage, and with its variants where it does not serve all of the stage's.
fn name(recording: &Recording, run: usize, node: usize) -> String {
    let plan = recording.plan();
    let (run, node) = (&plan.runs[run], &plan.runs[run].nodes[node]);
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
    checked: Vec<(usize, Replayed, Tally)>,
    unchecked: Vec<Unchecked>,
    /// The nodes that failed where a run would have ended.
    failed: Vec<Unchecked>,
}

impl Told<'_> {
    fn different(&self) -> impl Iterator<Item = &(usize, Replayed, Tally)> {
        self.checked.iter().filter(|(.., tally)| tally.different > 0)
    }

    fn is_equal(&self) -> bool {
        self.different().next().is_none() && self.failed.is_empty()
    }

    fn verdict(&self, damage: &[String]) -> Option<Stop> {
        let has_failed =
            |run: usize, node: &Replayed| self.failed.iter().any(|of| (of.run, of.node) == (run, node.recorded));
        let different = self.different().filter(|(run, node, _)| !has_failed(*run, node)).count() as u64;
        let of = counted(self.checked.len() as u64, "node");
        let differ = (different > 0).then(|| format!("{different} of {of} gave other values than recorded"));
        let failed = self.failed.len() as u64;
        let failed = (failed > 0).then(|| format!("{} failed", counted(failed, "node")));
        let damaged = (!damage.is_empty()).then(|| "the recording is damaged".to_owned());
        let what: Vec<String> = [differ, failed].into_iter().flatten().collect();
        let what = if what.is_empty() { damaged } else { Some(what.join(", ")) };
        what.map(|what| Stop::new(Exit::Frames, what))
    }

    fn text(&self) -> String {
        let mut rows = vec![["node", "kind", "compared", "different"].map(str::to_owned)];
        rows.extend(self.checked.iter().map(|(run, node, tally)| self.row(*run, node, tally)));
        let mut text = aligned(&rows, &[2, 3]);
        for (run, node, tally) in self.different().take(TOLD) {
            text.push_str(&format!("\n{}\n", self.differences(*run, node, tally)));
        }
        if let more @ 1.. = self.different().count().saturating_sub(TOLD) {
            text.push_str(&format!("\nand {more} more that differ: --json tells all\n"));
        }
        let remarked = self.checked.iter().filter(|(_, node, _)| !node.remarks.is_empty());
        for (run, node, _) in remarked {
            let name = name(self.recording, *run, node.recorded);
            text.push_str(&format!("{name}: {}\n", node.remarks.join("; ")));
        }
        for node in &self.unchecked {
            let name = name(self.recording, node.run, node.node);
            text.push_str(&format!("not compared: {name}: {}\n", node.why));
        }
        for node in &self.failed {
            let name = name(self.recording, node.run, node.node);
            text.push_str(&format!("failed: {name}: {}\n", node.why));
        }
        let plan = self.recording.plan();
        if plan.every > 1 {
            text.push_str(&format!("compared are the frames whose values are recorded: one in {}\n", plan.every));
        }
        if self.is_equal() {
            let values: u64 = self.checked.iter().map(|(.., tally)| tally.values).sum();
            text.push_str(&format!(
                "equal: {} of {}\n",
                counted(values, "value"),
                counted(self.checked.len() as u64, "node")
            ));
        }
        text
    }

    fn row(&self, run: usize, node: &Replayed, tally: &Tally) -> [String; 4] {
        let different = if tally.different == 0 { "-".to_owned() } else { tally.different.to_string() };
        let kind = self.recording.plan().runs[run].nodes[node.recorded].kind.clone();
        [name(self.recording, run, node.recorded), kind, tally.values.to_string(), different]
    }

    fn differences(&self, run: usize, node: &Replayed, tally: &Tally) -> String {
        let name = name(self.recording, run, node.recorded);
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

    /// For programs; `asked` are the nodes that were named.
    fn json(&self, asked: &[String]) -> Json {
        let checked = self.checked.iter().map(|(run, node, tally)| {
            let mut object = self.node_json(*run, node.recorded);
            object.insert("compared".to_owned(), json!(tally.values));
            object.insert("different".to_owned(), json!(tally.different));
            object.insert("numbers".to_owned(), json!(tally.numbers));
            object.insert("different_numbers".to_owned(), json!(tally.different_numbers));
            object.insert("first".to_owned(), tally.first.as_ref().map_or(Json::Null, placed_json));
            object.insert("worst".to_owned(), tally.worst.as_ref().map_or(Json::Null, placed_json));
            object.insert("remarks".to_owned(), json!(node.remarks));
            Json::Object(object)
        });
        let why = |node: &Unchecked| {
            let mut object = self.node_json(node.run, node.node);
            object.insert("why".to_owned(), json!(node.why));
            Json::Object(object)
        };
        json!({
            "asked": asked,
            "equal": self.is_equal(),
            "every": self.recording.plan().every,
            "nodes": checked.collect::<Vec<_>>(),
            "not_compared": self.unchecked.iter().map(why).collect::<Vec<_>>(),
            "failed": self.failed.iter().map(why).collect::<Vec<_>>(),
        })
    }

    fn node_json(&self, run: usize, node: usize) -> Map<String, Json> {
        let plan = self.recording.plan();
        let (of, node) = (&plan.runs[run], &plan.runs[run].nodes[node]);
        let variants: Vec<&str> = node.variants.iter().map(|variant| plan.variants[*variant].as_str()).collect();
        let fields = [
            ("stage", json!(of.stage)),
            ("node", json!(node.name)),
            ("kind", json!(node.kind)),
            ("version", json!(node.version)),
            ("variants", json!(variants)),
        ];
        fields.into_iter().map(|(key, value)| (key.to_owned(), value)).collect::<BTreeMap<_, _>>().into_iter().collect()
    }
}

fn placed_text(placed: &Placed) -> String {
    let differs = placed.differs.text(placed.value_type);
    match &placed.frame {
        Some(frame) => format!("frame {frame}, {}, {differs}", placed.topic),
        None => format!("{}, {differs}", placed.topic),
    }
}

/// A number that is none is null: no answer; one beyond all is text.
fn number_json(value: Option<f64>) -> Json {
    match value {
        Some(value) if value.is_finite() => number(value).parse::<f64>().map_or(Json::Null, |value| json!(value)),
        Some(value) => json!(value.to_string()),
        None => Json::Null,
    }
}

fn placed_json(placed: &Placed) -> Json {
    let mut object = json!({
        "frame": placed.frame.as_deref(),
        "topic": placed.topic,
        "type": placed.value_type.name(),
    });
    match &placed.differs {
        Differs::Whole { recorded, now } => {
            object["recorded"] = json!(recorded);
            object["now"] = json!(now);
        }
        Differs::Number { place, recorded, now } => {
            let (key, at) = match place {
                Place::Pixel(x, y) => ("pixel", json!([x, y])),
                Place::Channel(x, y, channel) => {
                    object["channel"] = json!(channel);
                    ("pixel", json!([x, y]))
                }
                Place::Byte(at) => ("byte", json!(at)),
                Place::Named(name) => ("name", json!(name)),
            };
            object[key] = at;
            object["recorded"] = number_json(*recorded);
            object["now"] = number_json(*now);
            object["by"] = number_json(Some(placed.differs.by()).filter(|by| by.is_finite()));
        }
    }
    object
}
