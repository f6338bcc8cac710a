//! Where a kernel meets the instruction set.
//!
//! A kernel's inner loops are a [`Pass`], which a [`Level`] holds compiled for each instruction set. Sums that must
//! stay in registers are a [`BlockPass`] or a [`LanesPass`], with the registers named; `sgbm` and `bm` compile their
//! own passes over vectors of 16-bit costs (`stereo/lanes.rs`), and pick by what the level has. All of them give the
//! same bits, on any machine; `every_level` and the tests of [`Path`]s prove it.
//!
//! Vectors are named only inside of passes that a level runs.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "calls functions compiled for instruction sets that were found at run time")
)]

mod block;
#[cfg(target_arch = "x86_64")]
mod differences;
#[cfg(target_arch = "x86_64")]
mod differences_avx2;
pub(crate) mod differences_plain;
#[cfg(target_arch = "x86_64")]
mod grey;
mod lanes;
mod path;

#[cfg(target_arch = "x86_64")]
use std::marker::PhantomData;

pub use depthloom_simd::Level;
pub(crate) use depthloom_simd::{Pass, prefetch};

pub(crate) use block::{BLOCK, Block};
pub(crate) use lanes::{LANES, Lanes};
pub use path::Path;

use differences_plain::{Apart, Room, Together};

/// A [`Pass`] that holds values in vector registers by name.
pub(crate) trait BlockPass {
    type Output;
    /// The loops; `#[inline(always)]` as in [`Pass`].
    fn run<B: Block>(self) -> Self::Output;
}

pub(crate) trait LanesPass {
    type Output;
    /// The loops; `#[inline(always)]` as in [`Pass`].
    fn run<L: Lanes>(self) -> Self::Output;
}

/// Grey of as many leading pixels as vectors make; returns how many these are. The rest is the caller's.
pub(crate) fn grey_from_leading(level: Level, rgb: &[u8], out: &mut [u8]) -> usize {
    #[cfg(target_arch = "x86_64")]
    if level.has_avx2() {
        // SAFETY: the level was made where AVX2 was detected.
        return unsafe { grey::grey_avx2(rgb, out) };
    }
    let _ = (level, rgb, out);
    0
}

pub(crate) fn differences_of(level: Level, blocks: &[[f32; differences_plain::BLOCK]], room: &mut Room) {
    #[cfg(target_arch = "x86_64")]
    if level.has_avx512_vbmi2() {
        // SAFETY: the level was made where every feature named at `apart` was detected.
        return unsafe { differences::apart(blocks, room) };
    }
    level.run(Apart(blocks, room));
}

/// Puts blocks of samples together again; `None` if their parts end before.
pub(crate) fn samples_of(level: Level, room: &mut Room, blocks: &mut [[f32; differences_plain::BLOCK]]) -> Option<()> {
    #[cfg(target_arch = "x86_64")]
    if level.has_avx512_vbmi2() {
        // SAFETY: the level was made where every feature named at `together` was detected.
        return unsafe { differences::together(room, blocks) };
    } else if level.has_avx2() {
        // SAFETY: the level was made where AVX2 was detected.
        return unsafe { differences_avx2::together(room, blocks) };
    }
    level.run(Together(room, blocks))
}

#[inline]
pub(crate) fn run_blocks<P: BlockPass>(level: Level, pass: P) -> P::Output {
    #[cfg(target_arch = "x86_64")]
    if level.has_avx512() {
        return level.run(With::<P, block::Avx512>(pass, PhantomData));
    } else if level.has_avx2() {
        return level.run(With::<P, block::Avx2>(pass, PhantomData));
    } else if level.has_sse2() {
        return level.run(With::<P, block::Sse2>(pass, PhantomData));
    }
    let _ = level;
    pass.run::<block::Portable>()
}

#[inline]
pub(crate) fn run_lanes<P: LanesPass>(level: Level, pass: P) -> P::Output {
    #[cfg(target_arch = "x86_64")]
    if level.has_avx512() {
        return level.run(WithLanes::<P, lanes::Avx512>(pass, PhantomData));
    } else if level.has_avx2() {
        return level.run(WithLanes::<P, lanes::Avx2>(pass, PhantomData));
    }
    let _ = level;
    pass.run::<lanes::Portable>()
}

#[cfg(target_arch = "x86_64")]
struct With<P, B>(P, PhantomData<B>);

#[cfg(target_arch = "x86_64")]
impl<P: BlockPass, B: Block> Pass for With<P, B> {
    type Output = P::Output;

    #[inline(always)]
    fn run(self) -> P::Output {
        self.0.run::<B>()
    }
}

#[cfg(target_arch = "x86_64")]
struct WithLanes<P, L>(P, PhantomData<L>);

#[cfg(target_arch = "x86_64")]
impl<P: LanesPass, L: Lanes> Pass for WithLanes<P, L> {
    type Output = P::Output;

    #[inline(always)]
    fn run(self) -> P::Output {
        self.0.run::<L>()
    }
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
