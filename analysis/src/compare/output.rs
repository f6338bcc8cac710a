//! A comparison for programs.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use super::contrast::Verdicts;
use super::limit::JudgedLimit;
use crate::input::parameters::Changed;
use crate::statistics::Resampling;
use crate::tables::JsonRow;

/// What is better, and how sure that is.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct ComparisonOutput {
    /// What the numbers are.
    pub(super) about: String,
    pub(super) method: CompareMethod,
    pub(super) verdicts: Verdicts,
    /// By side, what was set otherwise than in the baseline.
    pub(super) parameters: Vec<OtherParameters>,
    /// A score of a pair each: the columns of its CSV form, which docs/tables.md explains.
    pub(super) rows: Vec<JsonRow>,
    /// How `--fail-if` is kept, by estimate.
    pub(super) limits: Vec<JudgedLimit>,
    pub(super) notes: Vec<String>,
}

/// How intervals and tests were found.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct CompareMethod {
    /// `BCa` or `percentile`.
    interval: &'static str,
    /// From 0 to 1.
    pub(super) confidence: f64,
    resamples: u64,
    seed: u64,
    /// `wilcoxon`.
    test: &'static str,
    /// `holm`.
    correction: &'static str,
    /// How many tests were corrected for.
    pub(super) tests: u64,
}

impl CompareMethod {
    pub(super) fn new(resampling: &Resampling, tests: usize) -> Self {
        Self {
            interval: resampling.method.name(),
            confidence: resampling.confidence,
            resamples: resampling.resamples.into(),
            seed: resampling.seed,
            test: "wilcoxon",
            correction: "holm",
            tests: tests as u64,
        }
    }
}

/// What was set otherwise in a side.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct OtherParameters {
    pub(super) side: String,
    /// As in `runs diff`; `what` may also be `new` or `gone`, and `node` says whose it is.
    #[schemars(with = "Vec<BTreeMap<String, Json>>")]
    pub(super) differences: Vec<Changed>,
}
