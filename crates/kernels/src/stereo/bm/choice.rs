//! From the block's sums to a disparity: the smallest, its uniqueness, and the fraction.

use super::search::Search;
use super::sums::Sum;

#[inline(always)]
pub(super) fn first_of<S: Sum>(block: &[S], smallest: S) -> usize {
    let mut first = u16::MAX;
    for (index, &sum) in (0..).zip(block) {
        first = first.min(if sum == smallest { index } else { u16::MAX });
    }
    usize::from(first)
}

/// Whether a candidate that is not next to the best one comes within the margin.
#[inline(always)]
pub(super) fn is_rivalled<S: Sum>(search: &Search, block: &[S], best: usize) -> bool {
    if search.uniqueness == 0 {
        return false;
    }
    let smallest = block[best].wide();
    // In OpenCV's 32 bits, which large ratios overflow.
    let limit = smallest.wrapping_add(smallest.wrapping_mul(search.uniqueness) / 100);
    let Some(limit) = S::at_most(limit) else { return false };
    let mut near = 0_u16;
    for &sum in block {
        near += u16::from(sum <= limit);
    }
    let neighbours = &block[best.saturating_sub(1)..block.len().min(best + 2)];
    usize::from(near) > neighbours.iter().filter(|&&sum| sum <= limit).count()
}

/// The disparity of the best candidate in 1/16 px: whole at the ends of the range, else moved towards the cheaper
/// neighbour by their difference over twice the larger one's height above the best.
#[inline(always)]
pub(super) fn refined<S: Sum>(search: &Search, block: &[S], best: usize) -> i16 {
    let mut fixed = search.disparity(best) * 256;
    if best > 0 && best + 1 < block.len() {
        let [before, here, after] = [best - 1, best, best + 1].map(|index| block[index].wide());
        let height = before + after - 2 * here + (after - before).abs();
        if height != 0 {
            fixed += (after - before) * 256 / height;
        }
    }
    ((fixed + 15) >> 4) as i16
}

#[cfg(test)]
mod tests {
    use super::{first_of, is_rivalled, refined};
    use crate::stereo::bm::Params;
    use crate::stereo::bm::search::Search;

    fn search(uniqueness: i32) -> Search {
        Search::new(&Params { disparities: 32, uniqueness, block: 5, ..Params::default() }, 100, 50).unwrap()
    }

    #[test]
    fn ties_go_to_the_larger_disparity() {
        let mut block = [9_u16; 32];
        for index in [20, 5, 17] {
            block[index] = 4;
        }
        assert_eq!(first_of(&block, 4), 5);
        assert_eq!(refined(&search(0), &block, 5), (31 - 5) * 16);
    }

    #[test]
    fn rivals_next_to_the_best_do_not_count() {
        let mut block = [200_u32; 32];
        block[8] = 100;
        block[9] = 101;
        assert!(!is_rivalled(&search(15), &block, 8));
        block[20] = 115;
        assert!(is_rivalled(&search(15), &block, 8));
        assert!(!is_rivalled(&search(14), &block, 8));
        assert!(!is_rivalled(&search(0), &block, 8));
    }

    #[test]
    fn the_fraction_leans_to_the_cheaper_neighbour() {
        let mut block = [200_u16; 32];
        (block[9], block[10], block[11]) = (50, 10, 50);
        assert_eq!(refined(&search(0), &block, 10), 21 * 16);
        block[11] = 30;
        // candidates fall in disparity: towards index 11 is downwards, by (30 - 50) / (2 * 40) px
        assert_eq!(refined(&search(0), &block, 10), 21 * 16 - 4);
    }
}
