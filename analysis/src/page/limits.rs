//! How much a page shows, so that it costs little beside a run. With 40 KITTI frames and five variants, 14 frames with
//! pictures took 8 to 10 % of the run's CPU time (an EPYC).

/// The maximum number of estimates with curves.
pub(super) const MOST_CURVES: usize = 24;
/// The maximum number of maps of estimates with pictures.
pub const MOST_PICTURED: usize = 12;
/// The maximum number of maps of a stage run.
pub const MOST_LAYERS: usize = 32;
/// The maximum number of frames of a scored stage run with intermediate maps and further images.
pub const MOST_DETAILED: usize = 6;
/// The maximum number of frames in the figure of scores by frame.
pub(super) const MOST_POINTS: usize = 1000;
/// The number of worst and of best frames of each estimate that have pictures before others.
pub(super) const EXTREMES: usize = 3;

/// The number of frames of a stage run up to which all have pictures.
const FIRST: usize = 12;
/// Of the other frames, one in this number has pictures.
const ONE_OF: usize = 10;
/// The maximum number of frames of all scored stage runs together.
const MOST_FRAMES: usize = 200;
/// The maximum number of frames of all unscored stage runs together, and of each, beside scored ones.
const MOST_UNSCORED: usize = 40;
const FEW: usize = 10;

/// The number of stage runs with recorded maps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageRuns {
    /// Those with a `score:`.
    pub scored: usize,
    /// Those without.
    pub unscored: usize,
}

impl PageRuns {
    /// The number of frames with pictures of a stage run that has `frames` frames with maps. `wanted` is the number
    /// for all stage runs with a `score:` together, or for all stage runs if no stage has a `score:`. `None`: 12 frames
    /// of each stage run, and a tenth of its other frames.
    #[must_use]
    pub fn frames_shown(self, frames: usize, is_scored: bool, wanted: Option<usize>) -> usize {
        let usual = FIRST + frames.saturating_sub(FIRST) / ONE_OF;
        let main = |runs: usize| wanted.map_or_else(|| usual.min(MOST_FRAMES / runs), |wanted| wanted / runs);
        let most = match (is_scored, self.scored) {
            (true, _) => main(self.scored.max(1)),
            (false, 0) => main(self.unscored.max(1)),
            (false, _) => FEW.min(MOST_UNSCORED / self.unscored.max(1)),
        };
        frames.min(most.max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::PageRuns;

    #[test]
    fn frames_with_pictures_grow_slower_than_frames() {
        let shown = |frames| PageRuns { scored: 1, unscored: 2 }.frames_shown(frames, true, None);
        assert_eq!([6, 12, 40, 200, 5000].map(shown), [6, 12, 14, 30, 200]);
        let wanted = |count| PageRuns { scored: 2, unscored: 0 }.frames_shown(40, true, Some(count));
        assert_eq!([1, 30, 200].map(wanted), [1, 15, 40]);
        let unscored = |runs: PageRuns| runs.frames_shown(40, false, Some(30));
        assert_eq!(unscored(PageRuns { scored: 1, unscored: 8 }), 5);
        assert_eq!(unscored(PageRuns { scored: 0, unscored: 2 }), 15);
    }
}
