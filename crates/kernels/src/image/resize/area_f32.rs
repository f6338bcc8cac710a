//! Shrinking a map of floats by area.

use super::area::Axis;
use super::scale;
use crate::raster::check;

/// Shrinks a map by area: each output pixel is the mean over its cell, as OpenCV's `resize(..., INTER_AREA)` of floats.
///
/// The same numbers up to rounding: OpenCV adds up in other orders, depending on the machine. Here each row of a cell
/// is added up from the left, then the rows from the top, on every machine alike.
///
/// # Panics
/// If a slice does not have the announced size, the output is empty, or it is larger than the input along either axis.
pub fn shrink_f32(input: &[f32], width: usize, height: usize, out_width: usize, out_height: usize, out: &mut [f32]) {
    check("map", input.len(), width, height, 1);
    check("shrunk map", out.len(), out_width, out_height, 1);
    assert!(
        (1..=width).contains(&out_width) && (1..=height).contains(&out_height),
        "a map of {width} x {height} cannot shrink to {out_width} x {out_height}"
    );
    let columns = Axis::new(width, out_width, scale(width, out_width));
    let rows = Axis::new(height, out_height, scale(height, out_height));
    for (out, (first, shares)) in out.chunks_exact_mut(out_width).zip(rows.cells()) {
        out.fill(0.0);
        for (row, &share) in input[width * first..].chunks_exact(width).zip(shares) {
            for (out, (first, shares)) in out.iter_mut().zip(columns.cells()) {
                let along = row[first..].iter().zip(shares).fold(0.0, |sum, (value, share)| sum + value * share);
                *out += share * along;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shrunk(input: &[f32], size: (usize, usize), out_size: (usize, usize)) -> Vec<f32> {
        let mut out = vec![7.0; out_size.0 * out_size.1];
        shrink_f32(input, size.0, size.1, out_size.0, out_size.1, &mut out);
        out
    }

    /// The mean over a cell by its definition: the overlap of every pixel with it.
    fn naive(input: &[f32], size: (usize, usize), out_size: (usize, usize)) -> Vec<f64> {
        let overlap = |pixel: usize, cell: usize, side: usize, cells: usize| {
            let (from, to) = (cell as f64 * side as f64 / cells as f64, (cell + 1) as f64 * side as f64 / cells as f64);
            (to.min((pixel + 1) as f64) - from.max(pixel as f64)).max(0.0) / (to - from)
        };
        let cell = |x: usize, y: usize| {
            let at = |i: usize, j: usize| f64::from(input[j * size.0 + i]);
            let row = |j: usize| (0..size.0).map(|i| overlap(i, x, size.0, out_size.0) * at(i, j)).sum::<f64>();
            (0..size.1).map(|j| overlap(j, y, size.1, out_size.1) * row(j)).sum()
        };
        (0..out_size.1).flat_map(|y| (0..out_size.0).map(move |x| cell(x, y))).collect()
    }

    // The expected numbers are those of OpenCV 5.0's resize(..., INTER_AREA) of float32.

    #[test]
    fn cells_are_weighted_means() {
        let map: Vec<f32> = (0..15u8).map(|k| f32::from(k * k)).collect();
        let shrunk_to = |out_size| shrunk(&map, (5, 3), out_size);
        let close = |found: Vec<f32>, expected: &[f32]| {
            assert_eq!(found.len(), expected.len());
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{found:?} is not {expected:?}");
        };
        close(shrunk_to((2, 2)), &[12.2, 29.8, 89.53334, 139.13335]);
        close(shrunk_to((4, 1)), &[43.86667, 57.86667, 74.66667, 94.26667]);
        assert_eq!(shrunk_to((5, 3)), map);
    }

    proptest! {
        #[test]
        fn every_cell_is_the_mean_over_its_area(
            size in (1usize..40, 1usize..12),
            part in (0.0..1.0f64, 0.0..1.0f64),
            seed in any::<u32>(),
        ) {
            let out_size = (1 + (part.0 * size.0 as f64) as usize, 1 + (part.1 * size.1 as f64) as usize);
            let out_size = (out_size.0.min(size.0), out_size.1.min(size.1));
            let random = |k: usize| (k as u32 ^ seed).wrapping_mul(2_654_435_761) >> 12;
            let map: Vec<f32> = (0..size.0 * size.1).map(|k| random(k) as f32 / (1 << 20) as f32).collect();
            // Slivers under a thousandth of a pixel are left out, as in OpenCV.
            for (found, expected) in shrunk(&map, size, out_size).iter().zip(naive(&map, size, out_size)) {
                prop_assert!((f64::from(*found) - expected).abs() < 5e-3, "{found} is not {expected}");
            }
        }
    }
}
