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
}

#[cfg(target_arch = "x86_64")]
macro_rules! x86_lanes {
    ($name:ident, $vector:ident, $lanes:literal, $tile:expr, $features:literal, $set1:ident, $load:ident, $store:ident, $fma:ident) => {
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
        }
    };
}

#[cfg(target_arch = "x86_64")]
x86_lanes!(Avx2, __m256, 8, (4, 1), "AVX2 and FMA", _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_fmadd_ps);
#[cfg(target_arch = "x86_64")]
x86_lanes!(Avx512, __m512, 16, (8, 3), "AVX-512F", _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_fmadd_ps);
