//! What is printed of recordings.
#![expect(dead_code, reason = "these types are the schemas of what is printed")]

use schemars::JsonSchema;
use serde_json::Value as Json;

use super::experiments::Error;
use super::tables::StageFrames;

/// Of `info`: what a recording holds.
#[derive(JsonSchema)]
pub struct Info {
    file: String,
    bytes: u64,
    /// `whole`, `unfinished` or `damaged`.
    condition: String,
    /// What is wrong, in words.
    what: Option<String>,
    /// Whether every byte was checked.
    checked: bool,
    experiment: String,
    variants: Vec<String>,
    stages: Vec<StageFrames>,
    topics: Vec<Topic>,
    attachments: Vec<Attachment>,
    damage: Vec<Damage>,
    /// With `--keys`.
    #[schemars(skip_serializing_if = "Option::is_none")]
    keys: Option<Vec<KeyOf>>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// A topic.
#[derive(JsonSchema)]
pub struct Topic {
    topic: String,
    #[schemars(rename = "type")]
    carries: String,
    schema: String,
    messages: u64,
    raw_bytes: u64,
    stored_bytes: u64,
    /// How many different keys its values have.
    keys: u64,
    recipe: Option<String>,
}

/// An attached file.
#[derive(JsonSchema)]
pub struct Attachment {
    name: String,
    #[schemars(rename = "type")]
    media_type: String,
    bytes: u64,
}

/// Bytes that are not what was written.
#[derive(JsonSchema)]
pub struct Damage {
    offset: u64,
    bytes: u64,
    held: String,
}

/// The key of a value.
#[derive(JsonSchema)]
pub struct KeyOf {
    stage: String,
    /// Null where all variants share the node; of several, the first.
    variant: Option<String>,
    /// Null of what is one a stage.
    frame: Option<String>,
    node: String,
    key: String,
}

/// Of `export`: what was written.
#[derive(JsonSchema)]
pub struct Export {
    folder: String,
    /// `whole`, `unfinished` or `damaged`.
    condition: String,
    topics: Vec<Exported>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// The files of a topic in a format.
#[derive(JsonSchema)]
pub struct Exported {
    topic: String,
    #[schemars(rename = "type")]
    value_type: String,
    format: String,
    /// Where they lie in the folder.
    path: String,
    files: u64,
    /// Pixels whose answer the format does not hold.
    clipped_pixels: u64,
}

/// Of `replay`: whether nodes make again what was recorded.
#[derive(JsonSchema)]
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
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// A node that was made again.
#[derive(JsonSchema)]
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
#[derive(JsonSchema)]
pub struct NotReplayed {
    stage: String,
    node: String,
    kind: String,
    version: u32,
    variants: Vec<String>,
    why: String,
}

/// Where a value differs.
#[derive(JsonSchema)]
pub struct Difference {
    frame: Option<String>,
    topic: String,
    #[schemars(rename = "type")]
    value_type: String,
    #[schemars(skip_serializing_if = "Option::is_none")]
    pixel: Option<[u32; 2]>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    channel: Option<u64>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    byte: Option<u64>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    /// A number, a text, or null where there is no answer.
    recorded: Json,
    now: Json,
    #[schemars(skip_serializing_if = "Option::is_none")]
    by: Option<Option<f64>>,
}
