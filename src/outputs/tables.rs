//! What is printed of scores and times.
#![expect(dead_code, reason = "these types are the schemas of what is printed")]

use std::collections::BTreeMap;

use depthloom_analysis::StageFrames;
use schemars::JsonSchema;
use serde_json::Value as Json;

use crate::diagnostics::Error;

/// A cell of a table.
#[derive(JsonSchema)]
#[schemars(untagged)]
pub enum Cell {
    Number(f64),
    Text(String),
}

/// Of `report`: what was found.
#[derive(JsonSchema)]
pub struct Report {
    experiment: String,
    recording: Condition,
    /// The rows of `table.csv`.
    table: Vec<TableRow>,
    /// Where each learning curve ended.
    learning_curves: Vec<CurveEnd>,
    notes: Vec<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// A row of `table.csv`: beside these its scores, `density` and the axes of `matrix:`, as docs/tables.md explains.
#[derive(JsonSchema)]
pub struct TableRow {
    stage: String,
    /// Null where all variants share the row.
    variant: Option<String>,
    estimator: String,
    /// The pixels: `all`, `answered` or `filled`.
    set: String,
    frames: u64,
    #[schemars(flatten)]
    columns: BTreeMap<String, Option<Cell>>,
}

/// In what condition a recording is.
#[derive(JsonSchema)]
pub struct Condition {
    /// `whole`, `unfinished` or `damaged`.
    condition: String,
    frames: u64,
    stages: Vec<StageFrames>,
    /// What is wrong, in words.
    #[schemars(skip_serializing_if = "Option::is_none")]
    what: Option<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    damage: Option<Vec<DamagedPlace>>,
}

/// Bytes that are not what was written, and what they held.
#[derive(JsonSchema)]
pub struct DamagedPlace {
    offset: u64,
    bytes: u64,
    #[schemars(skip_serializing_if = "Option::is_none")]
    stage: Option<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    position: Option<u64>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    frame: Option<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    topics: Option<Vec<String>>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    attachment: Option<String>,
}

/// Where a learning curve ended.
#[derive(JsonSchema)]
pub struct CurveEnd {
    stage: String,
    variant: Option<String>,
    node: String,
    points: u64,
    step: Option<u64>,
    loss: Option<f64>,
    /// The last that was measured.
    validation: Option<f64>,
}

/// Of `samples`: what was written.
#[derive(JsonSchema)]
pub struct Samples {
    file: String,
    /// The rows.
    samples: u64,
    frames: u64,
    /// The columns of estimators.
    estimators: u64,
    notes: Vec<String>,
}

/// Of `table` and `analyse`: what was asked.
#[derive(JsonSchema)]
pub struct Table {
    /// What the numbers are.
    about: String,
    /// The columns of its CSV form, which docs/tables.md explains.
    rows: Vec<BTreeMap<String, Option<Cell>>>,
    notes: Vec<String>,
}

/// Of `figure`: what was drawn.
#[derive(JsonSchema)]
pub struct Figure {
    file: String,
    /// The file of the numbers that it shows; null where none was asked for.
    data: Option<String>,
    /// What it shows, over which pixels: the beginning of a caption.
    about: String,
    width_mm: f64,
    height_mm: f64,
    bytes: u64,
    /// What is to be said of it beside that.
    notes: Vec<String>,
}

/// Of `compare`: what is better, and how sure that is.
#[derive(JsonSchema)]
pub struct Compare {
    /// What the numbers are.
    about: String,
    method: CompareMethod,
    verdicts: Verdicts,
    /// By side, what was set otherwise than in the baseline.
    parameters: Vec<OtherParameters>,
    /// A score of a pair each: the columns of its CSV form, which docs/tables.md explains.
    rows: Vec<BTreeMap<String, Option<Cell>>>,
    /// How `--fail-if` is kept, by estimate.
    limits: Vec<Limit>,
    notes: Vec<String>,
    #[schemars(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// Of `compare --by distance`: where it is better, and how sure that is.
#[derive(JsonSchema)]
pub struct CompareByDistance {
    /// What the numbers are.
    about: String,
    method: DistanceMethod,
    verdicts: Verdicts,
    /// By pair and statistic: where one should hand over to the other.
    handovers: Vec<HandoverAt>,
    /// A bin, statistic and pair each: the columns of its CSV form, which docs/tables.md explains.
    rows: Vec<BTreeMap<String, Option<Cell>>>,
    notes: Vec<String>,
}

/// How intervals and tests were found.
#[derive(JsonSchema)]
pub struct DistanceMethod {
    /// `BCa` or `percentile`.
    interval: String,
    /// `percentile`: that of distances.
    handover_interval: String,
    /// From 0 to 1.
    confidence: f64,
    resamples: u64,
    seed: u64,
    /// `wilcoxon`.
    test: String,
    /// `holm`, over the bins of a pair's statistic.
    correction: String,
    /// How many tests were corrected for, of the first pair.
    tests: u64,
    /// Bins of fewer pixels decide nothing of a handover.
    thin_pixels: u64,
}

/// The distance at which one of two estimates should hand over to the other; nulls where one alone is best.
#[derive(JsonSchema)]
pub struct HandoverAt {
    baseline: String,
    other: String,
    /// `mean` or `median`.
    statistic: String,
    /// The one that is better nearer than there.
    near: Option<String>,
    far: Option<String>,
    distance_m: Option<f64>,
    /// The ends of its interval, of the resamples that have such a handover.
    distance_low_m: Option<f64>,
    distance_high_m: Option<f64>,
    /// The share of resamples that have one.
    share: Option<f64>,
    /// All distances at which the difference crosses zero.
    crossings_m: Vec<f64>,
}

/// How intervals and tests were found.
#[derive(JsonSchema)]
pub struct CompareMethod {
    /// `BCa` or `percentile`.
    interval: String,
    /// From 0 to 1.
    confidence: f64,
    resamples: u64,
    seed: u64,
    /// `wilcoxon`.
    test: String,
    /// `holm`.
    correction: String,
    /// How many tests were corrected for.
    tests: u64,
}

/// How many rows have which verdict.
#[derive(JsonSchema)]
pub struct Verdicts {
    better: u64,
    worse: u64,
    unclear: u64,
}

/// What was set otherwise in a side.
#[derive(JsonSchema)]
pub struct OtherParameters {
    side: String,
    /// As in `runs why`; `what` may also be `new` or `gone`, and `node` says whose it is.
    differences: Vec<BTreeMap<String, Json>>,
}

/// A limit held against a row.
#[derive(JsonSchema)]
pub struct Limit {
    /// As it was written.
    limit: String,
    /// The row's place in `rows`; null for `density`, which has no row.
    row: Option<u64>,
    /// In per cent of the baseline's value, or in the score's unit; null where the baseline's value is 0.
    change: Option<f64>,
    is_percent: bool,
    exceeded: bool,
}

/// Of `explain`: where a number comes from.
#[derive(JsonSchema)]
pub struct Explain {
    score: String,
    stage: String,
    variant: Option<String>,
    estimator: String,
    value: Option<f64>,
    /// Empty where it has none.
    unit: String,
    more_is_better: bool,
    set: String,
    /// Empty of the whole image.
    zone: String,
    /// `frames` or `pixels`.
    mean: String,
    facts: Vec<Fact>,
    frames: Vec<ScoredFrame>,
    /// The frames without which the number would be better most.
    worst: Vec<WorstFrame>,
    notes: Vec<String>,
}

/// What made a number.
#[derive(JsonSchema)]
pub struct Fact {
    what: String,
    here: String,
    /// What Martins et al. 2018 have.
    paper: Option<String>,
}

/// A frame's share in a number.
#[derive(JsonSchema)]
pub struct ScoredFrame {
    frame: String,
    position: u64,
    source_key: Option<String>,
    pixels: u64,
    value: Option<f64>,
}

/// A frame that made a number worse.
#[derive(JsonSchema)]
pub struct WorstFrame {
    frame: String,
    position: u64,
    source_key: Option<String>,
    pixels: u64,
    value: Option<f64>,
    /// The number without it.
    without: Option<f64>,
}

/// Of `timings`: where a run's time went.
#[derive(JsonSchema)]
pub struct Timings {
    timings: Vec<Timing>,
}

/// What a part of a run cost.
#[derive(JsonSchema)]
pub struct Timing {
    stage: String,
    /// Null where all variants share the node; of several, the first.
    variant: Option<String>,
    node: String,
    /// `read`, `process`, `once`, `encode`, `compress` or `write`.
    phase: String,
    frames: u64,
    cpu_ns: u64,
    wall_ns: u64,
    median_cpu_ns: Option<u64>,
}
