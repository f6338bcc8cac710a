//! What the fast kernels need of an instruction set: sixteen 16-bit lanes, and 32 bytes.
//!
//! The kernels are written once over [`Lanes`]. [`Portable`] is plain Rust: it runs on every machine and under Miri, and
//! the compiler vectorises most of it; [`super::avx2::Avx2`] names the instructions.

/// Lanes in a vector of costs.
pub(super) const LANES: usize = 16;

/// Bytes in a vector of pixel values.
pub(super) const BYTES: usize = 32;

/// The operations of an instruction set.
///
/// # Safety
/// Every function may only be called where the instruction set is present; pointers must be valid for what the name
/// says, at any alignment.
pub(super) unsafe trait Lanes: Copy + 'static {
    /// Sixteen `i16`.
    type V: Copy;
    /// Thirty-two `u8`.
    type B: Copy;

    /// Reads 16 values.
    unsafe fn load(from: *const i16) -> Self::V;
    /// Writes 16 values.
    unsafe fn store(to: *mut i16, v: Self::V);
    /// All lanes `v`.
    unsafe fn splat(v: i16) -> Self::V;
    /// Wrapping sum.
    unsafe fn add(a: Self::V, b: Self::V) -> Self::V;
    /// Wrapping difference.
    unsafe fn sub(a: Self::V, b: Self::V) -> Self::V;
    /// Saturating sum.
    unsafe fn add_saturating(a: Self::V, b: Self::V) -> Self::V;
    /// Smaller lane.
    unsafe fn min(a: Self::V, b: Self::V) -> Self::V;
    /// The upper half of `a`, then the lower half of `b`.
    unsafe fn straddle(a: Self::V, b: Self::V) -> Self::V;
    /// Each lane's predecessor in `(before, v)`, given `straddle(before, v)`.
    unsafe fn below(straddle: Self::V, v: Self::V) -> Self::V;
    /// Each lane's successor in `(v, after)`, given `straddle(v, after)`.
    unsafe fn above(v: Self::V, straddle: Self::V) -> Self::V;
    /// The smallest lane, in all lanes. No lane may be negative.
    unsafe fn minimum(v: Self::V) -> Self::V;
    /// Lane 0.
    unsafe fn first(v: Self::V) -> i16;
    /// Bit `i` (`16 + i`): whether lane `i` of `a` (of `b`) equals that of `v`.
    unsafe fn equal_bits(a: Self::V, b: Self::V, v: Self::V) -> u32;
    /// Bit `i` (`16 + i`): whether lane `i` of `a` (of `b`) is less than that of `v`.
    unsafe fn less_bits(a: Self::V, b: Self::V, v: Self::V) -> u32;
    /// Reads 16 bytes as 16 values.
    unsafe fn load_widened(from: *const u8) -> Self::V;

    /// Reads 32 bytes.
    unsafe fn load_bytes(from: *const u8) -> Self::B;
    /// Writes 32 bytes.
    unsafe fn store_bytes(to: *mut u8, b: Self::B);
    /// All bytes `b`.
    unsafe fn splat_bytes(b: u8) -> Self::B;
    /// Wrapping sum.
    unsafe fn add_bytes(a: Self::B, b: Self::B) -> Self::B;
    /// Difference, not below 0.
    unsafe fn sub_bytes(a: Self::B, b: Self::B) -> Self::B;
    /// Smaller byte.
    unsafe fn min_bytes(a: Self::B, b: Self::B) -> Self::B;
    /// Larger byte.
    unsafe fn max_bytes(a: Self::B, b: Self::B) -> Self::B;
    /// A quarter, rounded down.
    unsafe fn quarter_bytes(a: Self::B) -> Self::B;
    /// The lower and the upper 16 bytes as values.
    unsafe fn widen(b: Self::B) -> [Self::V; 2];
}

/// No instruction set assumed.
#[derive(Clone, Copy)]
pub(super) struct Portable;

#[inline(always)]
fn zip<T: Copy, const N: usize>(a: [T; N], b: [T; N], f: impl Fn(T, T) -> T) -> [T; N] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

#[inline(always)]
fn bits(a: [i16; LANES], b: [i16; LANES], test: impl Fn(i16, usize) -> bool) -> u32 {
    let half = |v: [i16; LANES]| (0..LANES).fold(0, |bits, i| bits | u32::from(test(v[i], i)) << i);
    half(a) | half(b) << LANES
}

// SAFETY: plain Rust runs everywhere; pointers are read and written unaligned.
unsafe impl Lanes for Portable {
    type V = [i16; LANES];
    type B = [u8; BYTES];

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
    unsafe fn splat(v: i16) -> Self::V {
        [v; LANES]
    }
    #[inline(always)]
    unsafe fn add(a: Self::V, b: Self::V) -> Self::V {
        zip(a, b, i16::wrapping_add)
    }
    #[inline(always)]
    unsafe fn sub(a: Self::V, b: Self::V) -> Self::V {
        zip(a, b, i16::wrapping_sub)
    }
    #[inline(always)]
    unsafe fn add_saturating(a: Self::V, b: Self::V) -> Self::V {
        zip(a, b, i16::saturating_add)
    }
    #[inline(always)]
    unsafe fn min(a: Self::V, b: Self::V) -> Self::V {
        zip(a, b, i16::min)
    }
    #[inline(always)]
    unsafe fn straddle(a: Self::V, b: Self::V) -> Self::V {
        std::array::from_fn(|i| if i < 8 { a[8 + i] } else { b[i - 8] })
    }
    #[inline(always)]
    unsafe fn below(straddle: Self::V, v: Self::V) -> Self::V {
        std::array::from_fn(|i| if i == 0 { straddle[7] } else { v[i - 1] })
    }
    #[inline(always)]
    unsafe fn above(v: Self::V, straddle: Self::V) -> Self::V {
        std::array::from_fn(|i| if i == 15 { straddle[8] } else { v[i + 1] })
    }
    #[inline(always)]
    unsafe fn minimum(v: Self::V) -> Self::V {
        [v.into_iter().fold(i16::MAX, i16::min); LANES]
    }
    #[inline(always)]
    unsafe fn first(v: Self::V) -> i16 {
        v[0]
    }
    #[inline(always)]
    unsafe fn equal_bits(a: Self::V, b: Self::V, v: Self::V) -> u32 {
        bits(a, b, |x, i| x == v[i])
    }
    #[inline(always)]
    unsafe fn less_bits(a: Self::V, b: Self::V, v: Self::V) -> u32 {
        bits(a, b, |x, i| x < v[i])
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
    unsafe fn splat_bytes(b: u8) -> Self::B {
        [b; BYTES]
    }
    #[inline(always)]
    unsafe fn add_bytes(a: Self::B, b: Self::B) -> Self::B {
        zip(a, b, u8::wrapping_add)
    }
    #[inline(always)]
    unsafe fn sub_bytes(a: Self::B, b: Self::B) -> Self::B {
        zip(a, b, u8::saturating_sub)
    }
    #[inline(always)]
    unsafe fn min_bytes(a: Self::B, b: Self::B) -> Self::B {
        zip(a, b, u8::min)
    }
    #[inline(always)]
    unsafe fn max_bytes(a: Self::B, b: Self::B) -> Self::B {
        zip(a, b, u8::max)
    }
    #[inline(always)]
    unsafe fn quarter_bytes(a: Self::B) -> Self::B {
        a.map(|b| b >> 2)
    }
    #[inline(always)]
    unsafe fn widen(b: Self::B) -> [Self::V; 2] {
        [std::array::from_fn(|i| i16::from(b[i])), std::array::from_fn(|i| i16::from(b[LANES + i]))]
    }
}
