//! The inner loops, compiled for what this machine can do.
//!
//! They are safe Rust over chunks of fixed length, which the compiler turns into vectors; beyond [`crate::simd::Level`],
//! AVX-512 here means a machine that counts bits in vectors (`VPOPCNTDQ`, `BITALG`).
#![expect(unsafe_code, reason = "calls functions compiled for instruction sets that were found at run time")]

use crate::simd::Pass;

/// An instruction set that this machine was seen to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Set(Name);

/// Names of instruction sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Name {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Set {
    /// Those of this machine, widest first.
    pub fn available() -> Vec<Self> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt");
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512vbmi")
                && is_x86_feature_detected!("avx512bitalg")
                && is_x86_feature_detected!("avx512vpopcntdq")
            {
                sets.push(Self(Name::Avx512));
            }
            if avx2 {
                sets.push(Self(Name::Avx2));
            }
        }
        sets.push(Self(Name::Portable));
        sets
    }

    /// Its name.
    pub fn name(self) -> Name {
        self.0
    }

    /// Runs the copy of `pass` that was compiled for this set.
    #[inline]
    pub fn run<P: Pass>(self, pass: P) -> P::Output {
        match self.0 {
            Name::Portable => pass.run(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: only `available` makes this set, where every feature named at `avx2` was detected.
            Name::Avx2 => unsafe { avx2(pass) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: only `available` makes this set, where every feature named at `avx512` was detected.
            Name::Avx512 => unsafe { avx512(pass) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<P: Pass>(pass: P) -> P::Output {
    pass.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(
    enable = "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx512bitalg,avx512vpopcntdq"
)]
fn avx512<P: Pass>(pass: P) -> P::Output {
    pass.run()
}
