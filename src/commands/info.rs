//! `depthloom info`: what a recording holds, and what each topic takes.

use std::collections::{BTreeMap, BTreeSet};

use depthloom_analysis::variant_of;
use depthloom_graphs::Key;
use depthloom_graphs::contracts::Slot;
use depthloom_recording::{Condition, Damage, RecordedRun, Recording, TopicSize};
use serde_json::{Value as Json, json};

use super::report::recording_of;
use super::table::open;
use crate::args::InfoArgs;
use crate::columns::aligned;
use crate::counted::counted;
use crate::diagnostics::error_json;
use crate::exit::{Exit, Stop};
use crate::outputs::Output;
use crate::signals;
use crate::sizes::size;
use crate::streams::{print, print_output};

/// Of a key as many digits as tell it from others.
const KEY_DIGITS: usize = 12;

/// Prints topics with their messages, sizes and keys, attachments, and whether the recording is whole.
pub fn info(args: &InfoArgs) -> Result<Exit, Stop> {
    let path = recording_of(&args.file, "info")?;
    let interrupt = signals::listen("stopping")?;
    let recording = open(&path)?;
    let stop = || interrupt.stops_admission();
    let sizes = recording.topic_sizes(&stop).map_err(|error| {
        let exit = if error.is_damage() { Exit::Frames } else { Exit::Engine };
        Stop::of_recording(exit, "failed to read the recording", &error)
    })?;
    let damage = if args.check { recording.damage(&stop) } else { Vec::new() };
    if stop() {
        return Err(Stop::new(Exit::Interrupted, "interrupted while reading"));
    }
    let is_damaged = matches!(recording.condition(), Condition::Damaged { .. }) || !damage.is_empty();
    let faulty = is_damaged.then(|| Stop::new(Exit::Frames, "the recording is damaged"));
    let topics = topics(&recording, sizes);
    if args.json {
        let mut told = json(&recording, &topics, &damage, args);
        if let Some(stop) = &faulty {
            told["error"] = error_json(stop);
        }
        print_output(Output::Info, told)?;
    } else {
        print(text(&recording, &topics, &damage, args))?;
    }
    Ok(faulty.map_or(Exit::Whole, |stop| stop.exit))
}

/// A topic of the recording.
struct Topic<'a> {
    size: TopicSize,
    /// What it carries: of a planned port its type, of others what they are for.
    carries: &'a str,
    /// The recipe of the node whose output it is.
    recipe: Option<Key>,
    /// How many different keys its values have.
    keys: usize,
}

/// The topics in the order of the plan, then those that are no port's.
fn topics(recording: &Recording, sizes: Vec<TopicSize>) -> Vec<Topic<'_>> {
    let plan = recording.plan();
    let mut sizes: BTreeMap<String, TopicSize> = sizes.into_iter().map(|size| (size.topic.clone(), size)).collect();
    let mut topics = Vec::new();
    for run in 0..plan.runs.len() {
        for (slot, output) in plan.outputs(run) {
            let Some(size) = sizes.remove(&output.topic) else { continue };
            let recipe = match slot {
                Slot::Source { .. } => None,
                Slot::Node { node, .. } => Some(plan.runs[run].nodes[node].recipe),
            };
            let keys = keys_of(recording, run, slot).map(|(_, key)| key).collect::<BTreeSet<Key>>().len();
            topics.push(Topic { size, carries: &output.value_type, recipe, keys });
        }
    }
    topics.extend(sizes.into_values().map(|size| {
        let carries = if size.topic.ends_with("/commit") { "commit" } else { "for looking at" };
        Topic { size, carries, recipe: None, keys: 0 }
    }));
    topics
}

/// The frames' positions and keys of a port's values.
fn keys_of(recording: &Recording, run: usize, slot: Slot) -> impl Iterator<Item = (usize, Key)> {
    let of_once = recording.once_values().iter().filter(move |once| match slot {
        Slot::Source { .. } => false,
        Slot::Node { node, port } => (once.run, once.node, once.port) == (run, node, port),
    });
    let frames = recording.frames(run).iter().enumerate().filter_map(move |(position, frame)| {
        let key = match slot {
            Slot::Source { .. } => frame.source_key,
            Slot::Node { node, .. } => frame.keys.iter().find(|of| of.node == node).map(|of| of.key),
        };
        key.map(|key| (position, key))
    });
    frames.chain(of_once.map(|once| (0, once.key)))
}

fn text(recording: &Recording, topics: &[Topic<'_>], damage: &[Damage], args: &InfoArgs) -> String {
    let plan = recording.plan();
    let condition = match (recording.condition(), args.check) {
        (Condition::Whole, false) => "whole by its summary; --check reads every byte".to_owned(),
        (Condition::Whole, true) if damage.is_empty() => "whole, every byte of it".to_owned(),
        (Condition::Whole, true) => format!("damaged in {}", counted(damage.len() as u64, "place")),
        (condition, _) => condition.to_string(),
    };
    let mut text = format!("{}: {condition}\n", recording.path().display());
    for Damage { offset, bytes, held } in damage {
        text += &format!("damaged in the {bytes} bytes from byte {offset} on: it held {held}\n");
    }
    let stages =
        plan.runs.iter().enumerate().map(|(run, planned)| {
            format!("{} {}", planned.name(), counted(recording.frames(run).len() as u64, "frame"))
        });
    let variants = counted(plan.variants.len() as u64, "variant");
    text += &format!("experiment {}, {variants}: {}\n\n", plan.experiment, stages.collect::<Vec<_>>().join(", "));

    let head = ["topic", "type", "messages", "raw", "stored", "ratio", "keys", "recipe"];
    let mut rows = vec![head.map(str::to_owned)];
    for Topic { size: of, carries, recipe, keys } in topics {
        let recipe = recipe.map_or_else(|| "-".to_owned(), |recipe| recipe.to_string()[..KEY_DIGITS].to_owned());
        let keys = if *keys == 0 { "-".to_owned() } else { keys.to_string() };
        rows.push(row(&of.topic, carries, of, keys, recipe));
    }
    let all = total(topics);
    rows.push(row(&counted(topics.len() as u64, "topic"), "", &all, String::new(), String::new()));
    text += &aligned(&rows, &[2, 3, 4, 5, 6]);

    let attachments = recording.attachments();
    let attached: u64 = attachments.iter().map(|attachment| attachment.size).sum();
    text += &format!("\n{}, {}\n", counted(attachments.len() as u64, "attachment"), size(attached));
    let of_attachments = attachments.iter().map(|of| [of.name.clone(), of.media_type.clone(), size(of.size)]);
    text += &aligned(&of_attachments.map(|row| row.map(|cell| format!("  {cell}"))).collect::<Vec<_>>(), &[2]);
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
                .map(|of| [of.planned.name(), of.frame, of.node, &of.key.to_string()].map(str::to_owned)),
        );
        text += &format!("\n{}", aligned(&rows, &[]));
    }
    text
}

fn row(topic: &str, carries: &str, of: &TopicSize, keys: String, recipe: String) -> [String; 8] {
    let ratio = of.raw_bytes as f64 / of.stored_bytes.max(1) as f64;
    [
        topic.to_owned(),
        carries.to_owned(),
        of.messages.to_string(),
        size(of.raw_bytes),
        size(of.stored_bytes),
        format!("{ratio:.2}"),
        keys,
        recipe,
    ]
}

/// All topics together.
fn total(topics: &[Topic<'_>]) -> TopicSize {
    let sum = |of: fn(&TopicSize) -> u64| topics.iter().map(|topic| of(&topic.size)).sum();
    TopicSize {
        topic: String::new(),
        schema: String::new(),
        messages: sum(|of| of.messages),
        raw_bytes: sum(|of| of.raw_bytes),
        stored_bytes: sum(|of| of.stored_bytes),
    }
}

/// The key of what a source or a node gave on a frame, or once.
struct KeyOf<'a> {
    planned: &'a RecordedRun,
    /// Of the node, or of the source.
    variant: Option<&'a str>,
    /// Empty for what was given once.
    frame: &'a str,
    node: &'a str,
    key: Key,
}

fn all_keys(recording: &Recording) -> impl Iterator<Item = KeyOf<'_>> {
    let plan = recording.plan();
    let of_frames = plan.runs.iter().enumerate().flat_map(move |(run, planned)| {
        recording.frames(run).iter().flat_map(move |frame| {
            let of_source = frame.source_key.map(|key| ("source", planned.variants.as_slice(), key));
            let of_nodes = frame.keys.iter().filter_map(|of| {
                let node = planned.nodes.get(of.node)?;
                Some((node.name.as_str(), node.variants.as_slice(), of.key))
            });
            of_source.into_iter().chain(of_nodes).map(move |(node, variants, key)| {
                let variant = variant_of(plan, variants);
                KeyOf { planned, variant, frame: &frame.id, node, key }
            })
        })
    });
    let of_once = recording.once_values().iter().filter_map(move |once| {
        let planned = plan.runs.get(once.run)?;
        let node = planned.nodes.get(once.node)?;
        let variant = variant_of(plan, &node.variants);
        Some(KeyOf { planned, variant, frame: "", node: &node.name, key: once.key })
    });
    of_frames.chain(of_once)
}

fn json(recording: &Recording, topics: &[Topic<'_>], damage: &[Damage], args: &InfoArgs) -> Json {
    let plan = recording.plan();
    let stages = plan.runs.iter().enumerate();
    let stages = stages.map(|(run, of)| {
        let variant = variant_of(plan, &of.variants);
        json!({ "stage": of.stage, "variant": variant, "frames": recording.frames(run).len() })
    });
    let topic = |topic: &Topic<'_>| {
        json!({
            "topic": topic.size.topic,
            "type": topic.carries,
            "schema": topic.size.schema,
            "messages": topic.size.messages,
            "raw_bytes": topic.size.raw_bytes,
            "stored_bytes": topic.size.stored_bytes,
            "keys": topic.keys,
            "recipe": topic.recipe.map(|recipe| recipe.to_string()),
        })
    };
    let attachments = recording.attachments().iter();
    let attachments = attachments.map(|of| json!({ "name": of.name, "type": of.media_type, "bytes": of.size }));
    let condition = if damage.is_empty() { recording.condition().name() } else { "damaged" };
    let mut told = json!({
        "file": recording.path().to_string_lossy(),
        "bytes": recording.file_bytes(),
        "condition": condition,
        "what": (*recording.condition() != Condition::Whole).then(|| recording.condition().to_string()),
        "checked": args.check || *recording.condition() != Condition::Whole,
        "experiment": plan.experiment,
        "variants": plan.variants,
        "stages": stages.collect::<Vec<_>>(),
        "topics": topics.iter().map(topic).collect::<Vec<_>>(),
        "attachments": attachments.collect::<Vec<_>>(),
        "damage": damage.iter().map(|of| json!({
            "offset": of.offset, "bytes": of.bytes, "held": of.held.to_string(),
        })).collect::<Vec<_>>(),
    });
    if args.keys {
        let key = |of: KeyOf<'_>| {
            let frame = (!of.frame.is_empty()).then_some(of.frame);
            json!({
                "stage": of.planned.stage, "variant": of.variant, "frame": frame, "node": of.node, "key": of.key.to_string(),
            })
        };
        told["keys"] = all_keys(recording).map(key).collect();
    }
    told
}
