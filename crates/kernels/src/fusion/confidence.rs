//! Stereo's confidence `W_c`: how near the next edge is.

use crate::filter::gaussian::blur_mask_at;
use crate::simd::{Level, Pass};

/// `W_c` of an edge map (see [`crate::filter::edges`]): the map, blurred with a Gaussian of `sigma_px`, divided by its
/// maximum.
///
/// Any value of `mask` but 0 is an edge. An image without edges has no confidence anywhere: zeros.
///
/// # Panics
/// If a slice does not have the size that `width` and `height` announce, or `sigma_px` is not positive and finite.
pub fn confidence_from_edges(mask: &[u8], width: usize, height: usize, sigma_px: f64, out: &mut [f32]) {
    confidence_from_edges_at(Level::best(), mask, width, height, sigma_px, out);
}

pub(crate) fn confidence_from_edges_at(
    level: Level,
    mask: &[u8],
    width: usize,
    height: usize,
    sigma_px: f64,
    out: &mut [f32],
) {
    blur_mask_at(level, mask, width, height, sigma_px, out);
    let top = level.run(Largest { values: out });
    level.run(Divide { values: out, top });
}

struct Largest<'a> {
    values: &'a [f32],
}

impl Pass for Largest<'_> {
    type Output = f32;

    #[inline(always)]
    fn run(self) -> f32 {
        let mut top = [0f32; 32];
        let (blocks, rest) = self.values.as_chunks::<32>();
        for block in blocks {
            for (top, &value) in top.iter_mut().zip(block) {
                *top = if value > *top { value } else { *top };
            }
        }
        top.into_iter().chain(rest.iter().copied()).fold(0.0, f32::max)
    }
}

struct Divide<'a> {
    values: &'a mut [f32],
    top: f32,
}

impl Pass for Divide<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        if self.top > 0.0 {
            for value in self.values {
                *value /= self.top;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;

    #[test]
    fn without_edges_the_confidence_is_zero() {
        let mut out = [7.0; 12];
        confidence_from_edges(&[0; 12], 4, 3, 10.0, &mut out);
        assert_eq!(out, [0.0; 12]);
    }

    #[test]
    fn confidence_is_one_at_a_lone_edge_and_falls_off_on_either_side() {
        let mut mask = vec![0; 301 * 9];
        for y in 0..9 {
            mask[y * 301 + 150] = 255;
        }
        let confidence = every_level(|level| {
            let mut out = vec![7.0; mask.len()];
            confidence_from_edges_at(level, &mask, 301, 9, 10.0, &mut out);
            out
        });
        let row = &confidence[4 * 301..5 * 301];
        assert_eq!(row[150], 1.0);
        assert!(row[150..191].is_sorted_by(|a, b| a > b));
        assert!((0..=150).all(|k| row[150 - k] == row[150 + k]));
        // exp(-0.5) at one sigma; nothing beyond four.
        assert!((row[160] - 0.606_530_66).abs() < 1e-6);
        assert_eq!(row[191..], [0.0; 110]);
    }
}
