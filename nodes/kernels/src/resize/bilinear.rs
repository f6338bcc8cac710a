//! Bilinear resizing of a map of floats.

use super::scale;
use crate::raster::check;
use crate::simd::{Level, Pass};

/// Resizes a map of floats with half-pixel centres: OpenCV's `resize(..., INTER_LINEAR)`.
///
/// Beyond the outermost centres the outermost sample repeats. Halving both axes takes the mean of four, as in OpenCV.
///
/// # Panics
/// If a slice does not have the announced size, or one map is empty and the other is not.
pub fn bilinear_f32(input: &[f32], width: usize, height: usize, out_width: usize, out_height: usize, out: &mut [f32]) {
    bilinear_f32_at(Level::best(), input, (width, height), (out_width, out_height), out);
}

pub(crate) fn bilinear_f32_at(
    level: Level,
    input: &[f32],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
    out: &mut [f32],
) {
    check("map", input.len(), width, height, 1);
    check("resized map", out.len(), out_width, out_height, 1);
    if out.is_empty() {
        return;
    }
    assert!(!input.is_empty(), "an empty map cannot be resized to {out_width} x {out_height}");
    if (width, height) == (out_width, out_height) {
        out.copy_from_slice(input);
        return;
    }
    let columns = pairs(width, out_width);
    let rows = pairs(height, out_height);
    level.run(Bilinear { input, width, columns: &columns, rows: &rows, out });
}

/// Two neighbouring samples and their weights.
struct Pair {
    first: usize,
    second: usize,
    weights: [f32; 2],
}

fn pairs(input: usize, output: usize) -> Vec<Pair> {
    let scale = scale(input, output);
    let pair = |index: usize| {
        let position = ((index as f64 + 0.5) * scale - 0.5) as f32;
        let floor = position.floor();
        let offset = position - floor;
        let clamped = |index: f32| index.clamp(0.0, (input - 1) as f32) as usize;
        let (first, second) = (clamped(floor), clamped(floor + 1.0));
        let weights = if first == second { [1.0, 0.0] } else { [1.0 - offset, offset] };
        Pair { first, second, weights }
    };
    (0..output).map(pair).collect()
}

struct Bilinear<'a> {
    input: &'a [f32],
    width: usize,
    columns: &'a [Pair],
    rows: &'a [Pair],
    out: &'a mut [f32],
}

impl Pass for Bilinear<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { input, width, columns, rows, out } = self;
        // The two rows last widened, by the index of the row they came from.
        let mut upper = (usize::MAX, vec![0f32; columns.len()]);
        let mut lower = (usize::MAX, vec![0f32; columns.len()]);
        for (out, row) in out.chunks_exact_mut(columns.len()).zip(rows) {
            if upper.0 != row.first && lower.0 == row.first {
                std::mem::swap(&mut upper, &mut lower);
            }
            for ((from, widened), y) in
                [(&mut upper, row.first), (&mut lower, row.second)].map(|((f, w), y)| ((f, w), y))
            {
                if *from != y {
                    *from = y;
                    widen(&input[y * width..][..width], columns, widened);
                }
            }
            let [upper_weight, lower_weight] = row.weights;
            for ((out, &upper), &lower) in out.iter_mut().zip(&upper.1).zip(&lower.1) {
                *out = upper * upper_weight + lower * lower_weight;
            }
        }
    }
}

#[inline(always)]
fn widen(row: &[f32], columns: &[Pair], out: &mut [f32]) {
    for (out, Pair { first, second, weights: [a, b] }) in out.iter_mut().zip(columns) {
        *out = row[*first] * a + row[*second] * b;
    }
}
