//! Sixty-four floats in vector registers.
//!
//! For sums that must stay in registers over a long loop: whether the compiler keeps an array there hangs on details
//! far away from the loop, so here the vectors are named.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "vector instructions, inside functions compiled for them")
)]

pub(crate) const BLOCK: usize = 64;

/// [`BLOCK`] floats. The operations are those of the scalars, lane by lane.
pub(crate) trait Block: Copy {
    fn zero() -> Self;
    fn load(from: &[f32; BLOCK]) -> Self;
    fn store(self, to: &mut [f32; BLOCK]);
    fn plus(self, other: Self) -> Self;
    fn times(self, factor: f32) -> Self;
}

#[derive(Clone, Copy)]
pub(super) struct Portable([f32; BLOCK]);

impl Block for Portable {
    #[inline(always)]
    fn zero() -> Self {
        Self([0.0; BLOCK])
    }

    #[inline(always)]
    fn load(from: &[f32; BLOCK]) -> Self {
        Self(*from)
    }

    #[inline(always)]
    fn store(self, to: &mut [f32; BLOCK]) {
        *to = self.0;
    }

    #[inline(always)]
    fn plus(mut self, other: Self) -> Self {
        for (a, b) in self.0.iter_mut().zip(other.0) {
            *a += b;
        }
        self
    }

    #[inline(always)]
    fn times(mut self, factor: f32) -> Self {
        for a in &mut self.0 {
            *a *= factor;
        }
        self
    }
}

#[cfg(target_arch = "x86_64")]
macro_rules! x86_block {
    ($name:ident, $vector:ident, $lanes:literal, $features:literal, $set1:ident, $load:ident, $store:ident, $add:ident, $mul:ident) => {
        #[doc = concat!("In registers of ", stringify!($lanes), " lanes; only made where ", $features, " was detected.")]
        #[derive(Clone, Copy)]
        pub(super) struct $name([std::arch::x86_64::$vector; BLOCK / $lanes]);

        impl Block for $name {
            #[inline(always)]
            fn zero() -> Self {
                // SAFETY: passes that name this type run at a level where the features were detected.
                Self([unsafe { std::arch::x86_64::$set1(0.0) }; BLOCK / $lanes])
            }

            #[inline(always)]
            fn load(from: &[f32; BLOCK]) -> Self {
                let mut block = Self::zero();
                // Not by a closure: where it is not inlined, it cannot inline the load.
                for (vector, part) in block.0.iter_mut().zip(from.as_chunks::<$lanes>().0) {
                    // SAFETY: as in `zero`; the part has as many samples as are read, and needs no alignment.
                    *vector = unsafe { std::arch::x86_64::$load(part.as_ptr()) };
                }
                block
            }

            #[inline(always)]
            fn store(self, to: &mut [f32; BLOCK]) {
                for (part, vector) in to.as_chunks_mut::<$lanes>().0.iter_mut().zip(self.0) {
                    // SAFETY: as in `zero`; the part has as many samples as are written, and needs no alignment.
                    unsafe { std::arch::x86_64::$store(part.as_mut_ptr(), vector) };
                }
            }

            #[inline(always)]
            fn plus(mut self, other: Self) -> Self {
                for (a, b) in self.0.iter_mut().zip(other.0) {
                    // SAFETY: as in `zero`.
                    *a = unsafe { std::arch::x86_64::$add(*a, b) };
                }
                self
            }

            #[inline(always)]
            fn times(mut self, factor: f32) -> Self {
                // SAFETY: as in `zero`.
                let factor = unsafe { std::arch::x86_64::$set1(factor) };
                for a in &mut self.0 {
                    // SAFETY: as in `zero`.
                    *a = unsafe { std::arch::x86_64::$mul(*a, factor) };
                }
                self
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
x86_block!(Sse2, __m128, 4, "SSE2", _mm_set1_ps, _mm_loadu_ps, _mm_storeu_ps, _mm_add_ps, _mm_mul_ps);
#[cfg(target_arch = "x86_64")]
x86_block!(Avx2, __m256, 8, "AVX2", _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps, _mm256_mul_ps);
#[cfg(target_arch = "x86_64")]
x86_block!(
    Avx512,
    __m512,
    16,
    "AVX-512F",
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_add_ps,
    _mm512_mul_ps
);
