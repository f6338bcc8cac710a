//! The one place where a kernel meets the instruction set.
//!
//! A kernel's inner loops are a [`Pass`]: safe Rust that the compiler vectorises. [`Level::run`] holds that same source
//! compiled three times (for every machine, for AVX2, for AVX-512) and picks one at run time. Rust neither reorders
//! nor contracts floating-point operations, so all three give the same bits, on any machine; `every_level` lets the
//! tests prove it.
#![expect(unsafe_code, reason = "calls functions compiled for instruction sets that were found at run time")]

use std::sync::OnceLock;

/// An instruction set that this machine was seen to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(Set);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Set {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// Inner loops that are compiled once per instruction set.
///
/// `run`, and what it calls in its loops, must be `#[inline(always)]`: code that stays a function of its own is
/// compiled for every machine only.
pub(crate) trait Pass {
    /// What the loops return.
    type Output;
    /// The loops.
    fn run(self) -> Self::Output;
}

impl Level {
    /// What the compiler's own target guarantees; on x86-64 that is SSE2.
    pub const PORTABLE: Self = Self(Set::Portable);

    /// The widest instruction set of this machine.
    ///
    /// The environment variable `DEPTHLOOM_SIMD` (`portable`, `avx2`) holds it down, for measuring: the results are
    /// the same.
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
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("fma")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt");
            if avx2 {
                levels.push(Self(Set::Avx2));
            }
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512cd")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                levels.push(Self(Set::Avx512));
            }
        }
        levels
    }

    /// `portable`, `avx2` or `avx512`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self.0 {
            Set::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => "avx512",
        }
    }

    /// Runs the copy of `pass` that was compiled for this level.
    #[inline]
    pub(crate) fn run<P: Pass>(self, pass: P) -> P::Output {
        match self.0 {
            Set::Portable => pass.run(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: only `available` makes this level, where every feature named at `avx2` was detected.
            Set::Avx2 => unsafe { avx2(pass) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: only `available` makes this level, where every feature named at `avx512` was detected.
            Set::Avx512 => unsafe { avx512(pass) },
        }
    }
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

/// Runs `kernel` at every level of this machine and demands the same result of all.
#[cfg(test)]
pub(crate) fn every_level<T: PartialEq + std::fmt::Debug>(kernel: impl Fn(Level) -> T) -> T {
    let expected = kernel(Level::PORTABLE);
    for level in Level::available() {
        assert!(kernel(level) == expected, "{} differs from portable", level.name());
    }
    expected
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
