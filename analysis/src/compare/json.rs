//! A comparison for programs.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use super::answer::Comparison;
use super::contrast::Verdicts;
use super::limit::{Judged, Measure};
use super::parameters::Changed;
use crate::sheet::SheetRow;
use crate::statistics::Resampling;

/// What is better, and how sure that is.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct ComparisonOutput {
    /// What the numbers are.
    about: String,
    method: CompareMethod,
    verdicts: Verdicts,
    /// By side, what was set otherwise than in the baseline.
    parameters: Vec<OtherParameters>,
    /// A score of a pair each: the columns of its CSV form, which docs/tables.md explains.
    rows: Vec<SheetRow>,
    /// How `--fail-if` is kept, by estimate.
    limits: Vec<JudgedLimit>,
    notes: Vec<String>,
}

/// How intervals and tests were found.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct CompareMethod {
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
pub struct OtherParameters {
    pub(super) side: String,
    /// As in `runs why`; `what` may also be `new` or `gone`, and `node` says whose it is.
    #[schemars(with = "Vec<BTreeMap<String, Json>>")]
    pub(super) differences: Vec<Changed>,
}

/// A limit held against a row.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
#[schemars(rename = "Limit")]
pub struct JudgedLimit {
    /// As it was written.
    limit: String,
    /// The row's place in `rows`; null for `density`, which has no row.
    row: Option<u64>,
    /// In per cent of the baseline's value, or in the score's unit; null where the baseline's value is 0.
    change: Option<f64>,
    is_percent: bool,
    exceeded: bool,
}

impl From<&Judged> for JudgedLimit {
    fn from(judged: &Judged) -> Self {
        Self {
            limit: judged.limit.clone(),
            row: matches!(judged.measure, Measure::Metric(_)).then_some(judged.contrast as u64),
            change: Some(judged.change),
            is_percent: judged.is_relative,
            exceeded: judged.is_exceeded,
        }
    }
}

impl Comparison {
    /// For programs, with the columns of its CSV form.
    #[must_use]
    pub fn output(&self) -> ComparisonOutput {
        ComparisonOutput {
            about: self.grid.about.clone(),
            method: self.method.clone(),
            verdicts: self.rows.iter().map(|row| row.contrast.verdict).collect(),
            parameters: self.parameters.clone(),
            rows: self.grid.sheet().rows(),
            limits: self.judged.iter().map(JudgedLimit::from).collect(),
            notes: self.grid.notes.clone(),
        }
    }
}
