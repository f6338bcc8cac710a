//! The number of maps that a page shows: with it grow CPU time and bytes of the page, up to a limit.
//!
//! The limits of bytes are those of `crates/figures/src/page/pictures.rs`.

use std::collections::BTreeSet;

use depthloom_analysis::{MOST_DETAILED, MOST_LAYERS, MOST_PICTURED, PageRuns};
use depthloom_graphs::ValueType;
use depthloom_recording::{RecordedEstimate, RecordedPlan, RecordedRun};

/// The most bytes of the maps, per frame and in all, and what few frames may have.
const MOST_BYTES: f64 = 38.5e6;
const MOST_FRAME_BYTES: f64 = 400e3;
const MOST_OF_FEW_BYTES: f64 = 6e6;

/// What a page shows of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PageContent {
    frames: u64,
    maps: u64,
}

impl PageContent {
    /// What a page shows of a run with these numbers of frames.
    pub(super) fn of_run(plan: &RecordedPlan, frames: &[u64]) -> Self {
        let with_maps: Vec<(&RecordedRun, u64)> = plan
            .runs
            .iter()
            .zip(frames)
            .filter(|(run, _)| map_topics(run).count() > 0)
            .map(|(run, n)| (run, *n))
            .collect();
        let scored = with_maps.iter().filter(|(run, _)| !run.estimates.is_empty()).count();
        let runs = PageRuns { scored, unscored: with_maps.len() - scored };
        let mut content = Self::default();
        for (run, frames) in with_maps {
            let is_scored = !run.estimates.is_empty();
            let with_maps = usize::try_from(frames.div_ceil(plan.every.max(1))).unwrap_or(usize::MAX);
            let frames = runs.frames_shown(with_maps, is_scored, None) as u64;
            let all = (map_topics(run).count() as u64).min(MOST_LAYERS as u64);
            let (main, detailed) =
                if is_scored { (main_maps(run).min(all), frames.min(MOST_DETAILED as u64)) } else { (all, frames) };
            content.frames += frames;
            content.maps += frames * main + detailed * (all - main);
        }
        content
    }

    /// The number of maps, relative to an earlier page.
    pub(super) fn growth(self, before: Self) -> f64 {
        self.maps as f64 / before.maps.max(1) as f64
    }

    /// The most bytes of the page.
    pub(super) fn most_bytes(self) -> f64 {
        MOST_BYTES.min((MOST_FRAME_BYTES * self.frames as f64).max(MOST_OF_FEW_BYTES))
    }
}

/// The topics of maps that a recording contains.
fn map_topics(run: &RecordedRun) -> impl Iterator<Item = &str> {
    use ValueType::{Depth, Disparity, Image, Mask, TrueDisparity, Weight};
    let is_map = |value_type| matches!(value_type, Image | Disparity | TrueDisparity | Depth | Weight | Mask);
    let outputs = run.source.outputs.iter().chain(run.nodes.iter().flat_map(|node| &node.outputs));
    let maps = outputs.filter(move |output| output.recorded && !output.once && output.value_type().is_some_and(is_map));
    maps.map(|output| output.topic.as_str())
}

/// The maps of every frame: the image, the ground truth, and the estimates.
fn main_maps(run: &RecordedRun) -> u64 {
    let topics = |topic: fn(&RecordedEstimate) -> Option<&String>| {
        run.estimates.iter().filter_map(topic).collect::<BTreeSet<_>>().len()
    };
    let estimates = topics(|estimate| estimate.estimate_topic.as_ref()).min(MOST_PICTURED);
    1 + (topics(|estimate| estimate.truth_topic.as_ref()) + estimates) as u64
}

#[cfg(test)]
mod tests {
    use super::PageContent;

    #[test]
    fn a_page_of_many_frames_has_a_limit() {
        let content = |frames, maps| PageContent { frames, maps };
        assert_eq!(content(4, 40).most_bytes(), 6e6);
        assert_eq!(content(30, 300).most_bytes(), 12e6);
        assert_eq!(content(200, 2000).most_bytes(), 38.5e6);
        assert_eq!(content(200, 2000).growth(content(30, 400)), 5.0);
    }
}
