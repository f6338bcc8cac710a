//! Which scores can be compared with each other.

use depthloom_graphs::Key;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_scores::{Mean, PixelSet, Settings};

use crate::estimates::Estimate;
use crate::scores::FrameScore;

/// The properties that comparable scores share: the same frames (by source and id) with the same number of pixels, the
/// same ground truth, the same scoring and averaging.
#[derive(PartialEq)]
struct Comparability<'a> {
    settings: (&'a Option<Settings>, Mean),
    truth: Option<&'a str>,
    set: PixelSet,
    frames: Vec<(Option<Key>, &'a str, u64)>,
}

/// Classes of scores that can be compared, by number.
#[derive(Default)]
pub(super) struct Classes<'a>(Vec<Comparability<'a>>);

impl<'a> Classes<'a> {
    /// The class of an estimate's scores on one pixel set of one zone. `None` for the set `valid`, which differs
    /// between estimates. `source(run, position)` is the key of the source values of a frame.
    pub(super) fn class(
        &mut self,
        estimate: &'a Estimate,
        (set, mean): (PixelSet, Mean),
        scores: &[&'a FrameScore],
        source: &dyn Fn(RunId, FrameIndex) -> Option<Key>,
    ) -> Option<usize> {
        if set == PixelSet::Valid {
            return None;
        }
        let frame = |score: &&'a FrameScore| (source(estimate.run, score.position), &*score.frame, score.row.pixels);
        let comparability = Comparability {
            settings: (&estimate.settings, mean),
            truth: estimate.truth_output.as_deref(),
            set,
            frames: scores.iter().map(frame).collect(),
        };
        let known = self.0.iter().position(|known| *known == comparability);
        Some(known.unwrap_or_else(|| {
            self.0.push(comparability);
            self.0.len() - 1
        }))
    }
}
