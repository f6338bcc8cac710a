//! Grey from interleaved colour: the shuffles that compilers do not find.
#![expect(unsafe_code, reason = "vector loads and stores")]

use std::arch::x86_64::{
    _mm_loadu_si128, _mm_storeu_si128, _mm256_add_epi32, _mm256_castsi256_si128, _mm256_madd_epi16,
    _mm256_packus_epi16, _mm256_packus_epi32, _mm256_permutevar8x32_epi32, _mm256_set_m128i, _mm256_set1_epi32,
    _mm256_setr_epi8, _mm256_setr_epi32, _mm256_shuffle_epi8, _mm256_srli_epi32,
};

const ROUND: usize = 16;

/// Grey of as many leading pixels as whole rounds make (see [`crate::image::grey`]); returns how many these are.
#[target_feature(enable = "avx2")]
pub(super) fn grey_avx2(rgb: &[u8], out: &mut [u8]) -> usize {
    // A load takes four pixels and four bytes more.
    const LOADED: usize = 3 * ROUND + 4;
    let red_and_green = {
        let (r, g, z) = ([0, 3, 6, 9], [1, 4, 7, 10], -1);
        _mm256_setr_epi8(
            r[0], z, g[0], z, r[1], z, g[1], z, r[2], z, g[2], z, r[3], z, g[3], z, //
            r[0], z, g[0], z, r[1], z, g[1], z, r[2], z, g[2], z, r[3], z, g[3], z,
        )
    };
    let blue = {
        let z = -1;
        _mm256_setr_epi8(
            2, z, z, z, 5, z, z, z, 8, z, z, z, 11, z, z, z, //
            2, z, z, z, 5, z, z, z, 8, z, z, z, 11, z, z, z,
        )
    };
    let red_and_green_weights = _mm256_set1_epi32(19235 << 16 | 9798);
    let blue_weight = _mm256_set1_epi32(3735);
    let half = _mm256_set1_epi32(16384);
    let mut done = 0;
    while 3 * done + LOADED <= rgb.len() && done + ROUND <= out.len() {
        let bytes: &[u8; LOADED] = rgb[3 * done..].first_chunk().expect("the loop's condition");
        let eight = |first: usize| {
            // SAFETY: `first` is 0 or 8: 16 bytes from 3 * (first + 4) on end at or before `LOADED`.
            let (low, high) = unsafe {
                (
                    _mm_loadu_si128(bytes.as_ptr().add(3 * first).cast()),
                    _mm_loadu_si128(bytes.as_ptr().add(3 * (first + 4)).cast()),
                )
            };
            let pixels = _mm256_set_m128i(high, low);
            let sum = _mm256_add_epi32(
                _mm256_madd_epi16(_mm256_shuffle_epi8(pixels, red_and_green), red_and_green_weights),
                _mm256_madd_epi16(_mm256_shuffle_epi8(pixels, blue), blue_weight),
            );
            _mm256_srli_epi32::<15>(_mm256_add_epi32(sum, half))
        };
        // Packing works within halves: fours of pixels come out as 0, 2, 0, 2 and 1, 3, 1, 3.
        let words = _mm256_packus_epi32(eight(0), eight(8));
        let fours = _mm256_packus_epi16(words, words);
        let ordered = _mm256_permutevar8x32_epi32(fours, _mm256_setr_epi32(0, 4, 1, 5, 0, 4, 1, 5));
        let greys: &mut [u8; ROUND] = out[done..].first_chunk_mut().expect("the loop's condition");
        // SAFETY: sixteen bytes are written to sixteen.
        unsafe { _mm_storeu_si128(greys.as_mut_ptr().cast(), _mm256_castsi256_si128(ordered)) };
        done += ROUND;
    }
    done
}
