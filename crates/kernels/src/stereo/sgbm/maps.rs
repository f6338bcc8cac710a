//! The maps of one call.

use super::choice::{Choice, parabola};
use super::search::Search;

/// What one call writes: disparities, and further maps where the caller has room for them. Each holds one value per
/// pixel.
#[derive(Debug)]
pub struct Maps<'a> {
    /// Disparity of the left image's pixels, 1/16 px; [`Params::invalid`](super::Params::invalid) where invalid.
    pub disparity: &'a mut [i16],
    /// Disparity of the right image's pixels, 1/16 px, negative, from the same costs: a right pixel takes the cheapest
    /// of the left pixels that it could be, the one of smallest disparity among equals, refined by the parabola through
    /// the costs of its neighbours. As of `cv::ximgproc::createRightMatcher`, its pixels are checked neither for
    /// uniqueness nor left against right, and it has no speckle filter; the 3x3 median is the last step.
    /// [`Params::right_invalid`](super::Params::right_invalid) where no left pixel that was searched could be it.
    pub right: Option<&'a mut [i16]>,
    /// Matching-cost ambiguity of the left image's pixels, 0 to 1: the smallest cost over the smallest cost of the
    /// candidates that differ from the best by more than 1 px; 1 where both are 0, and where the disparity is invalid.
    /// A pixel passes the uniqueness check at a margin of `r` per cent where the ambiguity is at most `1 - r / 100`
    /// (less than that in `3way`).
    pub ambiguity: Option<&'a mut [f32]>,
}

impl Maps<'_> {
    /// Fills all with invalid values.
    pub(super) fn clear(&mut self, search: &Search) {
        self.disparity.fill(search.invalid);
        if let Some(right) = self.right.as_deref_mut() {
            right.fill(search.right_invalid);
        }
        if let Some(ambiguity) = self.ambiguity.as_deref_mut() {
            ambiguity.fill(1.0);
        }
    }

    /// The plain implementation of row `y` of the right image and of the ambiguity, from the row's complete sums.
    pub(super) fn see(&mut self, search: &Search, y: usize, sums: &[i16]) {
        let row = y * search.width..(y + 1) * search.width;
        if let Some(right) = self.right.as_deref_mut() {
            right_row(search, sums, &mut right[row.clone()]);
        }
        if let Some(ambiguity) = self.ambiguity.as_deref_mut() {
            let searched = &mut ambiguity[row][search.first_column..][..search.columns];
            for (ambiguity, sums) in searched.iter_mut().zip(sums.chunks_exact(search.disparities)) {
                let best = Choice::best(search, sums);
                let far = sums.iter().zip(0..).filter(|&(_, d): &(_, i32)| (d - best.index).abs() > 1);
                *ambiguity = ratio(best.cost, far.map(|(&cost, _)| cost).min().unwrap_or(i16::MAX));
            }
        }
    }

    /// The ambiguity of invalid pixels.
    pub(super) fn finish(&mut self, invalid: i16) {
        if let Some(ambiguity) = self.ambiguity.as_deref_mut() {
            for (ambiguity, &disparity) in ambiguity.iter_mut().zip(&*self.disparity) {
                *ambiguity = if disparity == invalid { 1.0 } else { *ambiguity };
            }
        }
    }
}

/// The ambiguity of two costs. Saturated sums may be negative: they count as 0.
#[inline(always)]
pub(super) fn ratio(best: i16, second: i16) -> f32 {
    let best = best.max(0);
    if second > best { f32::from(best) / f32::from(second) } else { 1.0 }
}

fn right_row(search: &Search, sums: &[i16], out: &mut [i16]) {
    let Search { min_disparity, disparities, first_column, columns, .. } = *search;
    for (column, out) in out.iter_mut().enumerate() {
        // Of candidate `index` if there is one and its left pixel was searched.
        let cost = |index: i32| {
            let x = column as i32 + min_disparity + index - first_column as i32;
            let exists = (0..disparities as i32).contains(&index) && (0..columns as i32).contains(&x);
            exists.then(|| sums[x as usize * disparities + index as usize])
        };
        let mut best = Choice { index: -1, cost: i16::MAX };
        for index in 0..disparities as i32 {
            if let Some(cost) = cost(index).filter(|&cost| cost < best.cost) {
                best = Choice { index, cost };
            }
        }
        *out = search.right_invalid;
        if best.index >= 0 {
            let step = match (cost(best.index - 1), cost(best.index + 1)) {
                (Some(before), Some(after)) => parabola(before, best.cost, after),
                _ => 0,
            };
            *out = -((best.index + min_disparity) * 16 + step) as i16;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{ProptestConfig, any, proptest};
    use proptest::{collection, prop_assert_eq};

    use super::{Maps, ratio};
    use crate::stereo::sgbm::choice::Choice;
    use crate::stereo::sgbm::search::Search;
    use crate::stereo::sgbm::{Mode, Params};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]
        #[test]
        fn ambiguity_decides_uniqueness(
            sums in collection::vec(0..60_i16, 16),
            scale in 1..100_i16,
            uniqueness in 1..60,
            is_three_way in any::<bool>(),
        ) {
            let mode = if is_three_way { Mode::ThreeWay } else { Mode::Sgbm };
            let params = Params { disparities: 16, uniqueness, mode, ..Params::default() };
            let search = Search::new(&params, 17, 1, 1);
            let sums: Vec<i16> = sums.into_iter().map(|cost| cost * scale).collect();
            let (mut disparity, mut ambiguity) = ([0; 17], [0.0; 17]);
            let mut maps = Maps { disparity: &mut disparity, right: None, ambiguity: Some(&mut ambiguity) };
            maps.see(&search, 0, &sums);
            let limit = (100 - uniqueness) as f32 / 100.0;
            let is_unique = if is_three_way { ambiguity[16] < limit } else { ambiguity[16] <= limit };
            let best = Choice::best(&search, &sums);
            // OpenCV finds a cost of 0 unique whatever the others cost, except in `3way`.
            let expected = !best.is_rivalled(&search, &sums);
            prop_assert_eq!(is_unique, expected && (best.cost > 0 || is_three_way || ambiguity[16] == 0.0));
        }
    }

    #[test]
    fn equal_costs_are_ambiguous() {
        assert_eq!([ratio(0, 0), ratio(7, 7), ratio(0, 3), ratio(-9, -2), ratio(30, 40)], [1.0, 1.0, 0.0, 1.0, 0.75]);
    }

    /// 16 disparities; columns 16, 17 and 18 are searched.
    #[test]
    fn a_right_pixel_takes_the_cheapest_left_pixel_of_its_diagonal() {
        let search = Search::new(&Params { disparities: 16, ..Params::default() }, 19, 1, 1);
        let mut sums = vec![90; 3 * 16];
        // Right pixel 12 is left pixel 17 at disparity 5; its neighbours on the diagonal are (16, 4) and (18, 6).
        sums[16 + 5] = 10;
        sums[4] = 20;
        sums[2 * 16 + 6] = 30;
        let (mut disparity, mut right, mut ambiguity) = ([0; 19], [0; 19], [0.0; 19]);
        let mut maps = Maps { disparity: &mut disparity, right: Some(&mut right), ambiguity: Some(&mut ambiguity) };
        maps.clear(&search);
        maps.see(&search, 0, &sums);
        // The parabola through 20, 10, 30 has its minimum at -1/6.
        assert_eq!(right[12], -(5 * 16 - 2));
        // The cheapest of equal candidates is that of the smallest disparity; pixel 0 would need column 15.
        assert_eq!((right[0], right[1], right[2], right[17], right[18]), (-256, -240, -224, 0, 0));
        assert_eq!(ambiguity[15..], [1.0, 20.0 / 90.0, 10.0 / 90.0, 30.0 / 90.0]);
    }
}
