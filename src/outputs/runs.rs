//! What is printed of runs.
#![expect(dead_code, reason = "these types are the schemas of what is printed")]

use schemars::JsonSchema;
use serde_json::Value as Json;

use super::experiments::{Error, Plan};
use super::tables::Report;

/// Of `run`: what was run, and what came of it.
#[derive(JsonSchema)]
pub struct Run {
    experiment: String,
    /// Its folder.
    run: String,
    /// The key of its plan: that of equal experiments, as Parquet files have it (`depthloom.run`).
    key: String,
    /// What was run, with every parameter: as `plan --json` tells it.
    parameters: Plan,
    /// By stage, its frames.
    frames: Vec<Frames>,
    /// How many frames failed.
    failed_frames: u64,
    /// What failed, frame by frame.
    failures: Vec<Failure>,
    reused: Reused,
    warnings: Vec<String>,
    environment: Environment,
    /// The files in its folder, by name.
    files: Vec<File>,
    /// As `report --json` tells it.
    report: Report,
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// The frames of a stage.
#[derive(JsonSchema)]
pub struct Frames {
    stage: String,
    /// Where variants have sources of their own, the first of this one.
    variant: Option<String>,
    /// The frames' ids; the place in this list is `position` in tables.
    ids: Vec<String>,
    /// How many of them failed somewhere.
    failed: u64,
}

/// What failed on a frame.
#[derive(JsonSchema)]
pub struct Failure {
    stage: String,
    /// Null where all variants share the node; of several, the first.
    variant: Option<String>,
    position: u64,
    frame: String,
    /// Null where the source failed.
    node: Option<String>,
    message: String,
}

/// What was reused from earlier runs.
#[derive(JsonSchema)]
pub struct Reused {
    nodes: Vec<ReusedNode>,
    /// The recordings that hold the reused values.
    from: Vec<String>,
    /// How many reused values the audit recomputed and found equal.
    audited: u64,
}

/// How often a node's values were taken.
#[derive(JsonSchema)]
pub struct ReusedNode {
    stage: String,
    node: String,
    reused: u64,
    of: u64,
}

/// Where and when a run was made: `environment.json`.
#[derive(JsonSchema)]
pub struct Environment {
    /// The version of the program.
    depthloom: String,
    arguments: Vec<String>,
    os: String,
    architecture: String,
    cores: u64,
    simd: Vec<String>,
    networks: Option<super::experiments::Engine>,
    /// The files and folders that it read.
    reads: Vec<String>,
    workers: u64,
    window: Option<u64>,
    finished_utc: String,
    /// Seconds from the start of the process to its last file.
    wall_s: f64,
    peak_resident_bytes: Option<u64>,
}

/// A file.
#[derive(JsonSchema)]
pub struct File {
    name: String,
    bytes: u64,
}

/// Of `runs`: the runs in a folder, newest first.
#[derive(JsonSchema)]
pub struct RunsList {
    folder: String,
    runs: Vec<Glance>,
}

/// A run at a glance.
#[derive(JsonSchema)]
pub struct Glance {
    name: String,
    path: String,
    time_utc: String,
    state: State,
    experiment: Option<String>,
    /// How many.
    variants: u64,
    frames: u64,
    failed_frames: u64,
    bytes: u64,
    best: Option<Best>,
    /// What is wrong with it.
    trouble: Option<String>,
    /// Why its values may be wrong although it is complete.
    warning: Option<String>,
}

/// How far a run came.
#[derive(JsonSchema)]
#[schemars(rename_all = "lowercase")]
pub enum State {
    Running,
    Whole,
    Unfinished,
    Damaged,
    Unreadable,
}

/// The best score of a run.
#[derive(JsonSchema)]
pub struct Best {
    score: String,
    value: f64,
    stage: String,
    variant: Option<String>,
    estimator: String,
}

/// Of `runs show`: a run.
#[derive(JsonSchema)]
pub struct RunsShow {
    name: String,
    path: String,
    time_utc: String,
    state: State,
    experiment: Option<String>,
    /// Their names.
    variants: Vec<String>,
    frames: u64,
    failed_frames: u64,
    bytes: u64,
    best: Option<Best>,
    trouble: Option<String>,
    /// Why its values may be wrong although it is complete.
    warning: Option<String>,
    about: Option<String>,
    stages: Vec<Stage>,
    /// What `environment.json` says; null where it says nothing.
    environment: Json,
    files: Vec<File>,
}

/// A stage of a run.
#[derive(JsonSchema)]
pub struct Stage {
    stage: String,
    /// Where variants have sources of their own, the first of this one.
    variant: Option<String>,
    frames: u64,
    source: String,
    source_kinds: Vec<String>,
    nodes: u64,
    /// The nodes that learnt a model.
    models: Vec<String>,
}

/// Of `runs why`: in what two runs differ.
#[derive(JsonSchema)]
pub struct RunsWhy {
    before: String,
    after: String,
    made_by: Vec<Difference>,
    experiment: Vec<Difference>,
    frames: Vec<FramesOfBoth>,
    nodes: Vec<NodeOfBoth>,
}

/// A difference: `what` says which of the other keys there are.
#[derive(JsonSchema)]
pub struct Difference {
    /// `kind`, `version`, `parameter`, `input`, `upstream` or `unseen`.
    what: String,
    #[schemars(skip_serializing_if = "Option::is_none")]
    path: Option<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    port: Option<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    before: Option<Json>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    after: Option<Json>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    from: Option<Json>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    files: Option<Json>,
}

/// The frames of a stage in both runs.
#[derive(JsonSchema)]
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
#[derive(JsonSchema)]
pub struct NodeOfBoth {
    stage: String,
    node: String,
    variants: Vec<String>,
    same: bool,
    /// `both`, `before` or `after`.
    #[schemars(rename = "in")]
    of: String,
    differences: Vec<Difference>,
    frames_in_both: u64,
    frames_of_equal_values: u64,
}

/// Of `runs rm`: what was removed.
#[derive(JsonSchema)]
pub struct RunsRm {
    removed: Vec<Removed>,
    bytes: u64,
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// Of `runs prune`: what was removed, or would be.
#[derive(JsonSchema)]
pub struct RunsPrune {
    dry_run: bool,
    /// How many runs were looked at.
    runs: u64,
    /// What the rules chose and was kept.
    kept: Vec<Kept>,
    removed: Vec<Removed>,
    bytes: u64,
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// A run that was kept, and why.
#[derive(JsonSchema)]
pub struct Kept {
    path: String,
    why: String,
}

/// A run that was removed.
#[derive(JsonSchema)]
pub struct Removed {
    path: String,
    bytes: u64,
}
