//! Sixteen floats with fused multiply-add, for sums of products.
//!
//! A fused multiply-add rounds once: every instruction set must have it or imitate it, so that all give the same bits.
//! The portable twin calls the platform's `fma`, which is exact everywhere and slow without hardware support.
#![expect(unsafe_code, reason = "vector instructions, inside functions compiled for them")]

pub(crate) const LANES: usize = 16;

/// [`LANES`] floats. The operations are those of the scalars, lane by lane.
pub(crate) trait Lanes: Copy {
    /// Accumulators of this type that registers hold beside their operands, as rows by columns of a product's tile.
    const TILE: (usize, usize);

    fn splat(value: f32) -> Self;
    /// The samples, lane by lane.
    ///
    /// # Safety
    /// [`LANES`] floats can be read from `from` on.
    unsafe fn load(from: *const f32) -> Self;
    /// Writes the samples, lane by lane.
    ///
    /// # Safety
    /// [`LANES`] floats can be written from `to` on.
    unsafe fn store(self, to: *mut f32);
    /// `self + a * b`, rounded once.
    fn plus_product(self, a: Self, b: Self) -> Self;

    /// `self + other`.
    fn plus(self, other: Self) -> Self;
    /// `max(self, 0)`, and 0 of what is not a number.
    fn positive(self) -> Self;

    /// The sum of all lanes: halves are added until one is left.
    #[inline(always)]
    fn sum(self) -> f32 {
        let mut lanes = [0.0; LANES];
        // SAFETY: the array has as many floats.
        unsafe { self.store(lanes.as_mut_ptr()) };
        let mut half = LANES / 2;
        while half > 0 {
            for i in 0..half {
                lanes[i] += lanes[i + half];
            }
            half /= 2;
        }
        lanes[0]
    }

    /// [`Lanes::sum`] of each of four.
    #[inline(always)]
    fn sums(vectors: [Self; 4]) -> [f32; 4] {
        vectors.map(Self::sum)
    }
}

#[derive(Clone, Copy)]
pub(super) struct Portable([f32; LANES]);

impl Lanes for Portable {
    const TILE: (usize, usize) = (4, 1);

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller vouches for as many floats, and the read needs no alignment.
        Self(unsafe { from.cast::<[f32; LANES]>().read_unaligned() })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller vouches for as many floats, and the write needs no alignment.
        unsafe { to.cast::<[f32; LANES]>().write_unaligned(self.0) };
    }

    #[inline(always)]
    fn plus_product(mut self, a: Self, b: Self) -> Self {
        for i in 0..LANES {
            self.0[i] = a.0[i].mul_add(b.0[i], self.0[i]);
        }
        self
    }

    #[inline(always)]
    fn plus(mut self, other: Self) -> Self {
        for i in 0..LANES {
            self.0[i] += other.0[i];
        }
        self
    }

    #[inline(always)]
    fn positive(self) -> Self {
        Self(self.0.map(|value| if value > 0.0 { value } else { 0.0 }))
    }
}

#[cfg(target_arch = "x86_64")]
macro_rules! x86_lanes {
    ($name:ident, $vector:ident, $lanes:literal, $tile:expr, $features:literal, $set1:ident, $load:ident, $store:ident, $fma:ident, $add:ident, $max:ident, $sums:ident) => {
        #[doc = concat!("In registers of ", stringify!($lanes), " lanes; only made where ", $features, " was detected.")]
        #[derive(Clone, Copy)]
        pub(super) struct $name([std::arch::x86_64::$vector; LANES / $lanes]);

        impl Lanes for $name {
            const TILE: (usize, usize) = $tile;

            #[inline(always)]
            fn splat(value: f32) -> Self {
                // SAFETY: passes that name this type run at a level where the features were detected.
                Self([unsafe { std::arch::x86_64::$set1(value) }; LANES / $lanes])
            }

            #[inline(always)]
            unsafe fn load(from: *const f32) -> Self {
                // SAFETY: as in `splat`; the caller vouches for the floats, which need no alignment.
                Self(std::array::from_fn(|i| unsafe { std::arch::x86_64::$load(from.add(i * $lanes)) }))
            }

            #[inline(always)]
            unsafe fn store(self, to: *mut f32) {
                for (i, vector) in self.0.into_iter().enumerate() {
                    // SAFETY: as in `splat`; the caller vouches for the floats, which need no alignment.
                    unsafe { std::arch::x86_64::$store(to.add(i * $lanes), vector) };
                }
            }

            #[inline(always)]
            fn plus_product(mut self, a: Self, b: Self) -> Self {
                for i in 0..LANES / $lanes {
                    // SAFETY: as in `splat`.
                    self.0[i] = unsafe { std::arch::x86_64::$fma(a.0[i], b.0[i], self.0[i]) };
                }
                self
            }

            #[inline(always)]
            fn plus(mut self, other: Self) -> Self {
                for i in 0..LANES / $lanes {
                    // SAFETY: as in `splat`.
                    self.0[i] = unsafe { std::arch::x86_64::$add(self.0[i], other.0[i]) };
                }
                self
            }

            #[inline(always)]
            fn positive(mut self) -> Self {
                for i in 0..LANES / $lanes {
                    // The instruction returns its second operand if one is not a number.
                    // SAFETY: as in `splat`.
                    self.0[i] = unsafe { std::arch::x86_64::$max(self.0[i], std::arch::x86_64::$set1(0.0)) };
                }
                self
            }

            #[inline(always)]
            fn sums(vectors: [Self; 4]) -> [f32; 4] {
                let [a, b, c, d] = vectors;
                // SAFETY: as in `splat`.
                unsafe { $sums([a.0, b.0, c.0, d.0]) }
            }
        }
    };
}

/// The sums of four vectors of 16 lanes. Halves are added until one lane is left, of several vectors at once.
///
/// # Safety
/// AVX2 must be present.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn sums_avx2(vectors: [[std::arch::x86_64::__m256; 2]; 4]) -> [f32; 4] {
    use std::arch::x86_64::{
        _mm256_add_ps, _mm256_castpd_ps, _mm256_castps_pd, _mm256_permute_ps, _mm256_permute2f128_ps, _mm256_storeu_ps,
        _mm256_unpackhi_pd, _mm256_unpacklo_pd,
    };
    // SAFETY: as the caller guarantees.
    unsafe {
        let [[a, a_high], [b, b_high], [c, c_high], [d, d_high]] = vectors;
        let (a, b) = (_mm256_add_ps(a, a_high), _mm256_add_ps(b, b_high));
        let (c, d) = (_mm256_add_ps(c, c_high), _mm256_add_ps(d, d_high));
        let ab = _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b));
        let cd = _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(c, d), _mm256_permute2f128_ps::<0x31>(c, d));
        let (ab, cd) = (_mm256_castps_pd(ab), _mm256_castps_pd(cd));
        let (low, high) = (_mm256_unpacklo_pd(ab, cd), _mm256_unpackhi_pd(ab, cd));
        let pairs = _mm256_add_ps(_mm256_castpd_ps(low), _mm256_castpd_ps(high));
        let mut lanes = [0.0; 8];
        _mm256_storeu_ps(lanes.as_mut_ptr(), _mm256_add_ps(pairs, _mm256_permute_ps::<0b10_11_00_01>(pairs)));
        [lanes[0], lanes[4], lanes[2], lanes[6]]
    }
}

/// As [`sums_avx2`].
///
/// # Safety
/// AVX-512F must be present.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn sums_avx512(vectors: [[std::arch::x86_64::__m512; 1]; 4]) -> [f32; 4] {
    use std::arch::x86_64::{_mm512_add_ps, _mm512_permute_ps, _mm512_shuffle_f32x4, _mm512_storeu_ps};
    // SAFETY: as the caller guarantees.
    unsafe {
        let [[a], [b], [c], [d]] = vectors;
        let (low, high) = (_mm512_shuffle_f32x4::<0b01_00_01_00>(a, b), _mm512_shuffle_f32x4::<0b11_10_11_10>(a, b));
        let ab = _mm512_add_ps(low, high);
        let (low, high) = (_mm512_shuffle_f32x4::<0b01_00_01_00>(c, d), _mm512_shuffle_f32x4::<0b11_10_11_10>(c, d));
        let cd = _mm512_add_ps(low, high);
        let quarters =
            _mm512_add_ps(_mm512_shuffle_f32x4::<0b10_00_10_00>(ab, cd), _mm512_shuffle_f32x4::<0b11_01_11_01>(ab, cd));
        let pairs = _mm512_add_ps(quarters, _mm512_permute_ps::<0b01_00_11_10>(quarters));
        let mut lanes = [0.0; LANES];
        _mm512_storeu_ps(lanes.as_mut_ptr(), _mm512_add_ps(pairs, _mm512_permute_ps::<0b10_11_00_01>(pairs)));
        [lanes[0], lanes[4], lanes[8], lanes[12]]
    }
}

#[cfg(target_arch = "x86_64")]
x86_lanes!(
    Avx2,
    __m256,
    8,
    (4, 1),
    "AVX2 and FMA",
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_fmadd_ps,
    _mm256_add_ps,
    _mm256_max_ps,
    sums_avx2
);
#[cfg(target_arch = "x86_64")]
x86_lanes!(
    Avx512,
    __m512,
    16,
    (8, 3),
    "AVX-512F",
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_fmadd_ps,
    _mm512_add_ps,
    _mm512_max_ps,
    sums_avx512
);
