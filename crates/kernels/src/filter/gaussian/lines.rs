//! Blurring a mask along its rows.

use crate::raster::reflect101;
use crate::simd::{BLOCK, Block};

/// Columns blurred together: their sums stay in registers.
pub(super) const STRIP: usize = BLOCK;

/// The set pixels of a mask, a bit each, with the reflected border of either side.
pub(super) struct SetPixels {
    /// Rows of `words` words; bit 0 of a row stands for column `-radius`.
    bits: Vec<u64>,
    words: usize,
    radius: usize,
    /// The taps between `STRIP - 1` zeros on either side: a set pixel adds `STRIP` of them, whatever its column.
    padded_taps: Vec<f32>,
}

impl SetPixels {
    pub(super) fn new(mask: &[u8], width: usize, height: usize, taps: &[f32]) -> Self {
        let radius = taps.len() / 2;
        // One strip more than the image has, so that the last strip's window is whole.
        let words = (width + 2 * radius + STRIP).div_ceil(64) + 1;
        let mut bits = vec![0; words * height];
        for (y, bits) in bits.chunks_exact_mut(words).enumerate() {
            let row = &mask[y * width..][..width];
            let mut set = |bit: usize, value: u64| {
                bits[bit / 64] |= value << (bit % 64);
                bits[bit / 64 + 1] |= (value >> 1) >> (63 - bit % 64);
            };
            let (eights, rest) = row.as_chunks::<8>();
            for (index, &eight) in eights.iter().enumerate() {
                set(radius + 8 * index, set_bytes(eight));
            }
            for (index, &pixel) in rest.iter().enumerate() {
                set(radius + 8 * eights.len() + index, u64::from(pixel != 0));
            }
            for margin in 1..=radius as isize {
                let right = width as isize - 1 + margin;
                set(radius - margin as usize, u64::from(row[reflect101(-margin, width)] != 0));
                set(radius + right as usize, u64::from(row[reflect101(right, width)] != 0));
            }
        }
        let mut padded_taps = vec![0.0; 2 * (STRIP - 1) + taps.len()];
        padded_taps[STRIP - 1..][..taps.len()].copy_from_slice(taps);
        Self { bits, words, radius, padded_taps }
    }

    /// Columns `left..left + STRIP` of row `y`, blurred along the row. Columns outside the image have no meaning.
    #[inline(always)]
    pub(super) fn blurred<B: Block>(&self, y: usize, left: usize) -> B {
        let row = &self.bits[y * self.words..][..self.words];
        // The window's bits are `left..left + reach`.
        let reach = STRIP + 2 * self.radius;
        let mut sum = B::zero();
        for begin in (0..reach).step_by(64) {
            let (word, shift) = ((left + begin) / 64, (left + begin) % 64);
            let mut bits = row[word] >> shift | row[word + 1] << 1 << (63 - shift);
            if reach - begin < 64 {
                bits &= (1 << (reach - begin)) - 1;
            }
            while bits != 0 {
                let position = begin + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let taps = self.padded_taps[reach - 1 - position..].first_chunk().expect("the padding is a strip wide");
                sum = sum.plus(B::load(taps));
            }
        }
        sum
    }
}

/// Bit `i` is set where byte `i` is not 0.
#[inline(always)]
fn set_bytes(bytes: [u8; 8]) -> u64 {
    const LOW: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    let bytes = u64::from_le_bytes(bytes);
    // The top bit of every byte that is not 0, moved to the lowest bit; the product gathers bit 8 i at 56 + i.
    let flags = ((((bytes & LOW) + LOW) | bytes) & !LOW) >> 7;
    flags.wrapping_mul(0x0102_0408_1020_4080) >> 56
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_bytes_are_found_in_order() {
        assert_eq!(set_bytes([0, 1, 0, 255, 128, 0, 0, 127]), 0b1001_1010);
        for i in 0..8 {
            for value in 1..=255 {
                let mut bytes = [0; 8];
                bytes[i] = value;
                assert_eq!(set_bytes(bytes), 1 << i);
            }
        }
    }
}
