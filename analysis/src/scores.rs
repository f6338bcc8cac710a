//! Recorded scores per frame, as a table.

use std::collections::{HashMap, HashSet};
use std::ops::RangeInclusive;
use std::sync::Arc;

use depthloom_graphs::counted;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::Recording;
use depthloom_scores::{Mean, Metric, ScoreRow};

use crate::ablation::FrameSet;
use crate::error::listed;
use crate::estimates::{Estimate, estimate_columns};
use crate::tables::{DIMENSIONLESS, Rows, Table};

/// The scores of one estimate on one frame and one pixel set.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameScore {
    /// The id of the frame. Concatenated sources may repeat an id, and a frame may be requested twice.
    pub frame: Arc<str>,
    /// The position of the frame in its stage run, which identifies it.
    pub position: FrameIndex,
    /// Index of the estimate.
    pub estimate: usize,
    /// Its scores.
    pub row: ScoreRow,
}

/// The rows of one frame in the order of `scores.csv`: pixel set by pixel set, in each estimate by estimate.
pub(crate) fn order_frame(rows: &mut [FrameScore]) {
    // Within an estimate the zones stay as they were recorded, the whole image first.
    rows.sort_by_key(|score| (score.row.set, score.estimate));
}

/// Describes the number of frames of rows, and their averaging. `is_all(mean)` states whether all rows are averaged in
/// this way.
pub(crate) fn averaged(frames: RangeInclusive<u64>, is_all: impl Fn(Mean) -> bool) -> String {
    let (least, most) = frames.into_inner();
    let frames = match least == most {
        true => counted(most, "frame"),
        false => format!("{least} to {}", counted(most, "frame")),
    };
    match (is_all(Mean::Frames), is_all(Mean::Pixels)) {
        (true, _) => format!("mean over {frames}"),
        (_, true) => format!("over all pixels of {frames}"),
        _ => format!("over {frames}, some averaged over frames, others over pixels"),
    }
}

/// The metrics of all estimates, in the order of the catalogue: the columns of tables.
pub(crate) fn metrics_of<'e>(estimates: impl IntoIterator<Item = &'e Estimate>) -> Vec<&'static Metric> {
    let mut metrics: Vec<&'static Metric> = Vec::new();
    for metric in estimates.into_iter().flat_map(|estimate| &estimate.metrics) {
        if !metrics.contains(metric) {
            metrics.push(metric);
        }
    }
    metrics.sort_by_key(|metric| metric.place());
    metrics
}

/// The table of `scores.csv`: key columns, `zone` (null: the whole image), `position`, `frame`, `pixels`, the metrics,
/// `density`. A metric without pixels is null. No two rows have the same stage, variant, estimate, set, zone and
/// position.
pub(crate) fn table_of_scores(scores: &[FrameScore], estimates: &[Estimate]) -> Table {
    let rows = Rows(scores);
    let zone = rows.text("zone", |score| Some(&score.row.zone).filter(|zone| !zone.is_empty()));
    let mut columns = estimate_columns(scores, |score| (&estimates[score.estimate], score.row.set.name()), Some(zone));
    columns.extend([
        rows.count("position", |score| score.position.0 as u64),
        rows.text("frame", |score| &*score.frame),
        rows.count("pixels", |score| score.row.pixels).unit("pixels"),
    ]);
    columns.extend(metrics_of(estimates).into_iter().map(|metric| rows.metric(metric, |score| score.row.get(metric))));
    columns.push(rows.share("density", |score| score.row.density()).unit(DIMENSIONLESS));
    Table::new(columns)
}

/// The scores, including those of zones, of the frames that have rows of all estimates of their stage run. An estimate
/// without any score does not count: otherwise no frame would be complete.
pub(crate) fn scores_of_complete_frames<'a>(scores: &'a [FrameScore], estimates: &[Estimate]) -> Vec<&'a FrameScore> {
    let place = |score: &FrameScore| (estimates[score.estimate].run, score.position);
    let mut rows_of_frame: HashMap<(RunId, FrameIndex), usize> = HashMap::new();
    for score in scores.iter().filter(|score| score.row.zone.is_empty()) {
        *rows_of_frame.entry(place(score)).or_default() += 1;
    }
    let mut rows_of_run: HashMap<RunId, usize> = HashMap::new();
    let scored: HashSet<usize> = scores.iter().map(|score| score.estimate).collect();
    for (_, estimate) in estimates.iter().enumerate().filter(|(index, _)| scored.contains(index)) {
        *rows_of_run.entry(estimate.run).or_default() += estimate.sets.len();
    }
    let is_complete = |score: &&FrameScore| rows_of_frame.get(&place(score)) == rows_of_run.get(&place(score).0);
    scores.iter().filter(is_complete).collect()
}

/// Notes on the selected frames (`None`: all) that are excluded from means without a failure, because an estimate is
/// missing.
pub(crate) fn incomplete_frames(
    recording: &Recording,
    estimates: &[Estimate],
    scores: &[FrameScore],
    selected: Option<&FrameSet>,
) -> Vec<String> {
    let mut scored: HashMap<(RunId, FrameIndex), HashSet<usize>> = HashMap::new();
    for score in scores {
        scored.entry((estimates[score.estimate].run, score.position)).or_default().insert(score.estimate);
    }
    let has_score: HashSet<usize> = scores.iter().map(|score| score.estimate).collect();
    let mut notes = Vec::new();
    for (run, planned) in RunId::enumerate(&recording.plan().runs) {
        let of_run = (0..estimates.len()).filter(|place| estimates[*place].run == run);
        let (own, without): (Vec<usize>, Vec<usize>) = of_run.partition(|place| has_score.contains(place));
        if !own.is_empty() {
            notes.extend(without.into_iter().map(|place| without_a_score(recording, &estimates[place])));
        }
        let (mut all, mut frames, mut unscored, mut labels) = (0, 0, 0, Vec::new());
        for (position, frame) in FrameIndex::enumerate(recording.frames(run)) {
            if selected.is_some_and(|selected| !selected.contains(&(run, position))) {
                continue;
            }
            all += 1;
            if !frame.failures.is_empty() {
                continue;
            }
            let Some(there) = scored.get(&(run, position)) else {
                unscored += 1;
                continue;
            };
            let missing: Vec<&str> = own
                .iter()
                .filter(|place| !there.contains(place))
                .map(|place| estimates[*place].label.as_str())
                .collect();
            frames += usize::from(!missing.is_empty());
            for label in missing {
                if !labels.contains(&label) {
                    labels.push(label);
                }
            }
        }
        if !own.is_empty() && 0 < unscored && unscored < all {
            notes.push(format!(
                "stage `{}`: means exclude {unscored} of {all} frames, which have no ground truth or no value of any estimate",
                planned.name()
            ));
        }
        if frames > 0 {
            notes.push(format!(
                "stage `{}`: means exclude {frames} of {all} frames, which have no value of {}",
                planned.name(),
                listed(labels)
            ));
        }
    }
    notes
}

/// A note on an estimate without any score, although others of its stage run have some.
fn without_a_score(recording: &Recording, estimate: &Estimate) -> String {
    const INSPECTED: usize = 16;
    let label = &estimate.label;
    let truth = estimate.truth_topic.as_deref().filter(|topic| {
        let Ok(mut reader) = recording.reader(estimate.run, &[*topic]) else { return false };
        let positions = FrameIndex::all(recording.frames(estimate.run).len()).take(INSPECTED);
        let values: Result<Vec<_>, _> = positions.map(|position| reader.read(position)).collect();
        values.is_ok_and(|values| values.iter().flatten().all(Option::is_none))
    });
    match truth {
        Some(topic) => format!(
            "`{label}` is excluded: no frame has its ground truth `{}`; enable it in the parameters of the source",
            topic.trim_start_matches('/')
        ),
        None => format!("`{label}` is excluded: it has no score on any frame"),
    }
}
