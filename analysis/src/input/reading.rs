//! Reads scores from a recording.

use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::Recording;
use depthloom_scores::ScoreRow;

use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::scores::{FrameScore, order_frame};

/// All scores that were recorded: stage run by stage run, frame by frame, in the order of `scores.csv`.
pub(crate) fn scores(
    recording: &Recording,
    estimates: &[Estimate],
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<FrameScore>, AnalysisError> {
    let mut scores = Vec::new();
    for run in RunId::all(recording.plan().runs.len()) {
        let scored = |(index, estimate): (usize, &Estimate)| {
            (estimate.run == run).then(|| estimate.score_topic.clone().map(|topic| (index, topic))).flatten()
        };
        let (indices, topics): (Vec<usize>, Vec<String>) = estimates.iter().enumerate().filter_map(scored).unzip();
        if indices.is_empty() {
            continue;
        }
        let mut reader = recording.reader(run, &topics)?;
        for (position, frame) in FrameIndex::enumerate(recording.frames(run)) {
            if stop() {
                return Err(AnalysisError::Stopped);
            }
            let first = scores.len();
            for (&estimate, value) in indices.iter().zip(reader.read(position)?) {
                if let Some(Value::Scores(rows)) = value {
                    let score =
                        |row: &ScoreRow| FrameScore { frame: frame.id.clone(), position, estimate, row: row.clone() };
                    scores.extend(rows.iter().map(score));
                }
            }
            order_frame(&mut scores[first..]);
        }
    }
    Ok(scores)
}
