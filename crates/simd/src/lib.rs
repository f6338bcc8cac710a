//! The one place that asks the machine for its instruction sets.
//!
//! Inner loops are a [`Pass`]: safe Rust that the compiler vectorises. [`Level::run`] holds that same source compiled
//! for every machine, for AVX2 and for AVX-512, and picks one at run time. Rust neither reorders nor contracts
//! floating-point operations, so all of them give the same bits, on any machine.
//!
//! A [`Level`] is made by [`Level::available`] alone, so who holds one has seen its features.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "calls functions compiled for instruction sets that were found at run time")
)]

use std::sync::OnceLock;

/// An instruction set that this machine was seen to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(Set);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Set {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Sse2,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX-512 that counts bits, and permutes and compresses bytes, in vectors.
    #[cfg(target_arch = "x86_64")]
    Avx512Popcnt,
    #[cfg(target_arch = "aarch64")]
    Neon,
}

/// Inner loops that are compiled once per instruction set.
///
/// `run`, and what it calls in its loops, must be `#[inline(always)]`: code that stays a function of its own is
/// compiled for every machine only.
pub trait Pass {
    /// What the loops compute.
    type Output;
    /// The loops.
    fn run(self) -> Self::Output;
}

impl Level {
    /// What the compiler makes of plain Rust for any machine of the target.
    pub const PORTABLE: Self = Self(Set::Portable);

    /// The widest instruction set of this machine.
    ///
    /// The environment variable `DEPTHLOOM_SIMD` (`portable`, `sse2`, `avx2`, `avx512`; `neon`) holds it down for all
    /// kernels and metrics, for measuring: the results are the same. Any other value leaves it as it is.
    #[must_use]
    pub fn best() -> Self {
        static BEST: OnceLock<Level> = OnceLock::new();
        *BEST.get_or_init(|| {
            let wanted = std::env::var("DEPTHLOOM_SIMD").unwrap_or_default();
            let all = Self::available();
            all.iter().copied().find(|level| level.name() == wanted).unwrap_or(all[all.len() - 1])
        })
    }

    /// Every level this machine can run, narrowest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        let mut levels = vec![Self::PORTABLE];
        #[cfg(target_arch = "x86_64")]
        {
            levels.push(Self(Set::Sse2)); // part of x86-64
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("fma")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt");
            if avx2 {
                levels.push(Self(Set::Avx2));
            }
            let avx512 = avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512cd")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if avx512 {
                levels.push(Self(Set::Avx512));
            }
            if avx512
                && is_x86_feature_detected!("avx512vbmi")
                && is_x86_feature_detected!("avx512vbmi2")
                && is_x86_feature_detected!("avx512bitalg")
                && is_x86_feature_detected!("avx512vpopcntdq")
            {
                levels.push(Self(Set::Avx512Popcnt));
            }
        }
        #[cfg(target_arch = "aarch64")]
        levels.push(Self(Set::Neon)); // part of aarch64
        levels
    }

    /// The level of a name, if this machine has it; `best` is [`Level::best`].
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        if name == "best" {
            Some(Self::best())
        } else {
            Self::available().into_iter().find(|level| level.name() == name)
        }
    }

    /// `portable`, `sse2`, `avx2`, `avx512` or `avx512-popcnt`; on ARM `portable` or `neon`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self.0 {
            Set::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Set::Sse2 => "sse2",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Set::Avx512Popcnt => "avx512-popcnt",
            #[cfg(target_arch = "aarch64")]
            Set::Neon => "neon",
        }
    }

    /// Runs the loops as compiled for this level.
    #[inline]
    pub fn run<P: Pass>(self, pass: P) -> P::Output {
        match self.0 {
            Set::Portable => pass.run(),
            #[cfg(target_arch = "x86_64")]
            Set::Sse2 => pass.run(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: only `available` makes this level, where every feature named at `avx2` was detected.
            Set::Avx2 => unsafe { avx2(pass) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: only `available` makes these levels, where every feature named at `avx512` was detected.
            Set::Avx512 | Set::Avx512Popcnt => unsafe { avx512(pass) },
            #[cfg(target_arch = "aarch64")]
            Set::Neon => pass.run(),
        }
    }

    /// [`Level::run`] for passes that count bits: with wide vectors only where these count bits themselves.
    #[inline]
    pub fn run_counting<P: Pass>(self, pass: P) -> P::Output {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: only `available` makes this level, where every feature named at `avx512_popcnt` was detected.
            Set::Avx512Popcnt => unsafe { avx512_popcnt(pass) },
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => Self(Set::Avx2).run(pass),
            _ => self.run(pass),
        }
    }

    /// Whether it has AVX2, FMA, and the instructions for bits (BMI1, BMI2, LZCNT, POPCNT).
    #[must_use]
    pub const fn has_avx2(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return matches!(self.0, Set::Avx2 | Set::Avx512 | Set::Avx512Popcnt);
        #[cfg(not(target_arch = "x86_64"))]
        return false;
    }

    /// Whether it has AVX-512 F, BW, CD, DQ and VL besides.
    #[must_use]
    pub const fn has_avx512(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return matches!(self.0, Set::Avx512 | Set::Avx512Popcnt);
        #[cfg(not(target_arch = "x86_64"))]
        return false;
    }

    /// Whether it has AVX-512 VBMI, VBMI2, BITALG and VPOPCNTDQ besides.
    #[must_use]
    pub const fn has_avx512_vbmi2(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return matches!(self.0, Set::Avx512Popcnt);
        #[cfg(not(target_arch = "x86_64"))]
        return false;
    }

    /// Whether it has NEON, and is more than what the compiler makes of plain Rust.
    #[must_use]
    pub const fn has_neon(self) -> bool {
        #[cfg(target_arch = "aarch64")]
        return matches!(self.0, Set::Neon);
        #[cfg(not(target_arch = "aarch64"))]
        return false;
    }

    /// Whether it has the vectors of four floats that are part of every processor of this kind (SSE2), and is more than
    /// what the compiler makes of plain Rust.
    #[must_use]
    pub const fn has_sse2(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return !matches!(self.0, Set::Portable);
        #[cfg(not(target_arch = "x86_64"))]
        return false;
    }
}

/// Asks the cache for `count` samples from `start` on, as far as they are in the slice: for loops that jump from place
/// to place, which the processor does not foresee.
#[inline(always)]
pub fn prefetch<T>(samples: &[T], start: usize, count: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        const LINE: usize = 64;
        for sample in (start..start + count).step_by(LINE / size_of::<T>()) {
            if let Some(sample) = samples.get(sample) {
                // SAFETY: a prefetch reads nothing; the address is that of a sample, and SSE is part of x86-64.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(sample).cast()) };
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (samples, start, count);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<P: Pass>(pass: P) -> P::Output {
    pass.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512bw,avx512cd,avx512dq,avx512vl")]
fn avx512<P: Pass>(pass: P) -> P::Output {
    pass.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(
    enable = "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512bitalg,avx512vpopcntdq"
)]
fn avx512_popcnt<P: Pass>(pass: P) -> P::Output {
    pass.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_level_is_available_and_portable_always_is() {
        let levels = Level::available();
        assert_eq!(levels[0], Level::PORTABLE);
        assert!(levels.contains(&Level::best()));
    }
}
