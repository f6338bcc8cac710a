//! What is printed of scores and times.
#![expect(dead_code, reason = "these types are the schemas of what is printed")]

use std::collections::BTreeMap;

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

/// Of `table` and `analyse`: what was asked.
#[derive(JsonSchema)]
pub struct Table {
    /// What the numbers are.
    about: String,
    /// The columns of its CSV form, which docs/tables.md explains.
    rows: Vec<BTreeMap<String, Option<Cell>>>,
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
