//! [`Lanes`] in AVX-512 instructions.

use std::arch::x86_64::{
    __m512i, _mm_extract_epi16, _mm_min_epu16, _mm_minpos_epu16, _mm256_castsi256_si128, _mm256_extracti128_si256,
    _mm256_loadu_si256, _mm256_min_epu16, _mm512_add_epi8, _mm512_add_epi16, _mm512_adds_epi16, _mm512_alignr_epi32,
    _mm512_and_si512, _mm512_broadcastw_epi16, _mm512_castsi512_si128, _mm512_castsi512_si256, _mm512_cmpeq_epi16_mask,
    _mm512_cmplt_epi16_mask, _mm512_cvtepu8_epi16, _mm512_extracti64x4_epi64, _mm512_loadu_si512,
    _mm512_mask_blend_epi16, _mm512_max_epu8, _mm512_min_epi16, _mm512_min_epu8, _mm512_set1_epi8, _mm512_set1_epi16,
    _mm512_shldi_epi32, _mm512_shrdi_epi32, _mm512_srli_epi16, _mm512_storeu_si512, _mm512_sub_epi16, _mm512_subs_epu8,
};

use super::Lanes;

#[derive(Clone, Copy)]
pub(in crate::stereo) struct Avx512;

// The bodies below do nothing but name one or a few instructions.
// `SAFETY: as the trait demands` there means: the instructions were found, and pointers are vouched for; they need no
// alignment.
impl Lanes for Avx512 {
    type V = __m512i;
    type B = __m512i;
    const LANES: usize = 32;

    #[inline(always)]
    unsafe fn load(from: *const i16) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_loadu_si512(from.cast()) }
    }
    #[inline(always)]
    unsafe fn store(to: *mut i16, v: __m512i) {
        // SAFETY: as the trait demands.
        unsafe { _mm512_storeu_si512(to.cast(), v) }
    }
    #[inline(always)]
    fn splat(v: i16) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_set1_epi16(v) }
    }
    #[inline(always)]
    fn add(a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_add_epi16(a, b) }
    }
    #[inline(always)]
    fn sub(a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_sub_epi16(a, b) }
    }
    #[inline(always)]
    fn add_saturating(a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_adds_epi16(a, b) }
    }
    #[inline(always)]
    fn min(a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_min_epi16(a, b) }
    }
    #[inline(always)]
    fn where_less(a: __m512i, b: __m512i, x: __m512i, y: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_mask_blend_epi16(_mm512_cmplt_epi16_mask(a, b), y, x) }
    }
    #[inline(always)]
    fn below(before: __m512i, v: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_shldi_epi32::<16>(v, _mm512_alignr_epi32::<15>(v, before)) }
    }
    #[inline(always)]
    fn above(v: __m512i, after: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_shrdi_epi32::<16>(v, _mm512_alignr_epi32::<1>(after, v)) }
    }
    #[inline(always)]
    fn minimum(v: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe {
            let half = _mm256_min_epu16(_mm512_castsi512_si256(v), _mm512_extracti64x4_epi64::<1>(v));
            let quarter = _mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256::<1>(half));
            _mm512_broadcastw_epi16(_mm_minpos_epu16(quarter))
        }
    }
    #[inline(always)]
    fn first(v: __m512i) -> i16 {
        // SAFETY: as the trait demands.
        unsafe { _mm_extract_epi16::<0>(_mm512_castsi512_si128(v)) as i16 }
    }
    #[inline(always)]
    unsafe fn equal_bits(from: *const i16, v: __m512i) -> u32 {
        // SAFETY: as the trait demands.
        unsafe { _mm512_cmpeq_epi16_mask(Self::load(from), v) }
    }
    #[inline(always)]
    unsafe fn less_bits(from: *const i16, v: __m512i) -> u32 {
        // SAFETY: as the trait demands.
        unsafe { _mm512_cmplt_epi16_mask(Self::load(from), v) }
    }
    #[inline(always)]
    unsafe fn load_widened(from: *const u8) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_cvtepu8_epi16(_mm256_loadu_si256(from.cast())) }
    }
    #[inline(always)]
    unsafe fn load_bytes(from: *const u8) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_loadu_si512(from.cast()) }
    }
    #[inline(always)]
    unsafe fn store_bytes(to: *mut u8, b: __m512i) {
        // SAFETY: as the trait demands.
        unsafe { _mm512_storeu_si512(to.cast(), b) }
    }
    #[inline(always)]
    fn splat_bytes(b: u8) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_set1_epi8(b as i8) }
    }
    #[inline(always)]
    fn add_bytes(a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_add_epi8(a, b) }
    }
    #[inline(always)]
    fn sub_bytes(a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_subs_epu8(a, b) }
    }
    #[inline(always)]
    fn min_bytes(a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_min_epu8(a, b) }
    }
    #[inline(always)]
    fn max_bytes(a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_max_epu8(a, b) }
    }
    #[inline(always)]
    fn quarter_bytes(a: __m512i) -> __m512i {
        // SAFETY: as the trait demands.
        unsafe { _mm512_and_si512(_mm512_srli_epi16::<2>(a), _mm512_set1_epi8(0x3f)) }
    }
    #[inline(always)]
    fn widen(b: __m512i) -> [__m512i; 2] {
        // SAFETY: as the trait demands.
        unsafe {
            let upper = _mm512_extracti64x4_epi64::<1>(b);
            [_mm512_cvtepu8_epi16(_mm512_castsi512_si256(b)), _mm512_cvtepu8_epi16(upper)]
        }
    }
}
