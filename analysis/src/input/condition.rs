//! The condition of a recording: whether it is complete, what is damaged, and which stages have frames.

use depthloom_graphs::counted;
use depthloom_graphs::plan::RunId;
use depthloom_recording::{Condition, Damage, DamagedContent, RecordedPlan, RecordedRun, Recording};
use schemars::JsonSchema;
use serde::Serialize;

use crate::tables::variant_of;

/// The number of damaged places in notes; JSON output lists all.
const SHOWN: usize = 5;

/// The condition of a recording.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
#[schemars(rename = "Condition")]
pub struct RecordingCondition {
    /// `complete`, `unfinished`, `recovered` or `damaged`.
    condition: &'static str,
    frames: u64,
    stages: Vec<StageFrames>,
    /// Describes what is wrong.
    #[serde(skip_serializing_if = "Option::is_none")]
    what: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    damage: Option<Vec<DamagedPlace>>,
}

/// The number of frames of a stage.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct StageFrames {
    stage: String,
    /// The first variant of this source, if variants have different sources.
    variant: Option<String>,
    frames: u64,
}

impl StageFrames {
    /// The frame counts of all stage runs, in the order of the plan.
    #[must_use]
    pub fn all(recording: &Recording) -> Vec<Self> {
        let plan = recording.plan();
        let count = |(run, planned): (RunId, &RecordedRun)| Self {
            stage: planned.stage.clone(),
            variant: variant_of(plan, &planned.variants).map(str::to_owned),
            frames: recording.frames(run).len() as u64,
        };
        RunId::enumerate(&plan.runs).map(count).collect()
    }
}

/// Damaged bytes, and what they contained.
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
    /// For JSON output.
    pub(crate) recording: RecordingCondition,
    /// Notes for text output.
    pub(crate) notes: Vec<String>,
    /// Whether bytes are damaged.
    pub(crate) is_damaged: bool,
}

/// The condition of the recording. `damage` is the damage found outside of what was read; `has_numbers` states whether
/// the report has numbers.
pub(crate) fn findings(recording: &Recording, damage: &[Damage], has_numbers: bool) -> Findings {
    let plan = recording.plan();
    let frames: Vec<usize> = RunId::all(plan.runs.len()).map(|run| recording.frames(run).len()).collect();
    let condition = recording.condition();
    let is_damaged = matches!(condition, Condition::Damaged { .. }) || !damage.is_empty();
    let mut wrong = Vec::new();
    let mut notes = Vec::new();
    if *condition != Condition::Complete {
        let all: usize = frames.iter().sum();
        wrong.push(condition.to_string());
        let frames = counted(all, "complete frame");
        let scope = if has_numbers { format!("all numbers cover its {frames}") } else { format!("it has {frames}") };
        notes.push(format!("the recording is {condition}; {scope}"));
    }
    for Damage { offset, content, .. } in damage {
        wrong.push(format!("damaged at byte {offset}, which contained {content}"));
    }
    for Damage { offset, content, .. } in &damage[..damage.len().min(SHOWN)] {
        notes.push(format!(
            "the recording is damaged at byte {offset}, which contained {content}; no number here depends on it"
        ));
    }
    if damage.len() > SHOWN {
        let more = damage.len() - SHOWN;
        notes.push(format!(
            "the recording is damaged at {more} more places (all with `--json`); no number here depends on them"
        ));
    }
    let ends_early = !matches!(condition, Condition::Complete | Condition::Damaged { cut: false, .. });
    notes.extend(without_frames(plan, &frames, ends_early));
    let stages = StageFrames::all(recording);
    let recording = RecordingCondition {
        condition: if is_damaged { "damaged" } else { condition.name() },
        frames: frames.iter().sum::<usize>() as u64,
        stages,
        what: (!wrong.is_empty()).then(|| wrong.join("; ")),
        damage: (!damage.is_empty()).then(|| damage.iter().map(DamagedPlace::new).collect()),
    };
    Findings { recording, notes, is_damaged }
}

/// Notes on the condition of a recording: for example that it is unfinished, or that a stage has fewer frames than
/// another.
#[must_use]
pub fn recording_notes(recording: &Recording) -> Vec<String> {
    findings(recording, &[], true).notes
}

/// Notes on stage runs without frames, and on those with fewer frames than another stage run of the same source.
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
                "stage `{name}` has {count} frames, but stage `{other}` has {most} frames of the same source"
            ));
        }
    }
    notes
}

impl DamagedPlace {
    fn new(damage: &Damage) -> Self {
        let Damage { offset, bytes, content } = damage;
        let (mut stage, mut position, mut frame, mut topics, mut attachment) = (None, None, None, None, None);
        match content {
            DamagedContent::Frame { stage: name, position: at, id, topics: damaged } => {
                stage = Some(name.clone());
                position = Some(at.0 as u64);
                frame = Some(id.to_string());
                topics = Some(damaged.clone());
            }
            DamagedContent::Curve(topic) => topics = Some(vec![topic.clone()]),
            DamagedContent::Attachment(name) => attachment = Some(name.clone()),
            DamagedContent::NoValue => {}
        }
        Self { offset: *offset, bytes: *bytes, stage, position, frame, topics, attachment }
    }
}
