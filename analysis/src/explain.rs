//! Explains the origin of a number in a table.

use depthloom_recording::{RecordedPlan, RecordedRun, Recording};
use depthloom_scores::{Align, Family, Mean, Metric, PixelSet, Preset, Settings};
use schemars::JsonSchema;
use serde::Serialize;

use crate::ablation::{
    Ablation, Selection, average, estimate_by_label, pixels_in_words, scored, select_frames, source_keys,
};
use crate::error::{AnalysisError, caught, unknown};
use crate::estimates::{Estimate, estimates};
use crate::input::condition::recording_notes;
use crate::input::paper::{is_of_kitti, paper_scores};
use crate::input::warnings::warnings;
use crate::scores::FrameScore;

/// The number of reported frames that changed the number most.
const WORST: usize = 3;
/// The number of frames for which the value without the frame is computed.
const TRIED: usize = 64;
/// The width of the names of facts, columns of text.
const NAMES: usize = 13;

/// The output of `explain`: the origin of a number.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct Explain {
    score: &'static str,
    stage: String,
    variant: Option<String>,
    estimate: String,
    value: Option<f64>,
    /// Empty if the metric has no unit.
    unit: &'static str,
    more_is_better: bool,
    set: &'static str,
    /// The zone; empty for the whole image.
    zone: String,
    /// `frames` or `pixels`.
    mean: &'static str,
    facts: Vec<Fact>,
    frames: Vec<ScoredFrame>,
    /// The frames whose removal would improve the number most.
    worst: Vec<WorstFrame>,
    notes: Vec<String>,
    #[serde(skip)]
    metric: &'static Metric,
    /// The estimate's label.
    #[serde(skip)]
    label: String,
}

/// A fact about the origin of a number.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct Fact {
    what: &'static str,
    here: String,
    /// The value of the fact in Martins et al. 2018.
    paper: Option<String>,
}

/// The contribution of a frame to a number.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct ScoredFrame {
    frame: String,
    position: u64,
    source_key: Option<String>,
    pixels: u64,
    value: Option<f64>,
}

/// A frame that made a number worse.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct WorstFrame {
    frame: String,
    position: u64,
    source_key: Option<String>,
    pixels: u64,
    value: Option<f64>,
    /// The number without this frame.
    without: Option<f64>,
}

/// Explains a score of an estimate from the recorded scores, without reading maps.
///
/// # Errors
/// If the recording cannot be read or its scores are damaged; [`AnalysisError::Request`] if the metric, estimate or
/// zone does not exist; [`AnalysisError::Stopped`] once `stop` returns true.
pub fn explain(
    recording: &Recording,
    metric: &str,
    estimate: &str,
    selection: &Selection,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Explain, AnalysisError> {
    caught(|| {
        let estimates = estimates(recording.plan())?;
        let index = estimates.iter().position(|known| known.label == estimate);
        let index = index
            .or_else(|| estimate_by_label(&estimates, estimate, metric))
            .ok_or_else(|| unknown("estimate", estimate, estimates.iter().map(|known| known.label.as_str())))?;
        let scores = select_frames(recording, &estimates, scored(recording, &estimates, stop)?, selection)?;
        let source = source_keys(recording);
        let ablation = Ablation::new(recording.plan(), &estimates, &scores, &source, None);
        explained(recording, &ablation, &estimates[index], index, metric, selection)
    })
}

fn explained(
    recording: &Recording,
    ablation: &Ablation<'_>,
    estimate: &Estimate,
    index: usize,
    metric: &str,
    selection: &Selection,
) -> Result<Explain, AnalysisError> {
    let metric = ablation.metrics[ablation.metric(metric)?];
    let zone = ablation.zone(selection)?;
    let set = selection.set.unwrap_or_else(|| estimate.sets.iter().copied().min().unwrap_or(PixelSet::All));
    if !estimate.sets.contains(&set) {
        let sets: Vec<String> = estimate.sets.iter().map(|set| format!("`--pixels {set}`")).collect();
        return Err(AnalysisError::request(
            format!("`{}` was not scored on `{set}`", estimate.label),
            format!("use {}", sets.join(" or ")),
        ));
    }
    let scores = ablation.frames(index, set, zone);
    if scores.iter().all(|score| !score.row.scores.iter().any(|(known, _)| known.name == metric.name)) {
        if estimate.metrics.contains(&metric) {
            return Err(AnalysisError::request(
                format!("`{}` of `{}` has no value on any selected frame", metric.name, estimate.label),
                "no pixel with ground truth is valid there; `depthloom table RUN --columns density` shows the share of valid pixels"
                    .to_owned(),
            ));
        }
        return Err(AnalysisError::request(
            format!("`{}` was not scored for `{}`", metric.name, estimate.label),
            "add it to `metrics` of its score and run again, or choose another estimate".to_owned(),
        ));
    }
    let settings = estimate.settings.unwrap_or_default();
    let mean = selection.mean.unwrap_or(estimate.mean);
    let value = |scores: &mut dyn Iterator<Item = &FrameScore>| match mean {
        Mean::Frames => average(scores.filter_map(|score| score.row.get(metric))),
        Mean::Pixels => metric.pooled(scores.map(|score| &score.row), &settings),
    };
    let all_frames = value(&mut scores.iter().copied());
    let recorded = recording.frames(estimate.run);
    let frames: Vec<ScoredFrame> = scores
        .iter()
        .map(|score| ScoredFrame {
            frame: score.frame.to_string(),
            position: score.position.0 as u64,
            source_key: recorded.get(score.position.0).and_then(|frame| frame.source_key).map(|key| key.to_string()),
            pixels: metric.pixels(&score.row),
            value: score.row.get(metric),
        })
        .collect();
    let without = |frame: usize| {
        value(&mut scores.iter().enumerate().filter(|(other, _)| *other != frame).map(|(_, score)| *score))
    };
    let plan = recording.plan();
    let facts = facts(plan, estimate, metric, set, zone, mean, &frames, recorded.len(), scores);
    Ok(Explain {
        score: metric.name,
        stage: estimate.row_key.stage.clone(),
        variant: estimate.row_key.variant.clone(),
        estimate: estimate.name.clone(),
        value: all_frames,
        unit: metric.unit,
        more_is_better: metric.more_is_better,
        set: set.name(),
        zone: zone.to_owned(),
        mean: mean.name(),
        facts,
        worst: worst(metric, &frames, all_frames, mean, without),
        frames,
        notes: [warnings(recording, Some(estimate.run)), recording_notes(recording)].concat(),
        metric,
        label: estimate.label.clone(),
    })
}

/// The frames that made the number worse, the largest change first.
fn worst(
    metric: &Metric,
    frames: &[ScoredFrame],
    all_frames: Option<f64>,
    mean: Mean,
    without: impl Fn(usize) -> Option<f64>,
) -> Vec<WorstFrame> {
    let Some(all_frames) = all_frames else { return Vec::new() };
    let weight = |frame: &ScoredFrame| if mean == Mean::Frames { 1.0 } else { frame.pixels as f64 };
    let mut worst: Vec<(f64, usize)> = frames
        .iter()
        .enumerate()
        .filter_map(|(place, frame)| {
            Some(((metric.goodness(all_frames) - metric.goodness(frame.value?)) * weight(frame), place))
        })
        .collect();
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    worst.truncate(TRIED);
    let mut worst: Vec<WorstFrame> = worst
        .into_iter()
        .map(|(_, place)| {
            let ScoredFrame { frame, position, source_key, pixels, value } = frames[place].clone();
            WorstFrame { frame, position, source_key, pixels, value, without: without(place) }
        })
        .collect();
    let moved = |frame: &WorstFrame| {
        frame.without.map_or(0.0, |without| metric.goodness(without) - metric.goodness(all_frames))
    };
    worst.sort_by(|a, b| moved(b).total_cmp(&moved(a)));
    worst.retain(|frame| frames.len() > 1 && moved(frame) > 0.0);
    worst.truncate(WORST);
    worst
}

#[expect(clippy::too_many_arguments, reason = "the facts need all of them")]
fn facts(
    plan: &RecordedPlan,
    estimate: &Estimate,
    metric: &Metric,
    set: PixelSet,
    zone: &str,
    mean: Mean,
    frames: &[ScoredFrame],
    recorded_frames: usize,
    scores: &[&FrameScore],
) -> Vec<Fact> {
    let run = &plan.runs[estimate.run];
    let mut facts = Vec::new();
    let mut fact = |what, here: String, paper: Option<String>| facts.push(Fact { what, here, paper });
    let place = Family::Depth.defaults().iter().position(|known| known.name == metric.name);
    let paper_fact = |text: String| place.map(|_| text);

    if let Some(number) = place
        .and_then(|place| Some(paper_scores(estimate, set)?[place]))
        .filter(|_| zone.is_empty() && is_of_kitti(run))
    {
        fact("the paper", format!("{number:.2} in Table I of Martins et al. 2018"), None);
    }
    let paper = Preset::Martins2018.settings();
    let formula = |settings: &Settings| metric.formula_with(settings).to_owned();
    fact("formula", formula(&estimate.settings.unwrap_or_default()), paper_fact(formula(&paper)));
    fact("after", metric.source.to_owned(), None);
    fact("scored with", estimate.preset.clone(), paper_fact("preset martins2018".to_owned()));
    let pixels = match zone {
        "" => pixels_in_words(set).to_owned(),
        zone => format!("{} of zone {zone}", pixels_in_words(set)),
    };
    fact("pixels", format!("{} (set `{set}`)", pixels.replace("each", "it")), None);
    if let Some(settings) = &estimate.settings {
        let bounds = |settings: &Settings| {
            let (least, most) = (settings.min_m, settings.max_m);
            format!("{least} m < ground truth < {most} m, estimates clamped to that range")
        };
        fact("caps", bounds(settings), paper_fact(bounds(&paper)));
        if set == PixelSet::All {
            let missing = |settings: &Settings| format!("an invalid pixel counts as {} m", settings.missing_m);
            fact("invalid", missing(settings), paper_fact(missing(&paper)));
        }
        let crop = |settings: &Settings| format!("{:?}", settings.crop).to_lowercase();
        fact("crop", crop(settings), paper_fact(crop(&paper)));
        let align = |settings: &Settings| match settings.align {
            Align::None => "none".to_owned(),
            align => format!("{}, frame by frame over the scored valid pixels", align.name()),
        };
        fact("alignment", align(settings), paper_fact(align(&paper)));
    }
    let means = |mean| match mean {
        Mean::Frames => "over frames, with equal weights".to_owned(),
        Mean::Pixels => "over the pixels of all frames".to_owned(),
    };
    fact("mean", means(mean), paper_fact(means(Mean::Frames)));
    fact("frames", frames_text(frames, recorded_frames), None);
    let (valid, truth) = (
        scores.iter().map(|score| score.row.valid).sum::<u64>(),
        scores.iter().map(|score| score.row.truth).sum::<u64>(),
    );
    if truth > 0 {
        let share = 100.0 * valid as f64 / truth as f64;
        let pooled = format!("{valid} of {truth} pixels with ground truth ({share:.2} %)");
        // The density in tables is a mean over frames. It differs from the share of all pixels if frames have different
        // numbers of pixels.
        let with_truth = scores.iter().filter(|score| score.row.truth > 0);
        let frame_mean = average(with_truth.map(|score| score.row.valid as f64 / score.row.truth as f64));
        let frame_mean =
            frame_mean.map(|mean| format!("{:.2} %", 100.0 * mean)).filter(|mean| *mean != format!("{share:.2} %"));
        let frame_mean = frame_mean
            .filter(|_| mean == Mean::Frames)
            .map(|mean| format!("; the density in tables is the mean over frames: {mean}"));
        fact("valid", format!("{pooled}{}", frame_mean.unwrap_or_default()), None);
    }
    for part in &run.source.parts {
        let text = format!("{}: {} version {} {}", run.source.name, part.kind, part.version, part.params);
        fact("source", text, None);
    }
    if let Some(key) = frames.first().and_then(|frame| frame.source_key.as_ref()) {
        fact("key", format!("{key}, source values of frame {}", frames[0].frame), None);
    }
    let topic = |what: &str, output: Option<&String>, recorded: Option<&String>| match (output, recorded) {
        (_, Some(topic)) => format!("{what} {topic}"),
        (Some(topic), None) => format!("{what} {topic}, not recorded"),
        (None, None) => format!("{what} was not recorded"),
    };
    fact("scores", topic("topic", None, estimate.score_topic.as_ref()), None);
    let row_key = &estimate.row_key;
    let variant = row_key.variant.as_deref().unwrap_or("empty");
    let place = format!("`stage` {}, `variant` {variant}, `estimate` {}, `set` {set}", row_key.stage, estimate.name);
    fact("files", format!("scores.csv (by frame) and table.csv, rows with {place}"), None);
    let output = topic("topic", estimate.scored_output.as_ref(), estimate.estimate_topic.as_ref());
    fact("estimate", format!("{output}{}", computed_by(run, estimate.scored_output.as_deref())), None);
    let truth = topic("topic", estimate.truth_output.as_ref(), estimate.truth_topic.as_ref());
    fact("ground truth", format!("{truth}{}", computed_by(run, estimate.truth_output.as_deref())), None);
    facts
}

/// The node that computes a topic, and its hash.
fn computed_by(run: &RecordedRun, topic: Option<&str>) -> String {
    let computes = |node: &&depthloom_recording::RecordedNode| {
        node.outputs.iter().any(|output| Some(output.topic.as_str()) == topic)
    };
    run.nodes.iter().find(computes).map_or_else(String::new, |node| {
        format!(
            ", from {}.{} ({} version {}, node hash {})",
            run.stage, node.name, node.kind, node.version, node.node_hash
        )
    })
}

fn frames_text(frames: &[ScoredFrame], recorded: usize) -> String {
    const NAMED: usize = 6;
    let counted: Vec<&ScoredFrame> = frames.iter().filter(|frame| frame.pixels > 0).collect();
    let pixels: u64 = counted.iter().map(|frame| frame.pixels).sum();
    let names: Vec<&str> = counted.iter().map(|frame| frame.frame.as_str()).collect();
    let names = match names.as_slice() {
        [] => "none".to_owned(),
        [names @ .., last] if names.len() >= NAMED => format!("{}, ... {last}", names[..NAMED - 1].join(", ")),
        names => names.join(", "),
    };
    format!("{} of {recorded} ({names}); {pixels} pixels", counted.len())
}

impl Explain {
    /// As text.
    #[must_use]
    pub fn text(&self) -> String {
        let decimals = self.metric.decimals + 2;
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.decimals$}"));
        let unit = if self.metric.unit.is_empty() { String::new() } else { format!(" {}", self.metric.unit) };
        let better = self.metric.better();
        let mut text = format!("{} of {}: {}{unit} ({better})\n\n", self.metric.name, self.label, number(self.value));
        for Fact { what, here, paper } in &self.facts {
            let (same, other) = match paper {
                Some(paper) if paper == here => (" (as in Martins et al. 2018)", None),
                Some(paper) => ("", Some(paper)),
                None => ("", None),
            };
            text.push_str(&format!("  {what:<NAMES$}{here}{same}\n"));
            if let Some(paper) = other {
                text.push_str(&format!("  {:<NAMES$}in Martins et al. 2018: {paper}\n", ""));
            }
        }
        if !self.worst.is_empty() {
            text.push_str("\nframes that made it worse, largest change first\n");
            let wide = self.worst.iter().map(|worst| worst.frame.chars().count()).max().unwrap_or(0);
            for WorstFrame { frame, position, pixels, value, without, .. } in &self.worst {
                text.push_str(&format!(
                    "  {frame:<wide$}  position {position}, {pixels} pixels: {}; without it {}\n",
                    number(*value),
                    number(*without)
                ));
            }
        }
        for note in &self.notes {
            text.push_str(&format!("note: {note}\n"));
        }
        text
    }
}
