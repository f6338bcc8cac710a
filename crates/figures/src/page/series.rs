//! What of a stage run is shown: its maps, and on which frames.

use std::collections::BTreeSet;

use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_scores::Settings;

use super::sizes::Class;

/// What a map is on the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// An image.
    Image,
    /// Ground truth.
    Truth,
    /// An estimate that is scored.
    Estimate,
    /// Any other map.
    Other,
}

impl Role {
    /// Its name on the page.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Image => "image",
            Self::Truth => "truth",
            Self::Estimate => "estimate",
            Self::Other => "other",
        }
    }
}

/// A topic whose values the page shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// The topic.
    pub topic: String,
    /// Its name for people: the topic without its stage.
    pub name: String,
    /// What it is.
    pub role: Role,
    /// The name of what it carries.
    pub value_type: String,
    /// Of an estimate: its estimates.
    pub estimates: Vec<usize>,
    /// Of the first of these: the place of the ground truth among the layers.
    pub truth: Option<usize>,
    /// How the first of them is scored, if it is aligned before: it is shown as it is scored.
    pub aligned: Option<Settings>,
}

/// A stage run whose maps the page shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The stage run.
    pub run: RunId,
    /// Its maps.
    pub layers: Vec<Layer>,
    /// How many maps were recorded, of which these are.
    pub recorded: usize,
    /// The positions of its frames.
    pub positions: Vec<FrameIndex>,
    /// Of these, the positions of the frames with intermediate maps and further images.
    pub detailed: BTreeSet<FrameIndex>,
}

impl Series {
    /// Whether the page shows a layer on a frame.
    pub(super) fn shows(&self, place: usize, position: FrameIndex) -> bool {
        class_of(self, place) != Class::Other || self.detailed.contains(&position)
    }
}

/// What the width of a layer depends on: the first image is shown larger than others.
pub(super) fn class_of(series: &Series, place: usize) -> Class {
    let first_image = series.layers.iter().position(|layer| layer.role == Role::Image);
    match series.layers[place].role {
        Role::Image if first_image == Some(place) => Class::Image,
        Role::Image | Role::Other => Class::Other,
        Role::Truth | Role::Estimate => Class::Main,
    }
}

/// Leaves a share of the frames of each series, at least one.
pub(super) fn thin(series: &mut [Series], share: f64) {
    for series in series {
        let most = ((series.positions.len() as f64 * share) as usize).max(1);
        series.positions = evenly(&series.positions, &[], most);
    }
}

/// A selection of at most `most` positions: half of them, rounded up, the wanted ones, the first before others, and the
/// rest at even distances.
#[must_use]
pub fn evenly(positions: &[FrameIndex], wanted: &[FrameIndex], most: usize) -> Vec<FrameIndex> {
    if positions.len() <= most {
        return positions.to_vec();
    }
    let mut chosen = BTreeSet::new();
    for position in wanted.iter().filter(|position| positions.binary_search(position).is_ok()) {
        if chosen.len() < most.div_ceil(2) {
            chosen.insert(*position);
        }
    }
    let others: Vec<FrameIndex> = positions.iter().copied().filter(|position| !chosen.contains(position)).collect();
    let room = most - chosen.len();
    chosen.extend((0..room).map(|i| others[i * (others.len() - 1) / (room - 1).max(1)]));
    chosen.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_frames_the_wanted_are_there_and_the_others_are_even() {
        let positions: Vec<FrameIndex> = FrameIndex::all(1000).collect();
        let chosen = evenly(&positions, &[500, 17, 18, 19, 18].map(FrameIndex), 20);
        assert_eq!(chosen.len(), 20, "{chosen:?}");
        assert!(
            [0, 17, 18, 19, 500, 999].map(FrameIndex).iter().all(|position| chosen.contains(position)),
            "{chosen:?}"
        );
        assert!(chosen.windows(2).all(|two| two[1].0 - two[0].0 <= 80), "{chosen:?}");
        assert_eq!(evenly(&positions[..5], &[], 20), [0, 1, 2, 3, 4].map(FrameIndex));
        assert_eq!(evenly(&positions, &[], 1), [FrameIndex(0)]);
        assert_eq!(evenly(&positions, &[7, 3].map(FrameIndex), 1), [FrameIndex(7)]);
        let some = evenly(&positions, &[900, 3, 400].map(FrameIndex), 4);
        assert!(some.contains(&FrameIndex(900)) && some.contains(&FrameIndex(3)) && !some.contains(&FrameIndex(400)));
    }
}
