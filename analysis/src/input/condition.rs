//! What a report says of the recording itself: its condition, what is damaged in it, and which stages have frames.

use depthloom_graphs::counted;
use depthloom_graphs::plan::RunId;
use depthloom_recording::{Condition, Damage, DamagedContent, RecordedPlan, RecordedRun, Recording};
use schemars::JsonSchema;
use serde::Serialize;

use crate::tables::variant_of;

/// How many damaged places are told to people; programs are told all.
const SHOWN: usize = 5;

/// In what condition a recording is.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
#[schemars(rename = "Condition")]
pub struct RecordingCondition {
    /// `whole`, `unfinished`, `recovered` or `damaged`.
    condition: &'static str,
    frames: u64,
    stages: Vec<StageFrames>,
    /// What is wrong, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    what: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    damage: Option<Vec<DamagedPlace>>,
}

/// How many frames a stage has.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct StageFrames {
    stage: String,
    /// Where variants have sources of their own, the first of this one.
    variant: Option<String>,
    frames: u64,
}

impl StageFrames {
    /// Of each stage run of a recording, in the order of its plan.
    #[must_use]
    pub fn of(recording: &Recording) -> Vec<Self> {
        let plan = recording.plan();
        let of_run = |(run, planned): (RunId, &RecordedRun)| Self {
            stage: planned.stage.clone(),
            variant: variant_of(plan, &planned.variants).map(str::to_owned),
            frames: recording.frames(run).len() as u64,
        };
        RunId::enumerate(&plan.runs).map(of_run).collect()
    }
}

/// Bytes that are not what was written, and what they held.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct DamagedPlace {
    offset: u64,
    bytes: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    stage: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    position: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    frame: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    topics: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    attachment: Option<String>,
}

/// A recording's condition.
pub(crate) struct Findings {
    /// For programs.
    pub(crate) recording: RecordingCondition,
    /// For people, what there is to say.
    pub(crate) notes: Vec<String>,
    /// Whether bytes are not what was written.
    pub(crate) is_damaged: bool,
}

/// In what condition the recording is; `damage` is what was found in it beside what was read, and `has_numbers`,
/// whether the report has any.
pub(crate) fn findings(recording: &Recording, damage: &[Damage], has_numbers: bool) -> Findings {
    let plan = recording.plan();
    let frames: Vec<usize> = RunId::all(plan.runs.len()).map(|run| recording.frames(run).len()).collect();
    let condition = recording.condition();
    let is_damaged = matches!(condition, Condition::Damaged { .. }) || !damage.is_empty();
    let mut wrong = Vec::new();
    let mut notes = Vec::new();
    if *condition != Condition::Whole {
        let all: usize = frames.iter().sum();
        wrong.push(condition.to_string());
        let of_numbers = if has_numbers { "all numbers are of its" } else { "it has" };
        notes.push(format!("the recording is {condition}; {of_numbers} {}", counted(all, "whole frame")));
    }
    for Damage { offset, content, .. } in damage {
        wrong.push(format!("damaged at byte {offset}: it held {content}"));
    }
    for Damage { offset, content, .. } in &damage[..damage.len().min(SHOWN)] {
        notes.push(format!(
            "the recording is damaged at byte {offset}: it held {content}; no number here comes from there"
        ));
    }
    if damage.len() > SHOWN {
        let more = damage.len() - SHOWN;
        notes.push(format!(
            "the recording is damaged at {more} more places, which `--json` names; no number here comes from there"
        ));
    }
    let ends_early = !matches!(condition, Condition::Whole | Condition::Damaged { cut: false, .. });
    notes.extend(without_frames(plan, &frames, ends_early));
    let stages = StageFrames::of(recording);
    let recording = RecordingCondition {
        condition: if is_damaged { "damaged" } else { condition.name() },
        frames: frames.iter().sum::<usize>() as u64,
        stages,
        what: (!wrong.is_empty()).then(|| wrong.join("; ")),
        damage: (!damage.is_empty()).then(|| damage.iter().map(DamagedPlace::of).collect()),
    };
    Findings { recording, notes, is_damaged }
}

/// Of each stage run that has no frames that it has none, and of one that has fewer than another of the same source how
/// many.
fn without_frames(plan: &RecordedPlan, frames: &[usize], ends_early: bool) -> Vec<String> {
    let mut notes = Vec::new();
    for (run, &count) in plan.runs.iter().zip(frames) {
        let name = run.name();
        if count == 0 {
            let why = if ends_early { ": the recording ends before its first" } else { "" };
            notes.push(format!("stage `{name}` has no frames{why}"));
            continue;
        }
        let same = plan.runs.iter().zip(frames).filter(|(other, _)| other.source.parts == run.source.parts);
        if let Some((other, most)) = same.max_by_key(|(_, count)| **count).filter(|(_, most)| **most > count) {
            let other = other.name();
            notes.push(format!(
                "stage `{name}` has {count} of the {most} frames that stage `{other}` has of the same source"
            ));
        }
    }
    notes
}

impl DamagedPlace {
    fn of(damage: &Damage) -> Self {
        let Damage { offset, bytes, content } = damage;
        let (mut stage, mut position, mut frame, mut topics, mut attachment) = (None, None, None, None, None);
        match content {
            DamagedContent::Frame { stage: of, position: at, id, topics: of_frame } => {
                stage = Some(of.clone());
                position = Some(at.0 as u64);
                frame = Some(id.to_string());
                topics = Some(of_frame.clone());
            }
            DamagedContent::Curve(topic) => topics = Some(vec![topic.clone()]),
            DamagedContent::Attachment(name) => attachment = Some(name.clone()),
            DamagedContent::NoValue => {}
        }
        Self { offset: *offset, bytes: *bytes, stage, position, frame, topics, attachment }
    }
}
