//! [`Lanes`] in AVX2 instructions.

use std::arch::x86_64::{
    __m256i, _mm_loadu_si128, _mm_min_epu16, _mm_minpos_epu16, _mm256_add_epi8, _mm256_add_epi16, _mm256_adds_epi16,
    _mm256_alignr_epi8, _mm256_and_si256, _mm256_blendv_epi8, _mm256_broadcastw_epi16, _mm256_castsi256_si128,
    _mm256_cmpeq_epi16, _mm256_cmpgt_epi16, _mm256_cvtepu8_epi16, _mm256_extract_epi16, _mm256_extracti128_si256,
    _mm256_loadu_si256, _mm256_max_epu8, _mm256_min_epi16, _mm256_min_epu8, _mm256_movemask_epi8, _mm256_packs_epi16,
    _mm256_permute2x128_si256, _mm256_permute4x64_epi64, _mm256_set1_epi8, _mm256_set1_epi16, _mm256_srli_epi16,
    _mm256_storeu_si256, _mm256_sub_epi16, _mm256_subs_epu8,
};

use super::Lanes;

#[derive(Clone, Copy)]
pub(in crate::stereo) struct Avx2;

#[inline(always)]
fn bits(a: __m256i, b: __m256i) -> u32 {
    // SAFETY: as the trait demands.
    unsafe { _mm256_movemask_epi8(_mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(a, b))) as u32 }
}

// The bodies below do nothing but name one or two instructions.
// `SAFETY: as the trait demands` there means: AVX2 was found, and pointers are vouched for; they need no alignment.
impl Lanes for Avx2 {
    type V = __m256i;
    type B = __m256i;
    const LANES: usize = 16;

    #[inline(always)]
    unsafe fn load(from: *const i16) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_loadu_si256(from.cast()) }
    }
    #[inline(always)]
    unsafe fn store(to: *mut i16, v: __m256i) {
        // SAFETY: as the trait demands.
        unsafe { _mm256_storeu_si256(to.cast(), v) }
    }
    #[inline(always)]
    fn splat(v: i16) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_set1_epi16(v) }
    }
    #[inline(always)]
    fn add(a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_add_epi16(a, b) }
    }
    #[inline(always)]
    fn sub(a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_sub_epi16(a, b) }
    }
    #[inline(always)]
    fn add_saturating(a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_adds_epi16(a, b) }
    }
    #[inline(always)]
    fn min(a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_min_epi16(a, b) }
    }
    #[inline(always)]
    fn where_less(a: __m256i, b: __m256i, x: __m256i, y: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_blendv_epi8(y, x, _mm256_cmpgt_epi16(b, a)) }
    }
    #[inline(always)]
    fn below(before: __m256i, v: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_alignr_epi8::<14>(v, _mm256_permute2x128_si256::<0x21>(before, v)) }
    }
    #[inline(always)]
    fn above(v: __m256i, after: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_alignr_epi8::<2>(_mm256_permute2x128_si256::<0x21>(v, after), v) }
    }
    #[inline(always)]
    fn minimum(v: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe {
            let half = _mm_min_epu16(_mm256_castsi256_si128(v), _mm256_extracti128_si256::<1>(v));
            _mm256_broadcastw_epi16(_mm_minpos_epu16(half))
        }
    }
    #[inline(always)]
    fn first(v: __m256i) -> i16 {
        // SAFETY: as the trait demands.
        unsafe { _mm256_extract_epi16::<0>(v) as i16 }
    }
    #[inline(always)]
    unsafe fn equal_bits(from: *const i16, v: __m256i) -> u32 {
        // SAFETY: as the trait demands.
        unsafe {
            let (a, b) = (Self::load(from), Self::load(from.add(16)));
            bits(_mm256_cmpeq_epi16(a, v), _mm256_cmpeq_epi16(b, v))
        }
    }
    #[inline(always)]
    unsafe fn less_bits(from: *const i16, v: __m256i) -> u32 {
        // SAFETY: as the trait demands.
        unsafe {
            let (a, b) = (Self::load(from), Self::load(from.add(16)));
            bits(_mm256_cmpgt_epi16(v, a), _mm256_cmpgt_epi16(v, b))
        }
    }
    #[inline(always)]
    unsafe fn load_widened(from: *const u8) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_cvtepu8_epi16(_mm_loadu_si128(from.cast())) }
    }
    #[inline(always)]
    unsafe fn load_bytes(from: *const u8) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_loadu_si256(from.cast()) }
    }
    #[inline(always)]
    unsafe fn store_bytes(to: *mut u8, b: __m256i) {
        // SAFETY: as the trait demands.
        unsafe { _mm256_storeu_si256(to.cast(), b) }
    }
    #[inline(always)]
    fn splat_bytes(b: u8) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_set1_epi8(b as i8) }
    }
    #[inline(always)]
    fn add_bytes(a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_add_epi8(a, b) }
    }
    #[inline(always)]
    fn sub_bytes(a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_subs_epu8(a, b) }
    }
    #[inline(always)]
    fn min_bytes(a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_min_epu8(a, b) }
    }
    #[inline(always)]
    fn max_bytes(a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_max_epu8(a, b) }
    }
    #[inline(always)]
    fn quarter_bytes(a: __m256i) -> __m256i {
        // SAFETY: as the trait demands.
        unsafe { _mm256_and_si256(_mm256_srli_epi16::<2>(a), _mm256_set1_epi8(0x3f)) }
    }
    #[inline(always)]
    fn widen(b: __m256i) -> [__m256i; 2] {
        // SAFETY: as the trait demands.
        unsafe {
            [_mm256_cvtepu8_epi16(_mm256_castsi256_si128(b)), _mm256_cvtepu8_epi16(_mm256_extracti128_si256::<1>(b))]
        }
    }
}
