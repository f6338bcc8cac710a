//! Sorting and selection networks: minima and maxima in a fixed order, hence one vector instruction each.
//!
//! Merging is Batcher's odd-even merge (Batcher 1968, "Sorting networks and their applications"): merge the samples of
//! even and of odd index, then order neighbours across the two. Unused outputs are left out. That each
//! network is right is proved in the tests by the 0-1 principle.

use crate::raster::key;

/// What is sorted.
pub(super) trait Sample: Copy + Default {
    /// The sample of a pixel.
    fn from_depth(depth: f32) -> Self;
    /// The pixel of a sample.
    fn depth(self) -> f32;
    fn lesser(self, other: Self) -> Self;
    fn greater(self, other: Self) -> Self;
}

/// The [`key`] of a pixel: all floats have an order, NaN too.
impl Sample for i32 {
    #[inline(always)]
    fn from_depth(depth: f32) -> Self {
        key(depth.to_bits() as Self)
    }

    #[inline(always)]
    fn depth(self) -> f32 {
        f32::from_bits(key(self) as u32)
    }

    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        self.min(other)
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        self.max(other)
    }
}

/// A pixel that is zero or above, without a sign, and not NaN. Vectors of 512 bits compare floats on two ports, and
/// integers on one.
impl Sample for f32 {
    #[inline(always)]
    fn from_depth(depth: f32) -> Self {
        depth
    }

    #[inline(always)]
    fn depth(self) -> f32 {
        self
    }

    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
}

#[inline(always)]
fn order<T: Sample>(a: T, b: T) -> (T, T) {
    (a.lesser(b), a.greater(b))
}

#[inline(always)]
fn middle<T: Sample>(a: T, b: T, c: T) -> T {
    let (low, high) = order(a, b);
    low.greater(high.lesser(c))
}

#[inline(always)]
pub(super) fn sort3<T: Sample>([a, b, c]: [T; 3]) -> [T; 3] {
    let (a, b) = order(a, b);
    let (b, c) = order(b, c);
    let (a, b) = order(a, b);
    [a, b, c]
}

/// The median of nine samples in three sorted groups of three.
#[inline(always)]
pub(super) fn median3_of_sorted<T: Sample>([a, b, c]: [[T; 3]; 3]) -> T {
    let low = a[0].greater(b[0]).greater(c[0]);
    let high = a[2].lesser(b[2]).lesser(c[2]);
    middle(low, middle(a[1], b[1], c[1]), high)
}

#[inline(always)]
pub(super) fn sort5<T: Sample>([a, b, c, d, e]: [T; 5]) -> [T; 5] {
    let (a, b) = order(a, b);
    let (c, d) = order(c, d);
    let [s, t, u, v] = merge2([a, b], [c, d]);
    // The fifth is inserted by Batcher's merge of four and one.
    let (s, e) = order(s, e);
    let (u, e) = order(u, e);
    let (t, u) = order(t, u);
    let (v, e) = order(v, e);
    [s, t, u, v, e]
}

#[inline(always)]
fn merge2<T: Sample>(a: [T; 2], b: [T; 2]) -> [T; 4] {
    let (first, low) = order(a[0], b[0]);
    let (high, last) = order(a[1], b[1]);
    let (low, high) = order(low, high);
    [first, low, high, last]
}

#[inline(always)]
fn merge3<T: Sample>(a: [T; 3], b: [T; 3]) -> [T; 6] {
    let even = merge2([a[0], a[2]], [b[0], b[2]]);
    let odd = order(a[1], b[1]);
    let (s, t) = order(odd.0, even[1]);
    let (u, v) = order(odd.1, even[2]);
    [even[0], s, t, u, v, even[3]]
}

#[inline(always)]
pub(super) fn merge5<T: Sample>(a: [T; 5], b: [T; 5]) -> [T; 10] {
    let even = merge3([a[0], a[2], a[4]], [b[0], b[2], b[4]]);
    let odd = merge2([a[1], a[3]], [b[1], b[3]]);
    let (r1, r2) = order(odd[0], even[1]);
    let (r3, r4) = order(odd[1], even[2]);
    let (r5, r6) = order(odd[2], even[3]);
    let (r7, r8) = order(odd[3], even[4]);
    [even[0], r1, r2, r3, r4, r5, r6, r7, r8, even[5]]
}

#[inline(always)]
fn middle_of_merge2<T: Sample>(a: [T; 2], b: [T; 2]) -> (T, T) {
    order(a[0].greater(b[0]), a[1].lesser(b[1]))
}

#[inline(always)]
fn middle_of_merge3<T: Sample>(a: [T; 3], b: [T; 3]) -> (T, T) {
    let even = middle_of_merge2([a[0], a[2]], [b[0], b[2]]);
    let odd = order(a[1], b[1]);
    (odd.0.greater(even.0), odd.1.lesser(even.1))
}

/// Ranks 4, 5 and 6 (from 0) of two sorted fives.
#[inline(always)]
fn ranks_4_to_6<T: Sample>(a: [T; 5], b: [T; 5]) -> [T; 3] {
    let even = middle_of_merge3([a[0], a[2], a[4]], [b[0], b[2], b[4]]);
    let odd = middle_of_merge2([a[1], a[3]], [b[1], b[3]]);
    let (r5, r6) = order(odd.1, even.1);
    [odd.0.greater(even.0), r5, r6]
}

/// Ranks 3, 4 and 5 (from 0) of two sorted fives.
#[inline(always)]
fn ranks_3_to_5<T: Sample>(a: [T; 5], b: [T; 5]) -> [T; 3] {
    let even = middle_of_merge3([a[0], a[2], a[4]], [b[0], b[2], b[4]]);
    let odd = middle_of_merge2([a[1], a[3]], [b[1], b[3]]);
    let (r3, r4) = order(odd.0, even.0);
    [r3, r4, odd.1.lesser(even.1)]
}

/// Ranks 7 to 12 (from 0) of two sorted tens, ascending: the only ones of twenty samples that can be the median once
/// five more are known.
#[inline(always)]
pub(super) fn middle6<T: Sample>(a: [T; 10], b: [T; 10]) -> [T; 6] {
    let even = ranks_4_to_6([a[0], a[2], a[4], a[6], a[8]], [b[0], b[2], b[4], b[6], b[8]]);
    let odd = ranks_3_to_5([a[1], a[3], a[5], a[7], a[9]], [b[1], b[3], b[5], b[7], b[9]]);
    let (r7, r8) = order(odd[0], even[0]);
    let (r9, r10) = order(odd[1], even[1]);
    let (r11, r12) = order(odd[2], even[2]);
    [r7, r8, r9, r10, r11, r12]
}

/// The median of a sorted six and a sorted five.
#[inline(always)]
pub(super) fn median11<T: Sample>(a: [T; 6], b: [T; 5]) -> T {
    let even = middle_of_merge3([a[0], a[2], a[4]], [b[0], b[2], b[4]]).1;
    let odd = a[3].lesser(b[3]).greater(a[1].greater(a[5].lesser(b[1])));
    odd.lesser(even)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All sorted sequences of zeros and ones: by the 0-1 principle a network is right for every input if it is right
    /// for these.
    fn sorted<const N: usize>() -> impl Iterator<Item = [i32; N]> {
        (0..=N).map(|zeros| std::array::from_fn(|i| i32::from(i >= zeros)))
    }

    fn unsorted<const N: usize>() -> impl Iterator<Item = [i32; N]> {
        (0..1 << N).map(|bits: u32| std::array::from_fn(|i| (bits >> i & 1) as i32))
    }

    fn ascending(samples: impl IntoIterator<Item = i32>) -> Vec<i32> {
        let mut samples: Vec<i32> = samples.into_iter().collect();
        samples.sort_unstable();
        samples
    }

    #[test]
    fn small_sorts_sort() {
        for samples in unsorted::<3>() {
            assert_eq!(sort3(samples).to_vec(), ascending(samples));
            assert_eq!(middle(samples[0], samples[1], samples[2]), ascending(samples)[1]);
        }
        for samples in unsorted::<5>() {
            assert_eq!(sort5(samples).to_vec(), ascending(samples));
        }
    }

    #[test]
    fn three_sorted_threes_give_the_median_of_nine() {
        for a in sorted::<3>() {
            for b in sorted::<3>() {
                for c in sorted::<3>() {
                    assert_eq!(median3_of_sorted([a, b, c]), ascending([a, b, c].concat())[4]);
                }
            }
        }
    }

    #[test]
    fn merges_of_fives_and_tens_keep_every_rank_they_promise() {
        for a in sorted::<5>() {
            for b in sorted::<5>() {
                let all = ascending([a, b].concat());
                assert_eq!(merge5(a, b).to_vec(), all);
                assert_eq!(ranks_4_to_6(a, b), all[4..7]);
                assert_eq!(ranks_3_to_5(a, b), all[3..6]);
            }
        }
        for a in sorted::<10>() {
            for b in sorted::<10>() {
                assert_eq!(middle6(a, b), ascending([a, b].concat())[7..13]);
            }
        }
    }

    #[test]
    fn a_sorted_six_and_a_sorted_five_give_the_median_of_eleven() {
        for a in sorted::<6>() {
            for b in sorted::<5>() {
                assert_eq!(median11(a, b), ascending(a.into_iter().chain(b))[5]);
            }
        }
    }
}
