//! The cheapest candidate of a pixel, whether it is unique, and where the parabola has its minimum.

/// Marks an invalid pixel in raw maps; larger than all disparities, also to the median.
pub(super) const NONE: u16 = u16::MAX;

#[derive(Clone, Copy, Debug)]
pub(super) struct Demands {
    /// Per cent.
    pub uniqueness: u32,
    pub subpixel: bool,
}

/// The best match of each right pixel so far: its cost above its disparity; last column first, as candidates lie.
#[derive(Debug, Default)]
pub(super) struct RightBest {
    keys: Vec<u32>,
    width: usize,
}

impl RightBest {
    #[inline(always)]
    pub(super) fn begin(&mut self, width: usize, disparities: usize) {
        self.width = width;
        self.keys.clear();
        self.keys.resize(width + disparities, u32::MAX);
    }

    /// Disparities of the right image's columns, counted from `min_disparity`.
    #[inline(always)]
    pub(super) fn write(&self, min_disparity: i32, out: &mut [u16]) {
        let last = self.width as isize - 1 - min_disparity as isize;
        for (column, out) in out.iter_mut().enumerate() {
            let key = usize::try_from(last - column as isize).ok().and_then(|index| self.keys.get(index));
            *out = key.filter(|&&key| key != u32::MAX).map_or(NONE, |key| disparity(*key) as u16);
        }
    }
}

#[inline(always)]
fn disparity(key: u32) -> usize {
    (key & 255) as usize
}

/// The disparity of column `x` in 1/16 px above the smallest disparity, from its summed costs; the right image's pixels
/// learn of them.
#[inline(always)]
pub(super) fn choose(x: usize, sums: &[u16], demands: Demands, right: &mut RightBest) -> u16 {
    let right = &mut right.keys[right.width - 1 - x..][..sums.len()];
    let mut best = u32::MAX;
    for ((right, &sum), d) in right.iter_mut().zip(sums).zip(0..) {
        // Of equal costs, the smaller disparity wins.
        let key = u32::from(sum) << 8 | d;
        best = best.min(key);
        *right = (*right).min(key);
    }
    let (winner, cost) = (disparity(best), best >> 8);
    if demands.uniqueness > 0 && !unique(sums, winner, cost, demands.uniqueness) {
        return NONE;
    }
    let sixteenths = (winner * 16) as u16;
    if !demands.subpixel || winner == 0 || winner + 1 == sums.len() {
        return sixteenths;
    }
    let [nearer, farther] = [winner - 1, winner + 1].map(|d| i32::from(sums[d]));
    // Never 0: the winner is the first of the cheapest.
    let curvature = nearer - 2 * cost as i32 + farther;
    let offset = (16 * (nearer - farther) + curvature) / (2 * curvature);
    (i32::from(sixteenths) + offset) as u16
}

/// Whether no candidate but the winner's neighbours costs less than `cost / (1 - percent / 100)`.
#[inline(always)]
fn unique(sums: &[u16], winner: usize, cost: u32, percent: u32) -> bool {
    let limit = (100 * cost).div_ceil(100 - percent).min(u32::from(u16::MAX)) as u16;
    let below = |sums: &[u16]| sums.iter().map(|&sum| u16::from(sum < limit)).sum::<u16>();
    below(sums) == below(&sums[winner.saturating_sub(1)..(winner + 2).min(sums.len())])
}

#[cfg(test)]
mod tests {
    use super::{Demands, NONE, RightBest, choose};

    fn chosen(sums: &[(usize, u16)], uniqueness: u32, subpixel: bool) -> u16 {
        let mut costs = [1000; 32];
        sums.iter().for_each(|&(d, cost)| costs[d] = cost);
        let mut right = RightBest::default();
        right.begin(40, 32);
        choose(35, &costs, Demands { uniqueness, subpixel }, &mut right)
    }

    #[test]
    fn the_first_of_the_cheapest_wins() {
        assert_eq!(chosen(&[(20, 7), (5, 7)], 0, false), 80);
        assert_eq!(chosen(&[(0, 7), (31, 7)], 0, true), 0);
    }

    #[test]
    fn uniqueness_leaves_the_neighbours_out_and_is_strict() {
        assert_eq!(chosen(&[(5, 95), (6, 96), (20, 100)], 5, false), 80);
        assert_eq!(chosen(&[(5, 95), (6, 96), (20, 99)], 5, false), NONE);
        assert_eq!(chosen(&[(5, 95), (20, 99)], 4, false), 80);
        assert_eq!(chosen(&[(5, 0)], 99, false), 80);
    }

    #[test]
    fn the_parabola_leans_towards_the_cheaper_neighbour() {
        assert_eq!(chosen(&[(5, 10), (4, 20), (6, 20)], 0, true), 80);
        assert_eq!(chosen(&[(5, 10), (4, 30), (6, 11)], 0, true), 80 + 7);
        assert_eq!(chosen(&[(5, 10), (4, 11), (6, 30)], 0, true), 80 - 6);
    }

    #[test]
    fn right_pixels_keep_their_cheapest_match() {
        let mut right = RightBest::default();
        right.begin(4, 16);
        let mut costs = [50; 16];
        let demands = Demands { uniqueness: 0, subpixel: false };
        costs[1] = 3;
        choose(2, &costs, demands, &mut right);
        costs[1] = 50;
        choose(3, &costs, demands, &mut right);
        let mut out = [9; 4];
        right.write(0, &mut out);
        // Column 1 is column 2 less 1, for 3; the others have equal costs, and so the smaller disparity.
        assert_eq!(out, [2, 1, 0, 0]);
        right.write(-2, &mut out);
        assert_eq!(out, [4, 3, 2, 1]);
        right.write(2, &mut out);
        assert_eq!(out, [0, 0, NONE, NONE]);
    }
}
