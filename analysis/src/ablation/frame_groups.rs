//! Groups of a recording's frames that are resampled together.

use std::collections::{BTreeSet, HashMap};

use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::Recording;

use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::scores::FrameScore;
use crate::statistics::Grouping;

/// The groups of frames that are resampled together.
pub(crate) struct FrameGroups {
    /// `sequences`, for descriptions.
    pub(super) unit: String,
    /// The group of each frame.
    pub(super) by_frame: HashMap<(RunId, FrameIndex), usize>,
}

impl FrameGroups {
    /// Groups the scored frames of a recording.
    ///
    /// # Errors
    /// If the file of the grouping cannot be read, or has no group for a frame.
    pub(crate) fn new(
        recording: &Recording,
        estimates: &[Estimate],
        scores: &[FrameScore],
        grouping: &Grouping,
    ) -> Result<Self, AnalysisError> {
        let (groups, mut by_frame) = (grouping.open()?, HashMap::new());
        let scored: BTreeSet<(RunId, FrameIndex)> =
            scores.iter().map(|score| (estimates[score.estimate].run, score.position)).collect();
        for run in RunId::all(recording.plan().runs.len()) {
            let own: Vec<FrameIndex> = scored.iter().filter(|(known, _)| *known == run).map(|(_, own)| *own).collect();
            let named = own.iter().map(|position| {
                let frame = &recording.frames(run)[position.0];
                (&*frame.id, frame.index)
            });
            let found = groups.of_frames(&named.collect::<Vec<_>>())?;
            by_frame.extend(own.into_iter().map(|position| (run, position)).zip(found));
        }
        Ok(Self { unit: grouping.unit(), by_frame })
    }
}
