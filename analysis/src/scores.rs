//! Scores per frame: the rows the engine recorded, as a table.

use std::collections::{HashMap, HashSet};
use std::ops::RangeInclusive;
use std::sync::Arc;

use depthloom_graphs::counted;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::Recording;
use depthloom_scores::{Mean, Metric, ScoreRow};

use crate::error::listed;
use crate::estimates::{Estimate, estimate_columns};
use crate::tables::{DIMENSIONLESS, Rows, Table};

/// The scores of one estimate on one frame and one pixel set.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameScore {
    /// The frame's id: what people call it. Sources that are joined may repeat one, and a frame may be asked for twice.
    pub frame: Arc<str>,
    /// The frame's place in its stage run: what tells it from all others of the run.
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

/// Over how many frames rows are, and how: `is_all(mean)` says whether each of them is averaged so.
pub(crate) fn averaged(frames: RangeInclusive<u64>, is_all: impl Fn(Mean) -> bool) -> String {
    let (least, most) = frames.into_inner();
    let frames = match least == most {
        true => counted(most, "frame"),
        false => format!("{least} to {}", counted(most, "frame")),
    };
    match (is_all(Mean::Frames), is_all(Mean::Pixels)) {
        (true, _) => format!("mean over {frames}"),
        (_, true) => format!("over the pixels of {frames} together"),
        _ => format!("over {frames}, of some the mean, of others the pixels together"),
    }
}

/// The metrics that any of the estimates has, in the catalogue's order: what tables have columns for.
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

/// The table `scores.csv` holds: what a row is of, with its `zone` (null: the whole image), `position` and `frame`;
/// `pixels`, the scores that were asked for, `density`; a score of no pixel is null. No two rows have the same stage,
/// variant, estimate, set, zone and position, whatever frames are called.
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

/// The scores, of zones too, of the frames that have rows of all estimates of their stage run.
pub(crate) fn of_complete_frames<'a>(scores: &'a [FrameScore], estimates: &[Estimate]) -> Vec<&'a FrameScore> {
    let place = |score: &FrameScore| (estimates[score.estimate].run, score.position);
    let mut rows_of_frame: HashMap<(RunId, FrameIndex), usize> = HashMap::new();
    for score in scores.iter().filter(|score| score.row.zone.is_empty()) {
        *rows_of_frame.entry(place(score)).or_default() += 1;
    }
    let mut rows_of_run: HashMap<RunId, usize> = HashMap::new();
    for estimate in estimates {
        *rows_of_run.entry(estimate.run).or_default() += estimate.sets.len();
    }
    let is_whole = |score: &&FrameScore| rows_of_frame.get(&place(score)) == rows_of_run.get(&place(score).0);
    scores.iter().filter(is_whole).collect()
}

/// What is to be said of frames that not all means are over, although nothing failed on them: an estimate is missing
/// there.
pub(crate) fn incomplete_frames(recording: &Recording, estimates: &[Estimate], scores: &[FrameScore]) -> Vec<String> {
    let mut scored: HashMap<(RunId, FrameIndex), HashSet<usize>> = HashMap::new();
    for score in scores {
        scored.entry((estimates[score.estimate].run, score.position)).or_default().insert(score.estimate);
    }
    let mut notes = Vec::new();
    for (run, planned) in RunId::enumerate(&recording.plan().runs) {
        let own: Vec<usize> = (0..estimates.len()).filter(|place| estimates[*place].run == run).collect();
        let (mut frames, mut unscored, mut labels) = (0, 0, Vec::new());
        for (position, frame) in FrameIndex::enumerate(recording.frames(run)) {
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
        let all = recording.frames(run).len();
        if !own.is_empty() && 0 < unscored && unscored < all {
            notes.push(format!(
                "stage `{}`: means leave out {unscored} of {all} frames, which have no truth or no value of any estimate",
                planned.name()
            ));
        }
        if frames > 0 {
            notes.push(format!(
                "stage `{}`: means leave out {frames} of {all} frames, on which there is no value of {}",
                planned.name(),
                listed(labels)
            ));
        }
    }
    notes
}
