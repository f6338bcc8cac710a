//! What a file of samples says of itself, in its metadata.

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
/// The columns that every file has.
pub(super) const FIXED: [&str; 7] = ["stage", "scoring", "position", "frame", "x", "y", "truth_m"];

/// What the samples are of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Described {
    /// The version of the layout.
    format: u32,
    /// The key of the run's plan.
    run: String,
    /// The experiment's name.
    experiment: String,
    /// Which recording they were taken from, by content: its plan, and the keys of its frames.
    recording: String,
    /// The estimates, in the order of their columns.
    pub(crate) estimates: Vec<DescribedEstimate>,
    /// The columns of weights, each with its stage.
    pub(crate) weights: Vec<DescribedWeight>,
}

/// An estimate's column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DescribedEstimate {
    /// The column.
    pub(crate) column: String,
    /// Its label: what people call it.
    pub(crate) label: String,
    /// Its stage, as the rows' `stage` says.
    pub(crate) stage: String,
    /// How it was scored, as the rows' `scoring` says.
    pub(crate) scoring: String,
    /// Its name under `estimates:`.
    pub(crate) estimate: String,
    /// Its variant; `None` if it is the same in all.
    pub(crate) variant: Option<String>,
    /// The axes of the experiment's matrix, and their values in the variant.
    pub(crate) factors: Vec<Level>,
}

/// A weight's column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DescribedWeight {
    /// The column.
    pub(crate) column: String,
    /// Its stage.
    pub(crate) stage: String,
    /// The variant whose it is alone; `None` if several share it.
    pub(crate) variant: Option<String>,
}

impl Described {
    /// Whether this version reads the layout.
    pub(super) const fn is_known(&self) -> bool {
        self.format == FORMAT
    }

    /// The key of the run's plan; `None` if this is damaged.
    pub(crate) fn run(&self) -> Option<Key> {
        Key::parse(&self.run)
    }

    /// The units of the columns that have one.
    pub(super) fn units(&self) -> impl Iterator<Item = (&str, &str)> {
        let fixed = [("x", "px"), ("y", "px"), ("truth_m", "m")];
        let of_estimates = self.estimates.iter().map(|of| (of.column.as_str(), "m"));
        fixed.into_iter().chain(of_estimates).chain(self.weights.iter().map(|of| (of.column.as_str(), DIMENSIONLESS)))
    }

    /// Whether they are of this recording, as it is now.
    pub(crate) fn is_of(&self, recording: &Recording) -> bool {
        self.recording == content_key(recording)
    }

    /// What the samples of a recording are of; by estimate among `estimates` and weight its topic.
    pub(crate) fn of(recording: &Recording, estimates: &[Estimate]) -> (Self, Vec<String>) {
        let plan = recording.plan();
        let mut taken: HashSet<String> = FIXED.iter().map(|column| (*column).to_owned()).collect();
        let mut column = |name: &str, stage: &str| {
            let mut column = name.to_owned();
            while !taken.insert(column.clone()) {
                column = format!("{stage}.{column}");
            }
            column
        };
        let described = |estimate: &Estimate| {
            let stage = plan.runs[estimate.run].name().to_owned();
            let RowKey { variant, factors, .. } = estimate.lead.clone();
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
        let of_estimates: Vec<DescribedEstimate> = estimates.iter().map(described).collect();
        let (mut weights, mut topics) = (Vec::new(), Vec::new());
        let scored: HashSet<RunId> = estimates.iter().map(|estimate| estimate.run).collect();
        for (run, planned) in RunId::enumerate(&plan.runs).filter(|(run, _)| scored.contains(run)) {
            let kept = |output: &depthloom_recording::RecordedOutput| {
                output.recorded && !output.once && output.value_type() == Some(ValueType::Weight)
            };
            for (slot, output) in plan.outputs(run).filter(|(_, output)| kept(output)) {
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
            estimates: of_estimates,
            weights,
        };
        (described, topics)
    }
}

/// How an estimate was scored; against which truth, where its stage has several.
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

/// What a recording's samples depend on: its plan, and which frames it has, with the keys of what they were made of.
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
