//! The metadata of a samples file.

use std::collections::HashSet;

use depthloom_graphs::plan::RunId;
use depthloom_graphs::{Key, ValueType};
use depthloom_recording::{RecordedPlan, Recording};
use serde::{Deserialize, Serialize};

use crate::estimates::Estimate;
use crate::tables::DIMENSIONLESS;
use crate::tables::{Level, RowKey, plan_key};

/// The version of the layout.
const FORMAT: u32 = 2;
/// The columns of every file.
pub(super) const FIXED: [&str; 7] = ["stage", "scoring", "position", "frame", "x", "y", "ground_truth_m"];

/// Describes the samples.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Described {
    /// The version of the layout.
    format: u32,
    /// The key of the run's plan.
    run: String,
    /// The experiment's name.
    pub(crate) experiment: String,
    /// A key of the contents of the recording: its plan, and the keys of its frames.
    recording: String,
    /// The estimates, in the order of their columns.
    pub(crate) estimates: Vec<DescribedEstimate>,
    /// The columns of confidences, each with its stage.
    pub(crate) weights: Vec<DescribedWeight>,
}

/// The column of an estimate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DescribedEstimate {
    /// The name of the column.
    pub(crate) column: String,
    /// The label of the estimate.
    pub(crate) label: String,
    /// Its stage, as in the column `stage`.
    pub(crate) stage: String,
    /// Its scoring, as in the column `scoring`.
    pub(crate) scoring: String,
    /// Its name under `estimates:`.
    pub(crate) estimate: String,
    /// Its variant; `None` if it is the same in all.
    pub(crate) variant: Option<String>,
    /// The axes of the experiment's matrix, and their values in the variant.
    pub(crate) factors: Vec<Level>,
}

/// The column of a confidence.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DescribedWeight {
    /// The name of the column.
    pub(crate) column: String,
    /// Its stage.
    pub(crate) stage: String,
    /// Its variant; `None` if several variants share it.
    pub(crate) variant: Option<String>,
}

impl Described {
    /// Whether this version reads the layout.
    pub(super) const fn is_known(&self) -> bool {
        self.format == FORMAT
    }

    /// The key of the run's plan; `None` if it is damaged.
    pub(crate) fn run(&self) -> Option<Key> {
        Key::parse(&self.run)
    }

    /// The units of the columns that have one.
    pub(super) fn units(&self) -> impl Iterator<Item = (&str, &str)> {
        let fixed = [("x", "px"), ("y", "px"), ("ground_truth_m", "m")];
        let estimates = self.estimates.iter().map(|estimate| (estimate.column.as_str(), "m"));
        let weights = self.weights.iter().map(|weight| (weight.column.as_str(), DIMENSIONLESS));
        fixed.into_iter().chain(estimates).chain(weights)
    }

    /// Whether the samples match the current state of the recording.
    pub(crate) fn matches(&self, recording: &Recording) -> bool {
        self.recording == content_key(recording)
    }

    /// States that frames of the recording are left out.
    pub(super) fn set_incomplete(&mut self) {
        self.recording.push_str(" in part");
    }

    /// Describes the samples of a recording, and lists the topics of the confidences.
    pub(crate) fn new(recording: &Recording, estimates: &[Estimate]) -> (Self, Vec<String>) {
        let plan = recording.plan();
        let mut used: HashSet<String> = FIXED.iter().map(|column| (*column).to_owned()).collect();
        let mut column = |name: &str, stage: &str| {
            let mut column = name.to_owned();
            while !used.insert(column.clone()) {
                column = format!("{stage}.{column}");
            }
            column
        };
        let described = |estimate: &Estimate| {
            let stage = plan.runs[estimate.run].name().to_owned();
            let RowKey { variant, factors, .. } = estimate.row_key.clone();
            DescribedEstimate {
                column: column(&estimate.label, &stage),
                label: estimate.label.clone(),
                stage,
                scoring: scoring(plan, estimates, estimate),
                estimate: estimate.name.clone(),
                variant,
                factors,
            }
        };
        let described_estimates: Vec<DescribedEstimate> = estimates.iter().map(described).collect();
        let (mut weights, mut topics) = (Vec::new(), Vec::new());
        let scored: HashSet<RunId> = estimates.iter().map(|estimate| estimate.run).collect();
        for (run, planned) in RunId::enumerate(&plan.runs).filter(|(run, _)| scored.contains(run)) {
            let is_confidence = |output: &depthloom_recording::RecordedOutput| {
                output.recorded && !output.once && output.value_type() == Some(ValueType::Weight)
            };
            for (slot, output) in plan.outputs(run).filter(|(_, output)| is_confidence(output)) {
                let name = output.topic.strip_prefix(planned.prefix.as_str()).unwrap_or(&output.topic);
                let name = name.trim_start_matches('/');
                let name = name.rsplit_once('/').map_or(name.to_owned(), |(node, port)| format!("{node}.{port}"));
                let variants = match slot {
                    depthloom_graphs::contracts::Slot::Node { node, .. } => planned.nodes[node].variants.as_slice(),
                    depthloom_graphs::contracts::Slot::Source { .. } => &planned.variants,
                };
                let variant = match variants {
                    [one] => plan.variants.get(one.0).cloned().filter(|name| !name.is_empty()),
                    _ => None,
                };
                weights.push(DescribedWeight {
                    column: column(&name, planned.name()),
                    stage: planned.name().to_owned(),
                    variant,
                });
                topics.push(output.topic.clone());
            }
        }
        let described = Self {
            format: FORMAT,
            run: plan_key(plan).to_string(),
            experiment: plan.experiment.clone(),
            recording: content_key(recording),
            estimates: described_estimates,
            weights,
        };
        (described, topics)
    }
}

/// Describes the scoring of an estimate, with its ground truth if the stage has several.
fn scoring(plan: &RecordedPlan, estimates: &[Estimate], estimate: &Estimate) -> String {
    let several = estimates.iter().any(|other| other.run == estimate.run && other.truth_topic != estimate.truth_topic);
    match estimate.truth_topic.as_deref().filter(|_| several) {
        None => estimate.preset.clone(),
        Some(topic) => {
            let prefix = plan.runs[estimate.run].prefix.as_str();
            let truth = topic.strip_prefix(prefix).unwrap_or(topic).trim_start_matches('/');
            format!("{} against {truth}", estimate.preset)
        }
    }
}

/// A key of everything that the samples depend on: the plan of the recording, its frames, and the keys of their
/// sources.
fn content_key(recording: &Recording) -> String {
    let mut key = Key::digest("depthloom samples").key(&plan_key(recording.plan()));
    for run in RunId::all(recording.plan().runs.len()) {
        let frames = recording.frames(run);
        key = key.number(frames.len() as u64);
        for frame in frames {
            key = key.text(&frame.id).number(frame.index);
            if let Some(source) = &frame.source_key {
                key = key.key(source);
            }
            key = key.number(frame.keys.len() as u64);
        }
    }
    key.finish().to_string()
}
