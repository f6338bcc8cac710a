//! [`Lanes`] in NEON instructions, which every 64-bit ARM processor has.

use std::arch::aarch64::{
    int16x8_t, uint8x16_t, uint16x8_t, vaddq_s16, vaddq_u8, vandq_u8, vbslq_s16, vceqq_s16, vcltq_s16, vdupq_n_s16,
    vdupq_n_u8, vextq_s16, vget_low_u8, vgetq_lane_s16, vgetq_lane_u32, vld1_u8, vld1q_s16, vld1q_u8, vmaxq_u8,
    vminq_s16, vminq_u8, vminvq_s16, vmovl_high_u8, vmovl_u8, vpaddq_u8, vqaddq_s16, vqsubq_u8, vreinterpretq_s16_u16,
    vreinterpretq_u8_u16, vreinterpretq_u32_u8, vshrq_n_u8, vst1q_s16, vst1q_u8, vsubq_s16, vuzp1q_u8,
};

use super::Lanes;

#[derive(Clone, Copy)]
pub(in crate::stereo) struct Neon;

/// A bit for each of 32 lanes.
#[inline(always)]
fn bits(masks: [uint16x8_t; 4]) -> u32 {
    const WEIGHTS: [u8; 16] = [1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128];
    // SAFETY: NEON is part of the target; the weights are as many as are read.
    unsafe {
        let weights = vld1q_u8(WEIGHTS.as_ptr());
        let [a, b, c, d] = masks.map(|mask| vreinterpretq_u8_u16(mask));
        let (low, high) = (vandq_u8(vuzp1q_u8(a, b), weights), vandq_u8(vuzp1q_u8(c, d), weights));
        let pairs = vpaddq_u8(low, high);
        let quarters = vpaddq_u8(pairs, pairs);
        vgetq_lane_u32::<0>(vreinterpretq_u32_u8(vpaddq_u8(quarters, quarters)))
    }
}

// The bodies below do nothing but name one or two instructions.
// `SAFETY: as the trait demands` there means: NEON is part of the target, and pointers are vouched for; they need no
// alignment.
impl Lanes for Neon {
    type V = int16x8_t;
    type B = uint8x16_t;
    const LANES: usize = 8;

    #[inline(always)]
    unsafe fn load(from: *const i16) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vld1q_s16(from) }
    }
    #[inline(always)]
    unsafe fn store(to: *mut i16, v: int16x8_t) {
        // SAFETY: as the trait demands.
        unsafe { vst1q_s16(to, v) }
    }
    #[inline(always)]
    fn splat(v: i16) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vdupq_n_s16(v) }
    }
    #[inline(always)]
    fn add(a: int16x8_t, b: int16x8_t) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vaddq_s16(a, b) }
    }
    #[inline(always)]
    fn sub(a: int16x8_t, b: int16x8_t) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vsubq_s16(a, b) }
    }
    #[inline(always)]
    fn add_saturating(a: int16x8_t, b: int16x8_t) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vqaddq_s16(a, b) }
    }
    #[inline(always)]
    fn min(a: int16x8_t, b: int16x8_t) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vminq_s16(a, b) }
    }
    #[inline(always)]
    fn where_less(a: int16x8_t, b: int16x8_t, x: int16x8_t, y: int16x8_t) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vbslq_s16(vcltq_s16(a, b), x, y) }
    }
    #[inline(always)]
    fn below(before: int16x8_t, v: int16x8_t) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vextq_s16::<7>(before, v) }
    }
    #[inline(always)]
    fn above(v: int16x8_t, after: int16x8_t) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vextq_s16::<1>(v, after) }
    }
    #[inline(always)]
    fn minimum(v: int16x8_t) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vdupq_n_s16(vminvq_s16(v)) }
    }
    #[inline(always)]
    fn first(v: int16x8_t) -> i16 {
        // SAFETY: as the trait demands.
        unsafe { vgetq_lane_s16::<0>(v) }
    }
    #[inline(always)]
    unsafe fn equal_bits(from: *const i16, v: int16x8_t) -> u32 {
        // SAFETY: as the trait demands.
        unsafe { bits([0, 8, 16, 24].map(|at| vceqq_s16(Self::load(from.add(at)), v))) }
    }
    #[inline(always)]
    unsafe fn less_bits(from: *const i16, v: int16x8_t) -> u32 {
        // SAFETY: as the trait demands.
        unsafe { bits([0, 8, 16, 24].map(|at| vcltq_s16(Self::load(from.add(at)), v))) }
    }
    #[inline(always)]
    unsafe fn load_widened(from: *const u8) -> int16x8_t {
        // SAFETY: as the trait demands.
        unsafe { vreinterpretq_s16_u16(vmovl_u8(vld1_u8(from))) }
    }
    #[inline(always)]
    unsafe fn load_bytes(from: *const u8) -> uint8x16_t {
        // SAFETY: as the trait demands.
        unsafe { vld1q_u8(from) }
    }
    #[inline(always)]
    unsafe fn store_bytes(to: *mut u8, b: uint8x16_t) {
        // SAFETY: as the trait demands.
        unsafe { vst1q_u8(to, b) }
    }
    #[inline(always)]
    fn splat_bytes(b: u8) -> uint8x16_t {
        // SAFETY: as the trait demands.
        unsafe { vdupq_n_u8(b) }
    }
    #[inline(always)]
    fn add_bytes(a: uint8x16_t, b: uint8x16_t) -> uint8x16_t {
        // SAFETY: as the trait demands.
        unsafe { vaddq_u8(a, b) }
    }
    #[inline(always)]
    fn sub_bytes(a: uint8x16_t, b: uint8x16_t) -> uint8x16_t {
        // SAFETY: as the trait demands.
        unsafe { vqsubq_u8(a, b) }
    }
    #[inline(always)]
    fn min_bytes(a: uint8x16_t, b: uint8x16_t) -> uint8x16_t {
        // SAFETY: as the trait demands.
        unsafe { vminq_u8(a, b) }
    }
    #[inline(always)]
    fn max_bytes(a: uint8x16_t, b: uint8x16_t) -> uint8x16_t {
        // SAFETY: as the trait demands.
        unsafe { vmaxq_u8(a, b) }
    }
    #[inline(always)]
    fn quarter_bytes(a: uint8x16_t) -> uint8x16_t {
        // SAFETY: as the trait demands.
        unsafe { vshrq_n_u8::<2>(a) }
    }
    #[inline(always)]
    fn widen(b: uint8x16_t) -> [int16x8_t; 2] {
        // SAFETY: as the trait demands.
        unsafe { [vreinterpretq_s16_u16(vmovl_u8(vget_low_u8(b))), vreinterpretq_s16_u16(vmovl_high_u8(b))] }
    }
}
