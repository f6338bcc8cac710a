//! The left-right check, as `cv::validateDisparity` makes it from the left image's disparities and their costs.

use super::search::Search;

/// The disparities of the right image: for each of its pixels that of the cheapest left pixel that chose it.
#[derive(Clone, Debug, Default)]
pub(super) struct RightView {
    disparity: Vec<i16>,
    cost: Vec<i32>,
}

impl RightView {
    /// Invalidates disparities of a row that differ by more than `max_diff` (1/16 px) from that of their partner.
    /// `cost` is read at valid pixels.
    pub(super) fn check(&mut self, search: &Search, max_diff: i32, disparity: &mut [i16], cost: &[i32]) {
        let (width, invalid) = (search.width, search.invalid);
        self.disparity.clear();
        self.disparity.resize(width, invalid);
        self.cost.clear();
        self.cost.resize(width, i32::MAX);
        // One column later than the search begins: OpenCV counts the disparities here once more.
        let begin = (search.min_disparity + search.disparities as i32).max(0) as usize;
        let end = width - (-search.min_disparity).max(0) as usize;
        let partner = |x: usize, whole: i32| usize::try_from(x as i32 - whole).ok().filter(|&x| x < width);
        for (x, (&fixed, &cost)) in disparity.iter().zip(cost).enumerate().take(end).skip(begin) {
            if fixed != invalid
                && let Some(x2) = partner(x, (i32::from(fixed) + 8) >> 4)
                && cost < self.cost[x2]
            {
                self.cost[x2] = cost;
                self.disparity[x2] = fixed;
            }
        }
        for (x, disparity) in disparity.iter_mut().enumerate().take(end).skip(begin) {
            let fixed = i32::from(*disparity);
            // Rounded down and up: agreeing with either is enough, as is an invalid partner.
            let disagrees = |whole: i32| {
                partner(x, whole).is_some_and(|x2| {
                    let other = self.disparity[x2];
                    other > invalid && (i32::from(other) - fixed).abs() > max_diff
                })
            };
            if *disparity != invalid && disagrees(fixed >> 4) && disagrees((fixed + 15) >> 4) {
                *disparity = invalid;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::RightView;
    use crate::stereo::bm::Params;
    use crate::stereo::bm::search::Search;

    #[test]
    fn of_two_pixels_with_one_partner_the_cheaper_stays() {
        let search = Search::new(&Params { disparities: 16, block: 5, ..Params::default() }, 60, 50).unwrap();
        let mut disparity = vec![-16; 60];
        let mut cost = vec![0; 60];
        (disparity[30], cost[30]) = (5 * 16, 100);
        (disparity[34], cost[34]) = (9 * 16, 90);
        (disparity[40], cost[40]) = (2 * 16 + 8, 1);
        RightView::default().check(&search, 16, &mut disparity, &cost);
        assert_eq!((disparity[30], disparity[34], disparity[40]), (-16, 9 * 16, 2 * 16 + 8));
    }
}
