//! Removal of small regions, as `cv::filterSpeckles` does it.

/// Memory that one call leaves for the next.
#[derive(Clone, Debug, Default)]
pub struct SpeckleScratch {
    runs: Vec<Run>,
    /// For each column the run that its pixel belongs to, in the row above and in this one.
    above: Vec<u32>,
    here: Vec<u32>,
}

/// Neighbours in a row that belong together; and, as a set, the region they belong to.
#[derive(Clone, Copy, Debug)]
struct Run {
    start: u32,
    len: u32,
    /// Another run of the region, or this one if it stands for the region.
    parent: u32,
    /// Pixels of the region, if this run stands for it.
    region: u32,
}

/// The run of an invalid pixel.
const NONE: u32 = u32::MAX;

/// Sets to `invalid` every pixel of a 4-connected region of at most `window` pixels, where neighbours belong together
/// if they differ by at most `range` (same unit as the map) and neither is `invalid`. Rows are `width` long.
///
/// # Panics
/// If the map has 2^32 pixels or more.
pub fn filter(map: &mut [i16], width: usize, invalid: i16, window: usize, range: i32, scratch: &mut SpeckleScratch) {
    if map.is_empty() || window == 0 {
        return;
    }
    assert!(u32::try_from(map.len()).is_ok(), "a map of {} pixels", map.len());
    let SpeckleScratch { runs, above, here } = scratch;
    runs.clear();
    above.clear();
    above.resize(width, NONE);
    here.clear();
    here.resize(width, NONE);
    let near = |a: i16, b: i16| (i32::from(a) - i32::from(b)).abs() <= range;
    let mut row_above = &map[..width];
    for (y, row) in map.chunks_exact(width).enumerate() {
        let mut run = NONE;
        let mut before = invalid;
        // Runs joined last: neighbours mostly join the same two.
        let mut joined = (NONE, NONE);
        for (x, &value) in row.iter().enumerate() {
            if value == invalid {
                run = NONE;
            } else if run != NONE && near(before, value) {
                runs[run as usize].len += 1;
            } else {
                run = runs.len() as u32;
                runs.push(Run { start: (y * width + x) as u32, len: 1, parent: run, region: 0 });
            }
            before = value;
            here[x] = run;
            if run != NONE && above[x] != NONE && joined != (above[x], run) && near(row_above[x], value) {
                joined = (above[x], run);
                let (a, b) = (root(runs, above[x]), root(runs, run));
                // The older run stands for both.
                runs[a.max(b) as usize].parent = a.min(b);
            }
        }
        std::mem::swap(above, here);
        row_above = row;
    }
    for run in 0..runs.len() {
        let root = root(runs, run as u32);
        runs[root as usize].region += runs[run].len;
    }
    for run in 0..runs.len() {
        let Run { start, len, .. } = runs[run];
        let root = root(runs, run as u32);
        if runs[root as usize].region as usize <= window {
            map[start as usize..][..len as usize].fill(invalid);
        }
    }
}

/// The run that stands for a run's region.
fn root(runs: &mut [Run], mut run: u32) -> u32 {
    loop {
        let parent = runs[run as usize].parent;
        if parent == run {
            return run;
        }
        let above = runs[parent as usize].parent;
        runs[run as usize].parent = above;
        run = above;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{ProptestConfig, proptest};
    use proptest::{collection, prop_assert_eq};

    use super::{SpeckleScratch, filter};

    #[test]
    fn small_regions_go_and_large_ones_stay() {
        let mut map = [
            16, 16, 16, -16, 90, //
            16, 18, -16, -16, 90, //
            -16, -16, 500, -16, -16,
        ];
        filter(&mut map, 5, -16, 2, 2, &mut SpeckleScratch::default());
        assert_eq!(map, [16, 16, 16, -16, -16, 16, 18, -16, -16, -16, -16, -16, -16, -16, -16]);
    }

    #[test]
    fn a_step_above_the_range_parts_regions() {
        let mut map = [0, 0, 0, 3, 3, 3, 3];
        filter(&mut map, 7, -16, 3, 2, &mut SpeckleScratch::default());
        assert_eq!(map, [-16, -16, -16, 3, 3, 3, 3]);
    }

    /// The region of a pixel, found by walking from it.
    fn region(map: &[i16], width: usize, invalid: i16, range: i32, from: usize) -> Vec<usize> {
        let mut region = vec![from];
        let mut next = 0;
        while let Some(&at) = region.get(next) {
            next += 1;
            let (x, y) = (at % width, at / width);
            let neighbours = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then_some(at + 1),
                (y > 0).then(|| at - width),
                (at + width < map.len()).then_some(at + width),
            ];
            for to in neighbours.into_iter().flatten() {
                let near = (i32::from(map[at]) - i32::from(map[to])).abs() <= range;
                if map[to] != invalid && near && !region.contains(&to) {
                    region.push(to);
                }
            }
        }
        region
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn a_pixel_goes_exactly_if_its_region_is_small(
            width in 1usize..12,
            values in collection::vec(0i16..6, 60),
            window in 1usize..20,
            range in 0i32..3,
        ) {
            let map = &values[..60 / width * width];
            let mut filtered = map.to_vec();
            filter(&mut filtered, width, 0, window, range, &mut SpeckleScratch::default());
            for at in 0..map.len() {
                let small = map[at] == 0 || region(map, width, 0, range, at).len() <= window;
                prop_assert_eq!(filtered[at], if small { 0 } else { map[at] });
            }
        }
    }
}
