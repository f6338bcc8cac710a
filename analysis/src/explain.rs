//! Where a number of a table comes from.

use depthloom_recording::{RecordedPlan, RecordedRun, Recording};
use depthloom_scores::{Align, Family, Mean, Metric, PixelSet, Preset, Settings};
use schemars::JsonSchema;
use serde::Serialize;

use crate::ablation::{Ablation, Selection, average, of_frames, of_label, pixels_of, scored, source_of};
use crate::error::{AnalysisError, caught, unknown};
use crate::estimates::{Estimate, estimates};
use crate::input::condition;
use crate::input::paper::{is_of_kitti, paper_scores};
use crate::input::warnings::warnings;
use crate::scores::FrameScore;

/// How many frames are told that moved a number most.
const WORST: usize = 3;
/// Of so many frames it is tried what the number were without them.
const TRIED: usize = 64;
/// What a line of the explanation is called: columns of text.
const NAMES: usize = 13;

/// Of `explain`: where a number comes from.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct Explain {
    score: &'static str,
    stage: String,
    variant: Option<String>,
    estimate: String,
    value: Option<f64>,
    /// Empty where it has none.
    unit: &'static str,
    more_is_better: bool,
    set: &'static str,
    /// Empty of the whole image.
    zone: String,
    /// `frames` or `pixels`.
    mean: &'static str,
    facts: Vec<Fact>,
    frames: Vec<ScoredFrame>,
    /// The frames without which the number would be better most.
    worst: Vec<WorstFrame>,
    notes: Vec<String>,
    #[serde(skip)]
    metric: &'static Metric,
    /// The estimate's label.
    #[serde(skip)]
    label: String,
}

/// What made a number.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct Fact {
    what: &'static str,
    here: String,
    /// What Martins et al. 2018 have.
    paper: Option<String>,
}

/// A frame's share in a number.
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
    /// The number without it.
    without: Option<f64>,
}

/// Explains a score of an estimate, from a recording's scores alone: no map is read.
///
/// # Errors
/// If the recording cannot be read or is damaged where scores are; [`AnalysisError::Request`] if there is no such
/// score, estimate or zone; [`AnalysisError::Stopped`] once `stop` says so.
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
            .or_else(|| of_label(&estimates, estimate, metric))
            .ok_or_else(|| unknown("estimate", estimate, estimates.iter().map(|known| known.label.as_str())))?;
        let scores = of_frames(recording, &estimates, scored(recording, &estimates, stop)?, selection)?;
        let source = source_of(recording);
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
        let sets: Vec<String> = estimate.sets.iter().map(|set| format!("`--set {set}`")).collect();
        return Err(AnalysisError::asked(
            format!("`{}` was not scored on `{set}`", estimate.label),
            format!("take {}", sets.join(" or ")),
        ));
    }
    let scores = ablation.frames(index, set, zone);
    if scores.iter().all(|score| !score.row.scores.iter().any(|(of, _)| of.name == metric.name)) {
        return Err(AnalysisError::asked(
            format!("`{}` was not taken of `{}`", metric.name, estimate.label),
            "name it in `metrics` of its score and run again, or name another estimate".to_owned(),
        ));
    }
    let settings = estimate.settings.unwrap_or_default();
    let mean = selection.mean.unwrap_or(estimate.mean);
    let value = |scores: &mut dyn Iterator<Item = &FrameScore>| match mean {
        Mean::Frames => average(scores.filter_map(|score| score.row.get(metric))),
        Mean::Pixels => metric.pooled(scores.map(|score| &score.row), &settings),
    };
    let whole = value(&mut scores.iter().copied());
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
        stage: estimate.lead.stage.clone(),
        variant: estimate.lead.variant.clone(),
        estimate: estimate.name.clone(),
        value: whole,
        unit: metric.unit,
        more_is_better: metric.more_is_better,
        set: set.name(),
        zone: zone.to_owned(),
        mean: mean.name(),
        facts,
        worst: worst(metric, &frames, whole, mean, without),
        frames,
        notes: [warnings(recording, Some(estimate.run)), condition::findings(recording, &[], true).notes].concat(),
        metric,
        label: estimate.label.clone(),
    })
}

/// The frames that made a number worse, the one that did it most first.
fn worst(
    metric: &Metric,
    frames: &[ScoredFrame],
    whole: Option<f64>,
    mean: Mean,
    without: impl Fn(usize) -> Option<f64>,
) -> Vec<WorstFrame> {
    let Some(whole) = whole else { return Vec::new() };
    let sign = if metric.more_is_better { -1.0 } else { 1.0 };
    let weight = |frame: &ScoredFrame| if mean == Mean::Frames { 1.0 } else { frame.pixels as f64 };
    let mut worst: Vec<(f64, usize)> = frames
        .iter()
        .enumerate()
        .filter_map(|(place, frame)| Some((sign * (frame.value? - whole) * weight(frame), place)))
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
    let moved = |frame: &WorstFrame| frame.without.map_or(0.0, |without| sign * (whole - without));
    worst.sort_by(|a, b| moved(b).total_cmp(&moved(a)));
    worst.retain(|of| frames.len() > 1 && moved(of) > 0.0);
    worst.truncate(WORST);
    worst
}

#[expect(clippy::too_many_arguments, reason = "a fact is of each of them")]
fn facts(
    plan: &RecordedPlan,
    estimate: &Estimate,
    metric: &Metric,
    set: PixelSet,
    zone: &str,
    mean: Mean,
    frames: &[ScoredFrame],
    of_frames: usize,
    scores: &[&FrameScore],
) -> Vec<Fact> {
    let run = &plan.runs[estimate.run];
    let mut facts = Vec::new();
    let mut fact = |what, here: String, paper: Option<String>| facts.push(Fact { what, here, paper });
    let place = Family::Depth.defaults().iter().position(|of| of.name == metric.name);
    let of_paper = |text: String| place.map(|_| text);

    if let Some(number) = place
        .and_then(|place| Some(paper_scores(estimate, set)?[place]))
        .filter(|_| zone.is_empty() && is_of_kitti(run))
    {
        fact("the paper", format!("{number:.2} in Table I of Martins et al. 2018"), None);
    }
    let paper = Preset::Paper.settings();
    let formula = |of: &Settings| metric.formula_with(of).to_owned();
    fact("formula", formula(&estimate.settings.unwrap_or_default()), of_paper(formula(&paper)));
    fact("after", metric.source.to_owned(), None);
    fact("scored with", estimate.preset.clone(), of_paper("preset paper".to_owned()));
    let pixels = match zone {
        "" => pixels_of(set).to_owned(),
        zone => format!("{} of zone {zone}", pixels_of(set)),
    };
    fact("pixels", format!("{} (set `{set}`)", pixels.replace("each", "it")), None);
    if let Some(settings) = &estimate.settings {
        let bounds = |of: &Settings| format!("{} m < truth < {} m, answers clamped to that", of.min_m, of.max_m);
        fact("caps", bounds(settings), of_paper(bounds(&paper)));
        if set == PixelSet::All {
            let missing = |of: &Settings| format!("counts as {} m", of.missing_m);
            fact("no answer", missing(settings), of_paper(missing(&paper)));
        }
        let crop = |of: &Settings| format!("{:?}", of.crop).to_lowercase();
        fact("crop", crop(settings), of_paper(crop(&paper)));
        let align = |of: &Settings| match of.align {
            Align::None => "none".to_owned(),
            align => format!("{}, frame by frame over the scored pixels with an answer", align.name()),
        };
        fact("alignment", align(settings), of_paper(align(&paper)));
    }
    let means = |mean| match mean {
        Mean::Frames => "of the frames' scores, each weighing the same".to_owned(),
        Mean::Pixels => "over the pixels of all frames".to_owned(),
    };
    fact("mean", means(mean), of_paper(means(Mean::Frames)));
    fact("frames", frames_text(frames, of_frames), None);
    let (valid, truth) = (
        scores.iter().map(|score| score.row.valid).sum::<u64>(),
        scores.iter().map(|score| score.row.truth).sum::<u64>(),
    );
    if truth > 0 {
        let share = 100.0 * valid as f64 / truth as f64;
        let pooled = format!("{valid} of {truth} pixels with ground truth ({share:.2} %)");
        // The table's density is a mean over frames, which is not the share of all pixels where frames have more or
        // fewer of them.
        let of_frames =
            average(scores.iter().filter(|of| of.row.truth > 0).map(|of| of.row.valid as f64 / of.row.truth as f64));
        let of_frames =
            of_frames.map(|mean| format!("{:.2} %", 100.0 * mean)).filter(|mean| *mean != format!("{share:.2} %"));
        let of_frames = of_frames
            .filter(|_| mean == Mean::Frames)
            .map(|mean| format!("; the mean of the frames' shares, the density in tables, is {mean}"));
        fact("valid", format!("{pooled}{}", of_frames.unwrap_or_default()), None);
    }
    for part in &run.source.parts {
        let text = format!("{}: {} version {} {}", run.source.name, part.kind, part.version, part.params);
        fact("source", text, None);
    }
    if let Some(key) = frames.first().and_then(|frame| frame.source_key.as_ref()) {
        fact("key", format!("{key}, of the source's values on frame {}", frames[0].frame), None);
    }
    let topic = |what: &str, of: Option<&String>, recorded: Option<&String>| match (of, recorded) {
        (_, Some(topic)) => format!("{what} {topic}"),
        (Some(topic), None) => format!("{what} {topic}, not recorded"),
        (None, None) => format!("{what} was not recorded"),
    };
    fact("scores", topic("topic", None, estimate.score_topic.as_ref()), None);
    let lead = &estimate.lead;
    let variant = lead.variant.as_deref().unwrap_or("empty");
    let place = format!("`stage` {}, `variant` {variant}, `estimate` {}, `set` {set}", lead.stage, estimate.name);
    fact("files", format!("scores.csv (by frame) and table.csv, where {place}"), None);
    let output = topic("topic", estimate.estimate.as_ref(), estimate.estimate_topic.as_ref());
    fact("estimate", format!("{output}{}", made_by(run, estimate.estimate.as_deref())), None);
    let truth = topic("topic", estimate.truth.as_ref(), estimate.truth_topic.as_ref());
    fact("truth", format!("{truth}{}", made_by(run, estimate.truth.as_deref())), None);
    facts
}

/// What node gives a topic, and its recipe.
fn made_by(run: &RecordedRun, topic: Option<&str>) -> String {
    let gives = |node: &&depthloom_recording::RecordedNode| {
        node.outputs.iter().any(|output| Some(output.topic.as_str()) == topic)
    };
    run.nodes.iter().find(gives).map_or_else(String::new, |node| {
        format!(", from {}.{} ({} version {}, recipe {})", run.stage, node.name, node.kind, node.version, node.recipe)
    })
}

fn frames_text(frames: &[ScoredFrame], of: usize) -> String {
    const NAMED: usize = 6;
    let counted: Vec<&ScoredFrame> = frames.iter().filter(|frame| frame.pixels > 0).collect();
    let pixels: u64 = counted.iter().map(|frame| frame.pixels).sum();
    let names: Vec<&str> = counted.iter().map(|frame| frame.frame.as_str()).collect();
    let names = match names.as_slice() {
        [] => "none".to_owned(),
        [names @ .., last] if names.len() >= NAMED => format!("{}, ... {last}", names[..NAMED - 1].join(", ")),
        names => names.join(", "),
    };
    format!("{} of {of} ({names}); {pixels} pixels", counted.len())
}

impl Explain {
    /// As text.
    #[must_use]
    pub fn text(&self) -> String {
        let decimals = self.metric.decimals + 2;
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.decimals$}"));
        let unit = if self.metric.unit.is_empty() { String::new() } else { format!(" {}", self.metric.unit) };
        let better = if self.metric.more_is_better { "more" } else { "less" };
        let mut text =
            format!("{} of {}: {}{unit} ({better} is better)\n\n", self.metric.name, self.label, number(self.value));
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
            text.push_str("\nframes that made it worse most\n");
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
