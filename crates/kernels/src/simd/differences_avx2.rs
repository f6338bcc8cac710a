//! Samples from the differences of their bits, four at a time. A byte of classes selects a shuffle that moves the
//! stored bytes to their places.
#![expect(unsafe_code, reason = "vector loads and stores")]

use std::arch::x86_64::{
    __m128i, _mm_add_epi32, _mm_and_si128, _mm_cvtsi32_si128, _mm_cvtsi64_si128, _mm_loadu_si128, _mm_or_si128,
    _mm_set1_epi32, _mm_setzero_si128, _mm_shuffle_epi8, _mm_shuffle_epi32, _mm_slli_si128, _mm_srli_epi32,
    _mm_storeu_si128, _mm_sub_epi32, _mm_unpacklo_epi64, _mm_xor_si128,
};

use super::differences_plain::{BLOCK, Room};

/// The index for which a shuffle gives zero.
const NONE: u8 = 0x80;
/// The offset of the middle bits in the bytes that are shuffled: the high bits of four samples are before them.
const MIDDLES: u8 = 8;

/// How the differences of four samples are stored, for one byte of classes.
struct Expansion {
    /// By byte of the four differences, the index of the stored byte of low bits.
    lows: [u8; 16],
    /// The same for high and middle bits.
    above: [u8; 16],
    low_count: u8,
    middle_count: u8,
    high_count: u8,
}

static EXPANSIONS: [Expansion; 256] = expansions();

const fn expansions() -> [Expansion; 256] {
    const EMPTY: Expansion =
        Expansion { lows: [NONE; 16], above: [NONE; 16], low_count: 0, middle_count: 0, high_count: 0 };
    let mut all = [EMPTY; 256];
    let mut classes = 0;
    while classes < 256 {
        let expansion = &mut all[classes];
        let mut place = 0;
        while place < 4 {
            let class = classes >> (2 * place) & 3;
            let byte = 4 * place;
            if class != 0 {
                expansion.lows[byte] = 2 * expansion.low_count;
                expansion.lows[byte + 1] = 2 * expansion.low_count + 1;
                expansion.low_count += 1;
            }
            if class == 2 {
                expansion.above[byte + 2] = MIDDLES + expansion.middle_count;
                expansion.middle_count += 1;
            }
            if class == 3 {
                expansion.above[byte + 2] = 2 * expansion.high_count;
                expansion.above[byte + 3] = 2 * expansion.high_count + 1;
                expansion.high_count += 1;
            }
            place += 1;
        }
        classes += 1;
    }
    all
}

/// The parts of blocks into their samples (see [`crate::float_differences`]); `None` if the parts end before.
#[target_feature(enable = "avx2")]
pub(super) fn together(room: &mut Room, blocks: &mut [[f32; BLOCK]]) -> Option<()> {
    let Room { classes, middles, lows, highs, progress } = room;
    let (zero, one) = (_mm_setzero_si128(), _mm_set1_epi32(1));
    let mut last = _mm_set1_epi32(progress.last as i32);
    for (block, classes) in blocks.iter_mut().zip(classes.as_chunks::<{ BLOCK / 4 }>().0) {
        let low: &[u8; 2 * BLOCK] = lows.get(2 * progress.lows..)?.first_chunk()?;
        let middle: &[u8; BLOCK] = middles.get(progress.middles..)?.first_chunk()?;
        let high: &[u8; 2 * BLOCK] = highs.get(2 * progress.highs..)?.first_chunk()?;
        let (mut low_count, mut middle_count, mut high_count) = (0, 0, 0);
        for (four, classes) in block.as_chunks_mut::<4>().0.iter_mut().zip(classes) {
            let expansion = &EXPANSIONS[usize::from(*classes)];
            // Of a block's first 60 samples at most 60 advance the output: four more follow.
            let low = i64::from_le_bytes(*low[2 * low_count..].first_chunk()?);
            let middle = i32::from_le_bytes(*middle[middle_count..].first_chunk()?);
            let high = i64::from_le_bytes(*high[2 * high_count..].first_chunk()?);
            let above = _mm_unpacklo_epi64(_mm_cvtsi64_si128(high), _mm_cvtsi32_si128(middle));
            let low = _mm_shuffle_epi8(_mm_cvtsi64_si128(low), loaded(&expansion.lows));
            let difference = _mm_or_si128(low, _mm_shuffle_epi8(above, loaded(&expansion.above)));
            low_count += usize::from(expansion.low_count);
            middle_count += usize::from(expansion.middle_count);
            high_count += usize::from(expansion.high_count);
            let sign = _mm_sub_epi32(zero, _mm_and_si128(difference, one));
            // Sums of all lanes up to each, in two steps; what was before all of them is added last.
            let mut sums = _mm_xor_si128(_mm_srli_epi32::<1>(difference), sign);
            sums = _mm_add_epi32(sums, _mm_slli_si128::<4>(sums));
            sums = _mm_add_epi32(sums, _mm_slli_si128::<8>(sums));
            let bits = _mm_add_epi32(sums, last);
            last = _mm_shuffle_epi32::<0xff>(bits);
            // SAFETY: as many bytes as four samples have are written.
            unsafe { _mm_storeu_si128(four.as_mut_ptr().cast(), bits) };
        }
        progress.lows += low_count;
        progress.middles += middle_count;
        progress.highs += high_count;
        progress.last = block[BLOCK - 1].to_bits();
    }
    Some(())
}

#[target_feature(enable = "avx2")]
fn loaded(bytes: &[u8; 16]) -> __m128i {
    // SAFETY: 16 bytes are read of 16.
    unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) }
}
