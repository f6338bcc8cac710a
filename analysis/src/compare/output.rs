//! The JSON output of a comparison.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use super::contrast::Verdicts;
use super::limit::JudgedLimit;
use crate::input::parameters::Changed;
use crate::statistics::{Grouping, Resampling};
use crate::tables::JsonRow;

/// The output of `compare`: differences, with intervals and tests.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct ComparisonOutput {
    /// Describes the numbers.
    pub(super) about: String,
    pub(super) method: CompareMethod,
    pub(super) verdicts: Verdicts,
    /// For each side, the parameters that differ from the baseline.
    pub(super) parameters: Vec<OtherParameters>,
    /// One row per metric of a pair, with the columns of the CSV form, which docs/tables.md explains.
    pub(super) rows: Vec<JsonRow>,
    /// The result of each `--fail-if`, by estimate.
    pub(super) limits: Vec<JudgedLimit>,
    pub(super) notes: Vec<String>,
}

/// The method of intervals and tests.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct CompareMethod {
    /// `BCa` or `percentile`.
    interval: &'static str,
    /// From 0 to 1.
    pub(super) confidence: f64,
    resamples: u64,
    seed: u64,
    /// What is resampled and ranked: `frames`, or groups of frames.
    unit: String,
    /// `wilcoxon`.
    test: &'static str,
    /// `holm`.
    correction: &'static str,
    /// The number of tests in the correction.
    pub(super) tests: u64,
}

impl CompareMethod {
    pub(super) fn new(resampling: &Resampling, grouping: Option<&Grouping>, tests: usize) -> Self {
        Self {
            interval: resampling.method.name(),
            confidence: resampling.confidence,
            resamples: resampling.resamples.into(),
            seed: resampling.seed,
            unit: grouping.map_or_else(|| "frames".to_owned(), Grouping::unit),
            test: "wilcoxon",
            correction: "holm",
            tests: tests as u64,
        }
    }
}

/// The parameters of a side that differ from the baseline.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct OtherParameters {
    pub(super) side: String,
    /// As in `runs diff`; `what` may also be `new` or `gone`, and `node` names the node.
    #[schemars(with = "Vec<BTreeMap<String, Json>>")]
    pub(super) differences: Vec<Changed>,
}
