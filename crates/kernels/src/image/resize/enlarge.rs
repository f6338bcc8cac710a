//! What OpenCV's `INTER_AREA` does with an image that grows: linear interpolation in fixed point.

use super::scale;

/// Weights are 11-bit fixed point.
const ONE: f32 = 2048.0;

struct Pair {
    indices: [usize; 2],
    weights: [i32; 2],
}

/// The pairs of one axis. Unlike in half-pixel interpolation, an output pixel that lies whole in an input pixel copies
/// it.
fn pairs(input: usize, output: usize) -> Vec<Pair> {
    let (scale, inverse) = (scale(input, output), output as f64 / input as f64);
    let pair = |index: usize| {
        let first = (index as f64 * scale).floor() as usize;
        let offset = ((index + 1) as f64 - (first + 1) as f64 * inverse) as f32;
        let offset = if offset <= 0.0 { 0.0 } else { offset - offset.floor() };
        let weights = [1.0 - offset, offset].map(|weight| (weight * ONE).round_ties_even() as i32);
        Pair { indices: [first.min(input - 1), (first + 1).min(input - 1)], weights }
    };
    (0..output).map(pair).collect()
}

/// Resizes an interleaved RGB image that grows along at least one axis.
pub(super) fn linear_rgb8(
    input: &[u8],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
    out: &mut [u8],
) {
    let columns = pairs(width, out_width);
    let rows = pairs(height, out_height);
    let along = |y: usize| -> Vec<i32> {
        let row = &input[3 * width * y..][..3 * width];
        let mut out = Vec::with_capacity(3 * out_width);
        for Pair { indices: [a, b], weights: [wa, wb] } in &columns {
            out.extend((0..3).map(|c| wa * i32::from(row[3 * a + c]) + wb * i32::from(row[3 * b + c])));
        }
        out
    };
    let mut interpolated: [(usize, Vec<i32>); 2] = [(usize::MAX, Vec::new()), (usize::MAX, Vec::new())];
    for (out, Pair { indices, weights: [upper_weight, lower_weight] }) in out.chunks_exact_mut(3 * out_width).zip(&rows)
    {
        if interpolated[0].0 != indices[0] && interpolated[1].0 == indices[0] {
            interpolated.swap(0, 1);
        }
        for (interpolated, &y) in interpolated.iter_mut().zip(indices) {
            if interpolated.0 != y {
                *interpolated = (y, along(y));
            }
        }
        for ((out, upper), lower) in out.iter_mut().zip(&interpolated[0].1).zip(&interpolated[1].1) {
            let sum = ((upper_weight * (upper >> 4)) >> 16) + ((lower_weight * (lower >> 4)) >> 16);
            *out = ((sum + 2) >> 2) as u8;
        }
    }
}
