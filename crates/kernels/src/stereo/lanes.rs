//! What the fast matchers need of an instruction set: vectors of 16-bit lanes, and of twice as many bytes.
//!
//! The kernels are written once over [`Lanes`]. [`Portable`] is plain Rust: it runs on every machine and under Miri,
//! and the compiler vectorises most of it; `Avx2`, `Avx512` and `Neon` name the instructions.
#![expect(unsafe_code, reason = "vector instructions, and reads and writes of whole vectors")]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "aarch64")]
mod neon;

#[cfg(target_arch = "x86_64")]
pub(in crate::stereo) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(in crate::stereo) use avx512::Avx512;
#[cfg(target_arch = "aarch64")]
pub(in crate::stereo) use neon::Neon;

pub(in crate::stereo) const COMPARED: usize = 32;

/// Padding behind a row, bytes: at least a vector, which is read past its end.
pub(in crate::stereo) const WIDEST: usize = 64;

const LANES: usize = 16;
const BYTES: usize = 32;

/// The operations of an instruction set.
///
/// An implementation is named only in functions that are compiled for the instruction set, and a level
/// that was found picks these: so arithmetic is safe to call.
pub(in crate::stereo) trait Lanes: Copy + 'static {
    /// `LANES` times `i16`.
    type V: Copy;
    /// `BYTES` times `u8`.
    type B: Copy;
    /// Lanes in a vector of costs: a divisor of 32.
    const LANES: usize;
    const BYTES: usize = 2 * Self::LANES;

    /// Reads values.
    ///
    /// # Safety
    /// `LANES` of them can be read from `from` on.
    unsafe fn load(from: *const i16) -> Self::V;
    /// Writes values.
    ///
    /// # Safety
    /// `LANES` of them can be written from `to` on.
    unsafe fn store(to: *mut i16, v: Self::V);
    fn splat(v: i16) -> Self::V;
    /// Wrapping sum.
    fn add(a: Self::V, b: Self::V) -> Self::V;
    /// Wrapping difference.
    fn sub(a: Self::V, b: Self::V) -> Self::V;
    /// Saturating sum.
    fn add_saturating(a: Self::V, b: Self::V) -> Self::V;
    fn min(a: Self::V, b: Self::V) -> Self::V;
    /// Lanes of `x` where `a` is less than `b`, of `y` elsewhere.
    fn where_less(a: Self::V, b: Self::V, x: Self::V, y: Self::V) -> Self::V;
    /// Each lane's predecessor in `(before, v)`.
    fn below(before: Self::V, v: Self::V) -> Self::V;
    /// Each lane's successor in `(v, after)`.
    fn above(v: Self::V, after: Self::V) -> Self::V;
    /// The smallest lane, in all lanes. No lane may be negative.
    fn minimum(v: Self::V) -> Self::V;
    fn first(v: Self::V) -> i16;
    /// Bit `i`: whether the `i`-th of 32 values equals the lanes of `v`, which are all the same.
    ///
    /// # Safety
    /// 32 values can be read from `from` on.
    unsafe fn equal_bits(from: *const i16, v: Self::V) -> u32;
    /// Bit `i`: whether the `i`-th of 32 values is less.
    ///
    /// # Safety
    /// 32 values can be read from `from` on.
    unsafe fn less_bits(from: *const i16, v: Self::V) -> u32;
    /// Reads bytes as values.
    ///
    /// # Safety
    /// `LANES` bytes can be read from `from` on.
    unsafe fn load_widened(from: *const u8) -> Self::V;

    /// Reads bytes.
    ///
    /// # Safety
    /// `BYTES` bytes can be read from `from` on.
    unsafe fn load_bytes(from: *const u8) -> Self::B;
    /// Writes bytes.
    ///
    /// # Safety
    /// `BYTES` bytes can be written from `to` on.
    unsafe fn store_bytes(to: *mut u8, b: Self::B);
    fn splat_bytes(b: u8) -> Self::B;
    /// Wrapping sum.
    fn add_bytes(a: Self::B, b: Self::B) -> Self::B;
    /// Difference, not below 0.
    fn sub_bytes(a: Self::B, b: Self::B) -> Self::B;
    fn min_bytes(a: Self::B, b: Self::B) -> Self::B;
    fn max_bytes(a: Self::B, b: Self::B) -> Self::B;
    /// A quarter, rounded down.
    fn quarter_bytes(a: Self::B) -> Self::B;
    /// The lower and the upper half as values.
    fn widen(b: Self::B) -> [Self::V; 2];
}

#[derive(Clone, Copy)]
pub(in crate::stereo) struct Portable;

#[inline(always)]
fn zip<T: Copy, const N: usize>(a: [T; N], b: [T; N], f: impl Fn(T, T) -> T) -> [T; N] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

#[inline(always)]
unsafe fn bits(from: *const i16, test: impl Fn(i16) -> bool) -> u32 {
    // SAFETY: the caller vouches for 32 values.
    let values = unsafe { from.cast::<[i16; COMPARED]>().read_unaligned() };
    (0..COMPARED).fold(0, |bits, i| bits | u32::from(test(values[i])) << i)
}

impl Lanes for Portable {
    type V = [i16; LANES];
    type B = [u8; BYTES];
    const LANES: usize = LANES;

    #[inline(always)]
    unsafe fn load(from: *const i16) -> Self::V {
        // SAFETY: the caller vouches for 16 values.
        unsafe { from.cast::<Self::V>().read_unaligned() }
    }
    #[inline(always)]
    unsafe fn store(to: *mut i16, v: Self::V) {
        // SAFETY: the caller vouches for 16 values.
        unsafe { to.cast::<Self::V>().write_unaligned(v) }
    }
    #[inline(always)]
    fn splat(v: i16) -> Self::V {
        [v; LANES]
    }
    #[inline(always)]
    fn add(a: Self::V, b: Self::V) -> Self::V {
        zip(a, b, i16::wrapping_add)
    }
    #[inline(always)]
    fn sub(a: Self::V, b: Self::V) -> Self::V {
        zip(a, b, i16::wrapping_sub)
    }
    #[inline(always)]
    fn add_saturating(a: Self::V, b: Self::V) -> Self::V {
        zip(a, b, i16::saturating_add)
    }
    #[inline(always)]
    fn min(a: Self::V, b: Self::V) -> Self::V {
        zip(a, b, i16::min)
    }
    #[inline(always)]
    fn where_less(a: Self::V, b: Self::V, x: Self::V, y: Self::V) -> Self::V {
        std::array::from_fn(|i| if a[i] < b[i] { x[i] } else { y[i] })
    }
    #[inline(always)]
    fn below(before: Self::V, v: Self::V) -> Self::V {
        std::array::from_fn(|i| if i == 0 { before[LANES - 1] } else { v[i - 1] })
    }
    #[inline(always)]
    fn above(v: Self::V, after: Self::V) -> Self::V {
        std::array::from_fn(|i| if i == LANES - 1 { after[0] } else { v[i + 1] })
    }
    #[inline(always)]
    fn minimum(v: Self::V) -> Self::V {
        [v.into_iter().fold(i16::MAX, i16::min); LANES]
    }
    #[inline(always)]
    fn first(v: Self::V) -> i16 {
        v[0]
    }
    #[inline(always)]
    unsafe fn equal_bits(from: *const i16, v: Self::V) -> u32 {
        // SAFETY: the caller vouches for 32 values.
        unsafe { bits(from, |x| x == v[0]) }
    }
    #[inline(always)]
    unsafe fn less_bits(from: *const i16, v: Self::V) -> u32 {
        // SAFETY: the caller vouches for 32 values.
        unsafe { bits(from, |x| x < v[0]) }
    }
    #[inline(always)]
    unsafe fn load_widened(from: *const u8) -> Self::V {
        // SAFETY: the caller vouches for 16 bytes.
        unsafe { from.cast::<[u8; LANES]>().read_unaligned() }.map(i16::from)
    }
    #[inline(always)]
    unsafe fn load_bytes(from: *const u8) -> Self::B {
        // SAFETY: the caller vouches for 32 bytes.
        unsafe { from.cast::<Self::B>().read_unaligned() }
    }
    #[inline(always)]
    unsafe fn store_bytes(to: *mut u8, b: Self::B) {
        // SAFETY: the caller vouches for 32 bytes.
        unsafe { to.cast::<Self::B>().write_unaligned(b) }
    }
    #[inline(always)]
    fn splat_bytes(b: u8) -> Self::B {
        [b; BYTES]
    }
    #[inline(always)]
    fn add_bytes(a: Self::B, b: Self::B) -> Self::B {
        zip(a, b, u8::wrapping_add)
    }
    #[inline(always)]
    fn sub_bytes(a: Self::B, b: Self::B) -> Self::B {
        zip(a, b, u8::saturating_sub)
    }
    #[inline(always)]
    fn min_bytes(a: Self::B, b: Self::B) -> Self::B {
        zip(a, b, u8::min)
    }
    #[inline(always)]
    fn max_bytes(a: Self::B, b: Self::B) -> Self::B {
        zip(a, b, u8::max)
    }
    #[inline(always)]
    fn quarter_bytes(a: Self::B) -> Self::B {
        a.map(|b| b >> 2)
    }
    #[inline(always)]
    fn widen(b: Self::B) -> [Self::V; 2] {
        [std::array::from_fn(|i| i16::from(b[i])), std::array::from_fn(|i| i16::from(b[LANES + i]))]
    }
}

/// Bits of up to 64 sums from `at`: whether they equal `v`, or are less.
///
/// # Safety
/// The instruction set of `L` must be present; from `at` on there are whole groups of [`COMPARED`] sums.
#[inline(always)]
pub(in crate::stereo) unsafe fn compare<L: Lanes, const EQUAL: bool>(sums: &[i16], at: usize, v: L::V) -> u64 {
    // SAFETY: as the caller guarantees.
    unsafe {
        let first = sums.as_ptr().add(at);
        let low = compared::<L, EQUAL>(first, v);
        let high = if at + COMPARED < sums.len() { compared::<L, EQUAL>(first.add(COMPARED), v) } else { 0 };
        u64::from(high) << COMPARED | u64::from(low)
    }
}

/// # Safety
/// [`COMPARED`] values can be read from `from` on, and the instruction set of `L` must be present.
#[inline(always)]
unsafe fn compared<L: Lanes, const EQUAL: bool>(from: *const i16, v: L::V) -> u32 {
    // SAFETY: as the caller guarantees.
    unsafe { if EQUAL { L::equal_bits(from, v) } else { L::less_bits(from, v) } }
}

/// Bits `index - 1`, `index` and `index + 1`, those of them in 0..64.
#[inline(always)]
pub(in crate::stereo) fn near_bits(index: i32) -> u64 {
    match index {
        -1 => 1,
        0..64 => ((0b111_u128 << index) >> 1) as u64,
        64 => 1 << 63,
        _ => 0,
    }
}
