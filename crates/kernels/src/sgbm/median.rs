//! The 3x3 median that OpenCV applies to every disparity map; the border is replicated.

/// Median of each pixel's 3x3 neighbourhood; `source` and `out` have rows of `width`.
pub(super) fn median3(source: &[i16], width: usize, out: &mut [i16]) {
    let height = source.len() / width;
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        let row = |y: usize| &source[y * width..][..width];
        median3_row([row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))], out);
    }
}

/// One row of the median from the rows above, at and below it.
#[inline(always)]
pub(super) fn median3_row(rows: [&[i16]; 3], out: &mut [i16]) {
    let width = out.len();
    let last = width - 1;
    for x in [0, last] {
        let columns = [x.saturating_sub(1), x, (x + 1).min(last)];
        out[x] = median_of_rows(rows.map(|row| columns.map(|x| row[x])));
    }
    if width < 3 {
        return;
    }
    let (above, here, below) = (rows[0].windows(3), rows[1].windows(3), rows[2].windows(3));
    for (out, ((a, b), c)) in out[1..last].iter_mut().zip(above.zip(here).zip(below)) {
        *out = median_of_rows([[a[0], a[1], a[2]], [b[0], b[1], b[2]], [c[0], c[1], c[2]]]);
    }
}

#[inline(always)]
fn median_of_rows([a, b, c]: [[i16; 3]; 3]) -> i16 {
    median_of_sorted([sorted3([a[0], b[0], c[0]]), sorted3([a[1], b[1], c[1]]), sorted3([a[2], b[2], c[2]])])
}

/// The median of nine: the largest of the smallest, the middle of the middles, the smallest of the largest; their middle.
#[inline(always)]
fn median_of_sorted(columns: [[i16; 3]; 3]) -> i16 {
    let [a, b, c] = columns;
    let low = a[0].max(b[0]).max(c[0]);
    let middle = sorted3([a[1], b[1], c[1]])[1];
    let high = a[2].min(b[2]).min(c[2]);
    sorted3([low, middle, high])[1]
}

#[inline(always)]
fn sorted3([a, b, c]: [i16; 3]) -> [i16; 3] {
    let (low, high) = (a.min(b), a.max(b));
    let (middle, high) = (high.min(c), high.max(c));
    [low.min(middle), low.max(middle), high]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{ProptestConfig, any, proptest};
    use proptest::{collection, prop_assert_eq};

    use super::median3;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn is_the_fifth_of_nine_sorted_values(width in 1usize..7, height in 1usize..7, seed in collection::vec(any::<i16>(), 36)) {
            let source = &seed[..width * height];
            let mut out = vec![0; source.len()];
            median3(source, width, &mut out);
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
