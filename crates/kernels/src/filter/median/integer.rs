//! 3x3 medians of maps of integers; the border is replicated.

/// One row of the median from the rows above, at and below it.
#[inline(always)]
pub(crate) fn median3_row<T: Ord + Copy>(rows: [&[T]; 3], out: &mut [T]) {
    let last = out.len() - 1;
    for x in [0, last] {
        let columns = [x.saturating_sub(1), x, (x + 1).min(last)];
        out[x] = median9(rows.map(|row| columns.map(|x| row[x])));
    }
    if last < 2 {
        return;
    }
    let (above, here, below) = (rows[0].windows(3), rows[1].windows(3), rows[2].windows(3));
    for (out, ((a, b), c)) in out[1..last].iter_mut().zip(above.zip(here).zip(below)) {
        *out = median9([[a[0], a[1], a[2]], [b[0], b[1], b[2]], [c[0], c[1], c[2]]]);
    }
}

/// Row `y` of a map with its neighbours.
#[inline(always)]
pub(crate) fn rows_around<T>(map: &[T], width: usize, y: usize) -> [&[T]; 3] {
    let last = map.len() / width - 1;
    [y.saturating_sub(1), y, (y + 1).min(last)].map(|y| &map[y * width..][..width])
}

/// The middle of: the largest of the three columns' smallest, the middle of their middles, the smallest of their
/// largest.
#[inline(always)]
fn median9<T: Ord + Copy>([a, b, c]: [[T; 3]; 3]) -> T {
    // Written out: a closure would not be compiled with the caller's SIMD instructions.
    let columns = [sorted3([a[0], b[0], c[0]]), sorted3([a[1], b[1], c[1]]), sorted3([a[2], b[2], c[2]])];
    let [a, b, c] = columns;
    let low = a[0].max(b[0]).max(c[0]);
    let middle = sorted3([a[1], b[1], c[1]])[1];
    let high = a[2].min(b[2]).min(c[2]);
    sorted3([low, middle, high])[1]
}

#[inline(always)]
fn sorted3<T: Ord + Copy>([a, b, c]: [T; 3]) -> [T; 3] {
    let (low, high) = (a.min(b), a.max(b));
    let (middle, high) = (high.min(c), high.max(c));
    [low.min(middle), low.max(middle), high]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{ProptestConfig, any, proptest};
    use proptest::{collection, prop_assert_eq};

    use super::{median3_row, rows_around};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn is_the_fifth_of_nine_sorted_values(width in 1usize..7, height in 1usize..7, seed in collection::vec(any::<i16>(), 36)) {
            let source = &seed[..width * height];
            let mut out = vec![0; source.len()];
            for (y, out) in out.chunks_exact_mut(width).enumerate() {
                median3_row(rows_around(source, width, y), out);
            }
            for y in 0..height {
                for x in 0..width {
                    let mut nine = Vec::new();
                    for dy in [-1, 0, 1] {
                        for dx in [-1, 0, 1] {
                            let y = (y as i32 + dy).clamp(0, height as i32 - 1) as usize;
                            let x = (x as i32 + dx).clamp(0, width as i32 - 1) as usize;
                            nine.push(source[y * width + x]);
                        }
                    }
                    nine.sort_unstable();
                    prop_assert_eq!(out[y * width + x], nine[4]);
                }
            }
        }
    }
}
