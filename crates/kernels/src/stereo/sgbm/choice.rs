//! From summed costs to a disparity: the best candidate, its uniqueness, the parabola through its neighbours, and the
//! left-right check.

use super::Mode;
use super::search::Search;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Choice {
    /// Its index, or -1 where all costs are saturated (except in `3way`).
    pub index: i32,
    pub cost: i16,
}

impl Choice {
    /// The first candidate of smallest cost; -1 if no cost is below 32767.
    pub(super) fn first_smallest(sum: &[i16]) -> Self {
        let mut choice = Self { index: -1, cost: i16::MAX };
        for (index, &cost) in sum.iter().enumerate() {
            if cost < choice.cost {
                choice = Self { index: index as i32, cost };
            }
        }
        choice
    }

    /// As OpenCV's `3way` breaks ties: of equal costs the *last* in each of the eight residue classes, then the first
    /// of these.
    pub(super) fn three_way(sum: &[i16]) -> Self {
        let cost = sum.iter().copied().min().unwrap_or(i16::MAX);
        let last_of = |lane: usize| (lane..sum.len()).step_by(8).rev().find(|&d| sum[d] == cost);
        let index = (0..8).filter_map(last_of).min().unwrap_or(0);
        Self { index: index as i32, cost }
    }

    /// The best candidate, as this mode breaks ties.
    pub(super) fn best(search: &Search, sum: &[i16]) -> Self {
        match search.mode {
            Mode::ThreeWay => Self::three_way(sum),
            Mode::Sgbm | Mode::Hh | Mode::Hh4 => Self::first_smallest(sum),
        }
    }

    /// Whether a candidate that is not next to this one comes within the uniqueness margin.
    pub(super) fn is_rivalled(&self, search: &Search, sum: &[i16]) -> bool {
        let far = |d: usize| (d as i32 - self.index).abs() > 1;
        if search.mode == Mode::ThreeWay {
            let limit = self.three_way_limit(search);
            return search.uniqueness > 0 && (0..sum.len()).any(|d| sum[d] < limit && far(d));
        }
        let margin = 100 - search.uniqueness;
        (0..sum.len()).any(|d| i32::from(sum[d]) * margin < i32::from(self.cost) * 100 && far(d))
    }

    /// The cost below which a candidate is a rival, `None` if every cost is; the cost must not be negative.
    pub(super) fn rival_limit(&self, search: &Search) -> Option<i16> {
        if search.mode == Mode::ThreeWay {
            return Some(self.three_way_limit(search));
        }
        let margin = 100 - search.uniqueness;
        i16::try_from((i32::from(self.cost) * 100 + margin - 1) / margin).ok()
    }

    /// As OpenCV computes it: the threshold may wrap in its 16 bits.
    fn three_way_limit(&self, search: &Search) -> i16 {
        (100 * i32::from(self.cost) / (100 - search.uniqueness) + 1) as i16
    }
}

/// Decides one row: the running state of the left-right check.
#[derive(Clone, Debug, Default)]
pub(super) struct RowChoice {
    right_disparity: Vec<i16>,
    right_cost: Vec<i16>,
}

impl RowChoice {
    pub(super) fn new(search: &Search) -> Self {
        Self { right_disparity: vec![0; search.width], right_cost: vec![0; search.width] }
    }

    pub(super) fn start(&mut self, search: &Search, row: &mut [i16]) {
        self.right_disparity.fill(search.invalid);
        self.right_cost.fill(i16::MAX);
        row.fill(search.invalid);
    }

    /// Decides searched column `x`; OpenCV goes from right to left.
    pub(super) fn decide(&mut self, search: &Search, x: usize, best: &Choice, sum: &[i16], row: &mut [i16]) {
        if !best.is_rivalled(search, sum) {
            self.write(search, x, best, sum, row);
        }
    }

    /// Writes the disparity of searched column `x`, whose best candidate was found unique.
    fn write(&mut self, search: &Search, x: usize, best: &Choice, sum: &[i16], row: &mut [i16]) {
        let column = x + search.first_column;
        let partner = column as i32 - best.index - search.min_disparity;
        if let Some(cost) = usize::try_from(partner).ok().and_then(|p| self.right_cost.get_mut(p))
            && *cost > best.cost
        {
            *cost = best.cost;
            self.right_disparity[partner as usize] = (best.index + search.min_disparity) as i16;
        }
        row[column] = (refined(best.index, sum) + search.min_disparity * 16) as i16;
    }

    /// The left-right check, made against the winners seen from the right image; a finished row.
    pub(super) fn check(&self, search: &Search, row: &mut [i16]) {
        let invalid = search.invalid;
        // A partner that no pixel chose holds the invalid mark, which is in 1/16 px but compared as pixels: with a
        // minimum disparity of 2 and more it passes for a disparity. OpenCV does that; so do we.
        let disagrees = |x: usize, d: i32| {
            let partner = x as i32 - d;
            usize::try_from(partner).ok().and_then(|p| self.right_disparity.get(p)).is_some_and(|&other| {
                i32::from(other) >= search.min_disparity && (i32::from(other) - d).abs() > search.disp12_max_diff
            })
        };
        for (x, disparity) in row.iter_mut().enumerate().skip(search.first_column).take(search.columns) {
            let fixed = i32::from(*disparity);
            if *disparity != invalid && disagrees(x, fixed >> 4) && disagrees(x, (fixed + 15) >> 4) {
                *disparity = invalid;
            }
        }
    }
}

/// The disparity index in 1/16 px: the minimum of the parabola through the candidate and its neighbours.
fn refined(index: i32, sum: &[i16]) -> i32 {
    if index <= 0 || index as usize + 1 >= sum.len() {
        return index * 16;
    }
    let at = |d: i32| sum[d as usize];
    index * 16 + parabola(at(index - 1), at(index), at(index + 1))
}

/// The minimum of the parabola through three costs, 1/16 px from the middle one.
pub(super) fn parabola(before: i16, here: i16, after: i16) -> i32 {
    let [before, here, after] = [before, here, after].map(i32::from);
    let curvature = (before + after - 2 * here).max(1);
    ((before - after) * 16 + curvature) / (curvature * 2)
}

#[cfg(test)]
mod tests {
    use super::{Choice, refined};

    #[test]
    fn ties_go_to_the_first_candidate_except_in_three_way() {
        let mut sum = [9; 32];
        for d in [3, 11, 20] {
            sum[d] = 4;
        }
        assert_eq!(Choice::first_smallest(&sum), Choice { index: 3, cost: 4 });
        // lane 3 keeps its last (11), lane 4 has 20
        assert_eq!(Choice::three_way(&sum), Choice { index: 11, cost: 4 });
    }

    #[test]
    fn saturated_costs_have_no_first_candidate() {
        assert_eq!(Choice::first_smallest(&[i16::MAX; 16]).index, -1);
        assert_eq!(Choice::three_way(&[i16::MAX; 16]).index, 8);
    }

    #[test]
    fn parabola_leans_to_the_cheaper_neighbour() {
        assert_eq!(refined(1, &[10, 0, 10]), 16);
        assert_eq!(refined(1, &[20, 0, 10]), 16 + 3);
        assert_eq!(refined(0, &[0, 5, 10]), 0);
        assert_eq!(refined(2, &[9, 5, 0]), 32);
    }
}
