//! `depthloom inspect` of a recording: its topics with their sizes, and whether it is complete.

use depthloom_graphs::plan::{FrameIndex, RunId, VariantId};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use depthloom_analysis::{StageFrames, variant_of};
use depthloom_graphs::contracts::{Drops, Slot, SlotKey};
use depthloom_graphs::{Key, counted};
use depthloom_recording::{Condition, Damage as RecordedDamage, LiveTotals, Recording, TopicSize};
use depthloom_runs::{open, read_failed};
use depthloom_terminal::{CliError, ExitCode, aligned, print, size};
use schemars::JsonSchema;
use serde::Serialize;

use super::Subject;
use crate::args::InspectArgs;
use crate::output;
use crate::output::diagnostics::Error;
use crate::signals;

/// The digits of a key that are printed.
const KEY_DIGITS: usize = 12;

/// Output of `inspect` for a recording or run.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Info {
    /// The kind of thing that was inspected: `recording`.
    subject: Subject,
    file: String,
    bytes: u64,
    /// `complete`, `unfinished`, `recovered` or `damaged`.
    condition: &'static str,
    /// What is wrong; null if nothing is.
    what: Option<String>,
    /// Whether every byte was checked.
    checked: bool,
    experiment: String,
    variants: Vec<String>,
    stages: Vec<StageFrames>,
    /// Only of a live run.
    #[serde(skip_serializing_if = "Option::is_none")]
    live: Option<Live>,
    topics: Vec<Topic>,
    attachments: Vec<Attachment>,
    damage: Vec<Damage>,
    /// Only with `--keys`.
    #[serde(skip_serializing_if = "Option::is_none")]
    keys: Option<Vec<ValueKey>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// The frames of a live run.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Live {
    /// The frames that were recorded.
    frames: u64,
    /// The frames that were dropped, by cause.
    dropped: LiveDrops,
}

/// Dropped frames by cause.
#[derive(JsonSchema, Serialize)]
pub(crate) struct LiveDrops {
    /// The nodes could not keep up.
    graph: u64,
    /// The recording could not keep up.
    recording: u64,
    /// The source lost them.
    source: u64,
}

/// A topic.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Topic {
    topic: String,
    /// The value type of the port; for other topics, their purpose.
    #[serde(rename = "type")]
    carries: String,
    schema: String,
    messages: u64,
    raw_bytes: u64,
    stored_bytes: u64,
    /// How many different keys its values have.
    keys: u64,
    /// The hash of the node that outputs it; null for other topics.
    node_hash: Option<String>,
}

/// An attached file.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Attachment {
    name: String,
    #[serde(rename = "type")]
    media_type: String,
    bytes: u64,
}

/// A damaged part of the file.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Damage {
    offset: u64,
    bytes: u64,
    held: String,
}

/// The key of a value.
#[derive(JsonSchema, Serialize)]
pub(crate) struct ValueKey {
    /// The name of its stage run.
    #[serde(skip)]
    run: String,
    stage: String,
    /// Null where all variants share the node; of several, the first.
    variant: Option<String>,
    /// Null for a value that exists once per stage.
    frame: Option<String>,
    node: String,
    key: String,
}

/// Prints topics with their messages, sizes and keys, attachments, and whether the recording is whole.
pub(super) fn inspect(args: &InspectArgs, path: &Path) -> Result<ExitCode, CliError> {
    let interrupt = signals::listen("stopping")?;
    let recording = open(path)?;
    let stop = || interrupt.stops_admission();
    let sizes = recording.topic_sizes(&stop);
    let sizes = sizes.map_err(|error| read_failed("failed to read the recording", &error))?;
    let damage = if args.verify_bytes { recording.damage(&stop) } else { Vec::new() };
    if stop() {
        return Err(CliError::new(ExitCode::Interrupted, "interrupted while reading"));
    }
    let is_damaged = matches!(recording.condition(), Condition::Damaged { .. }) || !damage.is_empty();
    let faulty = is_damaged.then(|| CliError::new(ExitCode::FrameFailures, format!("{} is damaged", path.display())));
    let topics = topics(&recording, sizes);
    if args.output.json {
        let error = faulty.as_ref().map(Error::from);
        output::print(&Info { error, ..output(&recording, topics, &damage, args) })?;
    } else {
        print(text(&recording, &topics, &damage, args))?;
    }
    Ok(faulty.map_or(ExitCode::Success, |stop| stop.exit))
}

/// The topics of ports in the order of the plan, then the others.
fn topics(recording: &Recording, sizes: Vec<TopicSize>) -> Vec<Topic> {
    let plan = recording.plan();
    let mut sizes: BTreeMap<String, TopicSize> = sizes.into_iter().map(|size| (size.topic.clone(), size)).collect();
    let mut topics = Vec::new();
    for run in RunId::all(plan.runs.len()) {
        for (slot, output) in plan.outputs(run) {
            let Some(size) = sizes.remove(&output.topic) else { continue };
            let node_hash = match slot {
                Slot::Source { .. } => None,
                Slot::Node { node, .. } => Some(plan.runs[run].nodes[node].node_hash),
            };
            let keys = keys_of(recording, run, slot).map(|(_, key)| key).collect::<BTreeSet<Key>>().len();
            topics.push(Topic::new(size, &output.value_type, keys as u64, node_hash));
        }
    }
    topics.extend(sizes.into_values().map(|size| {
        let carries = if size.topic.ends_with("/commit") { "commit" } else { "for viewers" };
        Topic::new(size, carries, 0, None)
    }));
    topics
}

impl Topic {
    fn new(size: TopicSize, carries: &str, keys: u64, node_hash: Option<Key>) -> Self {
        let TopicSize { topic, schema, messages, raw_bytes, stored_bytes } = size;
        let node_hash = node_hash.map(|node_hash| node_hash.to_string());
        Self { topic, carries: carries.to_owned(), schema, messages, raw_bytes, stored_bytes, keys, node_hash }
    }
}

/// The frames' positions and keys of a port's values.
fn keys_of(recording: &Recording, run: RunId, slot: Slot) -> impl Iterator<Item = (FrameIndex, Key)> {
    let aggregates = recording.aggregate_values().iter().filter(move |once| match slot {
        Slot::Source { .. } => false,
        Slot::Node { node, port } => (once.run, once.node, once.port) == (run, node, port),
    });
    let frames = FrameIndex::enumerate(recording.frames(run)).filter_map(move |(position, frame)| {
        let key = match slot {
            Slot::Source { .. } => frame.source_key,
            Slot::Node { node, .. } => frame.keys.iter().find(|entry| entry.node == node).map(|entry| entry.key),
        };
        key.map(|key| (position, key))
    });
    frames.chain(aggregates.map(|once| (FrameIndex(0), once.key)))
}

fn text(recording: &Recording, topics: &[Topic], damage: &[RecordedDamage], args: &InspectArgs) -> String {
    let plan = recording.plan();
    let condition = match (recording.condition(), args.verify_bytes) {
        (Condition::Complete, false) => "complete according to its summary; --verify-bytes reads every byte".to_owned(),
        (Condition::Complete, true) if damage.is_empty() => "complete, every byte verified".to_owned(),
        (Condition::Complete, true) => format!("damaged in {}", counted(damage.len(), "place")),
        (condition, _) => condition.to_string(),
    };
    let mut text = format!("{}: {condition}\n", recording.path().display());
    for RecordedDamage { offset, bytes, content } in damage {
        text += &format!("damaged: {bytes} bytes from byte {offset}, which held {content}\n");
    }
    let stages = RunId::enumerate(&plan.runs)
        .map(|(run, planned)| format!("{} {}", planned.name(), counted(recording.frames(run).len(), "frame")));
    let variants = counted(plan.variants.len(), "variant");
    text += &format!("experiment {}, {variants}: {}\n", plan.experiment, stages.collect::<Vec<_>>().join(", "));
    if let Some(live) = recording.live_totals() {
        text += &live_line(live);
    }
    text.push('\n');

    let head = ["topic", "type", "messages", "raw", "stored", "ratio", "keys", "node hash"];
    let mut rows = vec![head.map(str::to_owned)];
    for entry in topics {
        let node_hash =
            entry.node_hash.as_ref().map_or_else(|| "-".to_owned(), |node_hash| node_hash[..KEY_DIGITS].to_owned());
        let keys = if entry.keys == 0 { "-".to_owned() } else { entry.keys.to_string() };
        rows.push(row(entry, keys, node_hash));
    }
    let all = total(topics);
    rows.push(row(&all, String::new(), String::new()));
    text += &aligned(&rows, &[2, 3, 4, 5, 6]);

    let attachments = recording.attachments();
    let attached: u64 = attachments.iter().map(|attachment| attachment.size).sum();
    text += &format!("\n{}, {}\n", counted(attachments.len(), "attachment"), size(attached));
    let rows = attachments.iter().map(|entry| [entry.name.clone(), entry.media_type.clone(), size(entry.size)]);
    text += &aligned(&rows.map(|row| row.map(|cell| format!("  {cell}"))).collect::<Vec<_>>(), &[2]);
    let other = recording.file_bytes().saturating_sub(all.stored_bytes + attached);
    text += &format!(
        "\n{} in all, {} of it indexes, checksums and descriptions\n",
        size(recording.file_bytes()),
        size(other)
    );
    if args.keys {
        let mut rows = vec![["stage", "frame", "node", "key"].map(str::to_owned)];
        rows.extend(
            all_keys(recording)
                .into_iter()
                .map(|entry| [entry.run, entry.frame.unwrap_or_default(), entry.node, entry.key]),
        );
        text += &format!("\n{}", aligned(&rows, &[]));
    }
    text
}

/// The frames of a live run, and its dropped frames by cause.
fn live_line(LiveTotals { frames, dropped }: LiveTotals) -> String {
    let causes = dropped.by_cause().map(|(cause, count)| format!("{cause} {count}")).join(", ");
    format!("live: {}, {} dropped ({causes})\n", counted(frames, "frame"), dropped.total())
}

fn row(entry: &Topic, keys: String, node_hash: String) -> [String; 8] {
    let ratio = entry.raw_bytes as f64 / entry.stored_bytes.max(1) as f64;
    [
        entry.topic.clone(),
        entry.carries.clone(),
        entry.messages.to_string(),
        size(entry.raw_bytes),
        size(entry.stored_bytes),
        format!("{ratio:.2}"),
        keys,
        node_hash,
    ]
}

fn total(topics: &[Topic]) -> Topic {
    let sum = |entry: fn(&Topic) -> u64| topics.iter().map(entry).sum();
    Topic {
        topic: counted(topics.len(), "topic"),
        carries: String::new(),
        schema: String::new(),
        messages: sum(|entry| entry.messages),
        raw_bytes: sum(|entry| entry.raw_bytes),
        stored_bytes: sum(|entry| entry.stored_bytes),
        keys: 0,
        node_hash: None,
    }
}

/// The keys of all values: of sources and nodes by frame, then of aggregates.
fn all_keys(recording: &Recording) -> Vec<ValueKey> {
    let plan = recording.plan();
    let entry = |run: RunId, variants: &[VariantId], frame: Option<&str>, node: &str, key: Key| ValueKey {
        run: plan.runs[run].name().to_owned(),
        stage: plan.runs[run].stage.clone(),
        variant: variant_of(plan, variants).map(str::to_owned),
        frame: frame.map(str::to_owned),
        node: node.to_owned(),
        key: key.to_string(),
    };
    let mut keys = Vec::new();
    for (run, planned) in RunId::enumerate(&plan.runs) {
        for frame in recording.frames(run) {
            let id = Some(&*frame.id);
            keys.extend(frame.source_key.map(|key| entry(run, &planned.variants, id, "source", key)));
            for SlotKey { node, key } in &frame.keys {
                let Some(node) = planned.nodes.get(node.0) else { continue };
                keys.push(entry(run, &node.variants, id, &node.name, *key));
            }
        }
    }
    for once in recording.aggregate_values() {
        let Some(node) = plan.runs.get(once.run.0).and_then(|run| run.nodes.get(once.node.0)) else { continue };
        keys.push(entry(once.run, &node.variants, None, &node.name, once.key));
    }
    keys
}

fn output(recording: &Recording, topics: Vec<Topic>, damage: &[RecordedDamage], args: &InspectArgs) -> Info {
    let plan = recording.plan();
    let is_whole = *recording.condition() == Condition::Complete;
    let attachments = recording.attachments().iter().map(|entry| Attachment {
        name: entry.name.clone(),
        media_type: entry.media_type.clone(),
        bytes: entry.size,
    });
    let place =
        |entry: &RecordedDamage| Damage { offset: entry.offset, bytes: entry.bytes, held: entry.content.to_string() };
    Info {
        subject: Subject::Recording,
        file: recording.path().to_string_lossy().into_owned(),
        bytes: recording.file_bytes(),
        condition: if damage.is_empty() { recording.condition().name() } else { "damaged" },
        what: (!is_whole).then(|| recording.condition().to_string()),
        checked: args.verify_bytes || !is_whole,
        experiment: plan.experiment.clone(),
        variants: plan.variants.clone(),
        stages: StageFrames::all(recording),
        live: recording.live_totals().map(|LiveTotals { frames, dropped: Drops { graph, recording, source } }| Live {
            frames,
            dropped: LiveDrops { graph, recording, source },
        }),
        topics,
        attachments: attachments.collect(),
        damage: damage.iter().map(place).collect(),
        keys: args.keys.then(|| all_keys(recording)),
        error: None,
    }
}
