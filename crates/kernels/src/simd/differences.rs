//! Differences of bits by class: the compressions and expansions of vectors that compilers do not find.
#![expect(unsafe_code, reason = "vector loads and stores")]

use std::arch::x86_64::{
    __m128i, __m256i, _mm_loadu_si128, _mm_maskz_compress_epi8, _mm_maskz_expand_epi8, _mm_storeu_si128,
    _mm256_loadu_si256, _mm256_maskz_compress_epi16, _mm256_maskz_expand_epi16, _mm256_storeu_si256, _mm512_add_epi32,
    _mm512_alignr_epi32, _mm512_and_si512, _mm512_cmpge_epu32_mask, _mm512_cvtepi32_epi8, _mm512_cvtepi32_epi16,
    _mm512_cvtepu8_epi32, _mm512_cvtepu16_epi32, _mm512_loadu_si512, _mm512_or_si512, _mm512_permutexvar_epi32,
    _mm512_set1_epi32, _mm512_setzero_si512, _mm512_slli_epi32, _mm512_srai_epi32, _mm512_srli_epi32,
    _mm512_storeu_si512, _mm512_sub_epi32, _mm512_test_epi32_mask, _mm512_xor_si512, _pdep_u32, _pext_u32,
};

use super::differences_plain::{BLOCK, Room};

const LANES: usize = 16;
/// The lower bits of the classes of as many samples, and the upper.
const LOWER: u32 = 0x5555_5555;
const UPPER: u32 = 0xaaaa_aaaa;

/// Blocks of samples into their parts (see [`crate::float_differences`]).
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vbmi2,bmi2,popcnt")]
pub(super) fn apart(blocks: &[[f32; BLOCK]], room: &mut Room) {
    let Room { classes, middles, lows, highs, progress } = room;
    let (long, high) = (_mm512_set1_epi32(1 << 16), _mm512_set1_epi32(1 << 20));
    let mut before = _mm512_set1_epi32(progress.last as i32);
    let into = &mut classes.as_chunks_mut::<{ BLOCK / 4 }>().0[progress.blocks..];
    for (block, classes) in blocks.iter().zip(into) {
        for (lanes, classes) in block.as_chunks::<LANES>().0.iter().zip(classes.as_chunks_mut::<4>().0) {
            // SAFETY: as many samples as a vector has are read.
            let now = unsafe { _mm512_loadu_si512(lanes.as_ptr().cast()) };
            let of_bits = _mm512_sub_epi32(now, _mm512_alignr_epi32::<15>(now, before));
            before = now;
            let difference = _mm512_xor_si512(_mm512_slli_epi32::<1>(of_bits), _mm512_srai_epi32::<31>(of_bits));
            let is_some = _mm512_test_epi32_mask(difference, difference);
            let is_long = _mm512_cmpge_epu32_mask(difference, long);
            let is_high = _mm512_cmpge_epu32_mask(difference, high);
            let low = _mm256_maskz_compress_epi16(is_some, _mm512_cvtepi32_epi16(difference));
            store_words(lows, progress.lows, low);
            progress.lows += is_some.count_ones() as usize;
            if is_long != 0 {
                let above = _mm512_srli_epi32::<16>(difference);
                let is_middle = is_long & !is_high;
                let middle = _mm_maskz_compress_epi8(is_middle, _mm512_cvtepi32_epi8(above));
                store_bytes(middles, progress.middles, middle);
                progress.middles += is_middle.count_ones() as usize;
                store_words(highs, progress.highs, _mm256_maskz_compress_epi16(is_high, _mm512_cvtepi32_epi16(above)));
                progress.highs += is_high.count_ones() as usize;
            }
            let lower = is_some & !is_long | is_high;
            *classes = (_pdep_u32(lower.into(), LOWER) | _pdep_u32(is_long.into(), UPPER)).to_le_bytes();
        }
        progress.last = block[BLOCK - 1].to_bits();
        progress.blocks += 1;
    }
}

/// The parts of blocks into their samples; `None` if the parts end before.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vbmi2,bmi2,popcnt")]
pub(super) fn together(room: &mut Room, blocks: &mut [[f32; BLOCK]]) -> Option<()> {
    let Room { classes, middles, lows, highs, progress } = room;
    let (zero, one, last_lane) = (_mm512_setzero_si512(), _mm512_set1_epi32(1), _mm512_set1_epi32(15));
    let mut last = _mm512_set1_epi32(progress.last as i32);
    for (block, classes) in blocks.iter_mut().zip(classes.as_chunks::<{ BLOCK / 4 }>().0) {
        for (lanes, classes) in block.as_chunks_mut::<LANES>().0.iter_mut().zip(classes.as_chunks::<4>().0) {
            let classes = u32::from_le_bytes(*classes);
            // Sixteen bits are taken of each.
            let (lower, upper) = (_pext_u32(classes, LOWER) as u16, _pext_u32(classes, UPPER) as u16);
            let (is_some, is_middle, is_high) = (lower | upper, upper & !lower, upper & lower);
            let low = _mm256_maskz_expand_epi16(is_some, load_words(lows, progress.lows)?);
            progress.lows += is_some.count_ones() as usize;
            let mut difference = _mm512_cvtepu16_epi32(low);
            if upper != 0 {
                let middle = _mm_maskz_expand_epi8(is_middle, load_bytes(middles, progress.middles)?);
                progress.middles += is_middle.count_ones() as usize;
                let high = _mm256_maskz_expand_epi16(is_high, load_words(highs, progress.highs)?);
                progress.highs += is_high.count_ones() as usize;
                let above = _mm512_or_si512(_mm512_cvtepu8_epi32(middle), _mm512_cvtepu16_epi32(high));
                difference = _mm512_or_si512(difference, _mm512_slli_epi32::<16>(above));
            }
            let sign = _mm512_sub_epi32(zero, _mm512_and_si512(difference, one));
            // Sums of all lanes up to each, in four steps; what was before all of them is added last.
            let mut sums = _mm512_xor_si512(_mm512_srli_epi32::<1>(difference), sign);
            sums = _mm512_add_epi32(sums, _mm512_alignr_epi32::<15>(sums, zero));
            sums = _mm512_add_epi32(sums, _mm512_alignr_epi32::<14>(sums, zero));
            sums = _mm512_add_epi32(sums, _mm512_alignr_epi32::<12>(sums, zero));
            sums = _mm512_add_epi32(sums, _mm512_alignr_epi32::<8>(sums, zero));
            let bits = _mm512_add_epi32(sums, last);
            last = _mm512_permutexvar_epi32(last_lane, bits);
            // SAFETY: as many samples as a vector has are written.
            unsafe { _mm512_storeu_si512(lanes.as_mut_ptr().cast(), bits) };
        }
        progress.last = block[BLOCK - 1].to_bits();
    }
    Some(())
}

#[target_feature(enable = "avx512f,avx512vl")]
fn store_words(into: &mut [u8], at: usize, words: __m256i) {
    let into: &mut [u8; 32] = into[2 * at..].first_chunk_mut().expect("there is a block's room behind the last");
    // SAFETY: 32 bytes are written to 32.
    unsafe { _mm256_storeu_si256(into.as_mut_ptr().cast(), words) };
}

#[target_feature(enable = "avx512f,avx512vl")]
fn store_bytes(into: &mut [u8], at: usize, bytes: __m128i) {
    let into: &mut [u8; 16] = into[at..].first_chunk_mut().expect("there is a block's room behind the last");
    // SAFETY: 16 bytes are written to 16.
    unsafe { _mm_storeu_si128(into.as_mut_ptr().cast(), bytes) };
}

#[target_feature(enable = "avx512f,avx512vl")]
fn load_words(from: &[u8], at: usize) -> Option<__m256i> {
    let from: &[u8; 32] = from.get(2 * at..)?.first_chunk()?;
    // SAFETY: 32 bytes are read of 32.
    Some(unsafe { _mm256_loadu_si256(from.as_ptr().cast()) })
}

#[target_feature(enable = "avx512f,avx512vl")]
fn load_bytes(from: &[u8], at: usize) -> Option<__m128i> {
    let from: &[u8; 16] = from.get(at..)?.first_chunk()?;
    // SAFETY: 16 bytes are read of 16.
    Some(unsafe { _mm_loadu_si128(from.as_ptr().cast()) })
}
