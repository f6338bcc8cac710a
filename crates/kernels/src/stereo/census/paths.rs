//! Path aggregation (Hirschmueller 2008): one sweep over the image takes the paths that come with it.
//!
//! A sweep goes row by row, downwards in the order of columns or upwards against it, and takes the vertical, the
//! horizontal and, of eight paths, the two diagonal ones that come from rows it has seen. The upward sweep is the
//! downward one on the image turned by 180 degrees, and is written as that: positions below count in the sweep's own
//! order.

use super::costs::{Candidates, hamming};
use super::features::Feature;

/// Bytes before and after a path's costs. They stay 255: there is no cheaper neighbour beyond the range of disparities.
const GUARD: usize = 16;
pub(super) const MOST_LANES: usize = 256;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Penalties {
    pub p1: u8,
    pub p2: u8,
}

/// Paths of one direction, one entry each: the costs at the last pixel reached, between guards, and the smallest.
#[derive(Debug, Default)]
struct PathCosts {
    costs: Vec<u8>,
    least: Vec<u8>,
    stride: usize,
}

impl PathCosts {
    fn begin(&mut self, count: usize, lanes: usize) {
        self.stride = lanes + 2 * GUARD;
        self.costs.clear();
        self.costs.resize(count * self.stride, u8::MAX);
        self.least.clear();
        self.least.resize(count, 0);
        (0..count).for_each(|path| self.begin_path(path));
    }

    /// A path that has not begun costs nothing, whatever its disparity.
    fn begin_path(&mut self, path: usize) {
        let stride = self.stride;
        self.costs[path * stride..][..stride][GUARD..stride - GUARD].fill(0);
        self.least[path] = 0;
    }

    /// The path's next pixel; its costs are added to `sums`.
    #[inline(always)]
    fn advance<const N: usize>(&mut self, path: usize, penalties: Penalties, costs: &[u8], sums: &mut [u16]) {
        let entry = &mut self.costs[path * self.stride..][..self.stride];
        self.least[path] = advance::<N>(entry, self.least[path], penalties, costs, sums);
    }
}

/// Equation 13 of Hirschmueller 2008, whose smallest cost at the pixel before is `before`; returns the new smallest.
///
/// In bytes this is exact. The smallest cost of a path's pixel is at most a match's, since staying is free; so what
/// lies `p2` above is below 255, as are all costs, and a difference that saturates is more than `p2`.
#[inline(always)]
fn advance<const N: usize>(
    entry: &mut [u8],
    before: u8,
    Penalties { p1, p2 }: Penalties,
    costs: &[u8],
    sums: &mut [u16],
) -> u8 {
    let mut least = [u8::MAX; N];
    // Kept back one chunk: the next one still needs the old costs.
    let mut waiting = [0; N];
    let mut start = GUARD;
    for (costs, sums) in costs.as_chunks::<N>().0.iter().zip(sums.as_chunks_mut::<N>().0) {
        let [nearer, same, farther] = [start - 1, start, start + 1].map(|at| {
            let mut chunk = [0; N];
            chunk.copy_from_slice(&entry[at..at + N]);
            chunk
        });
        let mut next = [0; N];
        for lane in 0..N {
            let step = nearer[lane].min(farther[lane]).saturating_sub(before).saturating_add(p1);
            let stay = same[lane].saturating_sub(before);
            next[lane] = costs[lane].saturating_add(step.min(stay).min(p2));
        }
        for lane in 0..N {
            least[lane] = least[lane].min(next[lane]);
            sums[lane] += u16::from(next[lane]);
        }
        if start > GUARD {
            entry[start - N..start].copy_from_slice(&waiting);
        }
        waiting = next;
        start += N;
    }
    entry[start - N..start].copy_from_slice(&waiting);
    least.into_iter().fold(u8::MAX, u8::min)
}

#[derive(Debug, Default)]
pub(super) struct Aggregation<F> {
    upward: bool,
    width: usize,
    lanes: usize,
    penalties: Penalties,
    /// 255 at lanes that pad the disparities to whole vectors.
    padding: Vec<u8>,
    candidates: Candidates<F>,
    rows: usize,
    vertical: PathCosts,
    /// Paths that come from the pixel before in the row before, and from the pixel behind in the row before.
    diagonal: Option<[PathCosts; 2]>,
    horizontal: PathCosts,
}

impl<F: Feature> Aggregation<F> {
    pub(super) fn begin(
        &mut self,
        upward: bool,
        width: usize,
        (disparities, lanes): (usize, usize),
        penalties: Penalties,
        with_diagonals: bool,
    ) {
        (self.upward, self.width, self.lanes, self.penalties, self.rows) = (upward, width, lanes, penalties, 0);
        self.padding.clear();
        self.padding.resize(disparities, 0);
        self.padding.resize(lanes, u8::MAX);
        self.vertical.begin(width, lanes);
        self.horizontal.begin(1, lanes);
        self.diagonal = with_diagonals.then(|| self.diagonal.take().unwrap_or_default());
        for paths in self.diagonal.iter_mut().flatten() {
            paths.begin(width, lanes);
        }
    }

    /// Adds the costs of this sweep's paths at one row to `sums`, `lanes` a column.
    #[inline(always)]
    pub(super) fn row<const N: usize>(&mut self, left: &[F], right: &[F], min_disparity: i32, sums: &mut [u16]) {
        let Self { width, lanes, penalties, .. } = *self;
        self.candidates.set(right, min_disparity, lanes);
        self.horizontal.begin_path(0);
        // A diagonal keeps its entry over all rows: it is named by where it would have met the first one, modulo the
        // width. The entry of the diagonal that has left the image is that of the one that begins.
        let shift = self.rows % width;
        if let Some([before, behind]) = &mut self.diagonal {
            before.begin_path((width - shift) % width);
            behind.begin_path((width - 1 + shift) % width);
        }
        let mut costs = [0; MOST_LANES];
        let costs = &mut costs[..lanes];
        for step in 0..width {
            let x = if self.upward { width - 1 - step } else { step };
            let sums = &mut sums[x * lanes..][..lanes];
            hamming::<N, F>(left[x], self.candidates.at(x, lanes), &self.padding, costs);
            self.horizontal.advance::<N>(0, penalties, costs, sums);
            self.vertical.advance::<N>(step, penalties, costs, sums);
            if let Some([before, behind]) = &mut self.diagonal {
                let path = if step >= shift { step - shift } else { step + width - shift };
                before.advance::<N>(path, penalties, costs, sums);
                let path = if step + shift < width { step + shift } else { step + shift - width };
                behind.advance::<N>(path, penalties, costs, sums);
            }
        }
        self.rows += 1;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{ProptestConfig, any, proptest};
    use proptest::{collection, prop_assert_eq};

    use super::{GUARD, Penalties, advance};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn bytes_hold_the_recursion_of_the_paper(
            bits in 1..63_u8, p2 in any::<u8>(), p1 in any::<u8>(), matches in collection::vec(any::<u8>(), 8 * 32)
        ) {
            let p2 = p2 % (255 - bits + 1);
            let p1 = p1 % (p2 + 1);
            let mut entry = vec![255; 32 + 2 * GUARD];
            entry[GUARD..GUARD + 32].fill(0);
            let mut least = 0;
            let mut path = [0_i64; 32];
            for costs in matches.chunks_exact(32) {
                let costs: Vec<u8> = costs.iter().map(|cost| cost % (bits + 1)).collect();
                let mut sums = [0; 32];
                least = advance::<8>(&mut entry, least, Penalties { p1, p2 }, &costs, &mut sums);
                let smallest = *path.iter().min().unwrap();
                let before = path;
                for d in 0..32 {
                    let mut best = before[d].min(smallest + i64::from(p2));
                    for neighbour in [d.wrapping_sub(1), d + 1] {
                        best = best.min(before.get(neighbour).map_or(i64::MAX, |cost| cost + i64::from(p1)));
                    }
                    path[d] = i64::from(costs[d]) + best - smallest;
                }
                prop_assert_eq!(sums.map(i64::from), path);
                prop_assert_eq!(i64::from(least), *path.iter().min().unwrap());
            }
        }
    }
}
