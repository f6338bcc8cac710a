//! Which messages of two topics belong together, by their times.

use std::ops::Range;

/// The pairs of two ascending lists of times whose distance is at most the tolerance, each time once, in time
/// order.
///
/// Two times are a pair if neither has a nearer partner. What is left over between pairs is paired among itself, again
/// and again until nothing is left within the tolerance.
#[must_use]
pub fn pairs(left: &[u64], right: &[u64], tolerance_ns: u64) -> Vec<(usize, usize)> {
    let mut found = Vec::with_capacity(left.len().min(right.len()));
    let mut gaps = vec![(0..left.len(), 0..right.len())];
    while let Some((lefts, rights)) = gaps.pop() {
        let nearest = nearest_pairs(left, right, (lefts.clone(), rights.clone()), tolerance_ns);
        if nearest.is_empty() {
            continue;
        }
        let (mut l, mut r) = (lefts.start, rights.start);
        for &(to_l, to_r) in nearest.iter().chain([&(lefts.end, rights.end)]) {
            if l < to_l && r < to_r {
                gaps.push((l..to_l, r..to_r));
            }
            (l, r) = (to_l + 1, to_r + 1);
        }
        found.extend(nearest);
    }
    found.sort_unstable();
    found
}

/// The pairs in these ranges of which neither has a nearer partner.
fn nearest_pairs(
    left: &[u64],
    right: &[u64],
    (lefts, rights): (Range<usize>, Range<usize>),
    tolerance_ns: u64,
) -> Vec<(usize, usize)> {
    let apart = |l: usize, r: usize| left[l].abs_diff(right[r]);
    let mut pairs = Vec::new();
    let (mut l, mut r) = (lefts.start, rights.start);
    while l < lefts.end && r < rights.end {
        let here = apart(l, r);
        if r + 1 < rights.end && apart(l, r + 1) < here {
            r += 1;
        } else if l + 1 < lefts.end && apart(l + 1, r) < here {
            l += 1;
        } else if here <= tolerance_ns {
            pairs.push((l, r));
            (l, r) = (l + 1, r + 1);
        } else if left[l] < right[r] {
            l += 1;
        } else {
            r += 1;
        }
    }
    pairs
}

/// The place of the time that is nearest, of two as near the earlier, in an ascending list.
#[must_use]
pub fn nearest(times: &[u64], to: u64) -> Option<usize> {
    let after = times.partition_point(|time| *time < to);
    let candidates = [after.checked_sub(1), (after < times.len()).then_some(after)];
    candidates.into_iter().flatten().min_by_key(|at| times[*at].abs_diff(to))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{any, proptest};
    use proptest::{collection, prop_assert};

    use super::{nearest, pairs};

    #[test]
    fn each_time_pairs_with_the_nearest_and_the_rest_stays_unpaired() {
        assert_eq!(pairs(&[0, 100, 200], &[3, 98, 205], 10), [(0, 0), (1, 1), (2, 2)]);
        // The partner of 100 was dropped.
        assert_eq!(pairs(&[0, 100, 200], &[3, 205], 10), [(0, 0), (2, 1)]);
        // 8 and 13 are both near 10: the nearer to it, and 0 stays alone.
        assert_eq!(pairs(&[0, 10], &[8, 13], 10), [(1, 0)]);
        // 14 is 15's; what is left over is near enough.
        assert_eq!(pairs(&[10, 15], &[4, 14], 10), [(0, 0), (1, 1)]);
        assert_eq!(pairs(&[0], &[11], 10), []);
        assert_eq!(pairs(&[], &[1], 10), []);
        assert_eq!(pairs(&[5, 5_000], &[5_001], u64::MAX), [(1, 0)]);
    }

    #[test]
    fn the_nearest_is_found_at_either_end() {
        assert_eq!(nearest(&[10, 20, 30], 0), Some(0));
        assert_eq!(nearest(&[10, 20, 30], 15), Some(0));
        assert_eq!(nearest(&[10, 20, 30], 26), Some(2));
        assert_eq!(nearest(&[10, 20, 30], 99), Some(2));
        assert_eq!(nearest(&[], 99), None);
    }

    proptest! {
        #[test]
        fn pairs_are_in_order_within_the_tolerance_and_none_is_left_over(
            mut left in collection::vec(any::<u16>(), 0..40), mut right in collection::vec(any::<u16>(), 0..40), tolerance in 0..3000_u64
        ) {
            left.sort_unstable();
            left.dedup();
            right.sort_unstable();
            right.dedup();
            let (left, right): (Vec<u64>, Vec<u64>) = (left.iter().map(|of| (*of).into()).collect(), right.iter().map(|of| (*of).into()).collect());
            let found = pairs(&left, &right, tolerance);
            prop_assert!(found.windows(2).all(|two| two[0].0 < two[1].0 && two[0].1 < two[1].1));
            prop_assert!(found.iter().all(|(l, r)| left[*l].abs_diff(right[*r]) <= tolerance));
            // Between two pairs nothing is left that could be one.
            let ends = [(left.len(), right.len())];
            let (mut l, mut r) = (0, 0);
            for (to_l, to_r) in found.iter().chain(&ends) {
                prop_assert!((l..*to_l).all(|l| (r..*to_r).all(|r| left[l].abs_diff(right[r]) > tolerance)));
                (l, r) = (to_l + 1, to_r + 1);
            }
            // Who is each other's nearest is a pair.
            for l in 0..left.len() {
                if let Some(r) = nearest(&right, left[l]) {
                    let is_mutual = nearest(&left, right[r]) == Some(l) && left[l].abs_diff(right[r]) <= tolerance;
                    let has_equals = right.iter().filter(|of| of.abs_diff(left[l]) == right[r].abs_diff(left[l])).count() > 1
                        || left.iter().filter(|of| of.abs_diff(right[r]) == right[r].abs_diff(left[l])).count() > 1;
                    prop_assert!(!is_mutual || has_equals || found.contains(&(l, r)));
                }
            }
        }
    }
}
