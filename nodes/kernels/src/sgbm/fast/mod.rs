//! The fast implementations: costs of 16 candidates at a time, bands of rows that stay in cache, pieces for all threads.
//!
//! They rely on 16-bit costs that never saturate ([`fits`]), so that sums may be taken in any order; what could saturate
//! goes to the plain twin. Only the sum over the directions may reach 32767, where adding numbers that are not negative
//! gives the same in any order.
#![expect(unsafe_code, reason = "vector instructions, and buffers of which several threads write disjoint parts")]

mod answers;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod bands;
mod costs;
mod decide;
mod kernels;
mod lanes;
mod march;
mod shared;

use bands::Memory;
use kernels::Kernels;
use shared::Shared;

use super::search::Search;
use super::view::View;
use crate::tiles::Tiles;

/// Instruction sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Set {
    /// Whatever the compiler was told to assume.
    Portable,
    /// AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512 F, BW and VL: 512-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Set {
    /// Those of this machine, fastest first.
    pub fn available() -> Vec<Self> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2");
            if avx2 && is_x86_feature_detected!("avx512bw") && is_x86_feature_detected!("avx512vl") {
                sets.push(Self::Avx512);
            }
            if avx2 {
                sets.push(Self::Avx2);
            }
        }
        sets.push(Self::Portable);
        sets
    }

    fn kernels(self, disparities: usize) -> Kernels {
        match self {
            Self::Portable => kernels::portable::kernels(disparities),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => kernels::avx2::kernels(disparities),
            #[cfg(target_arch = "x86_64")]
            // Whole vectors only.
            Self::Avx512 if disparities.is_multiple_of(32) => kernels::avx512::kernels(disparities),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => kernels::avx2::kernels(disparities),
        }
    }
}

/// Memory that one call leaves for the next.
#[derive(Debug, Default)]
pub(super) struct FastScratch {
    memory: Memory,
    raw: Vec<i16>,
}

/// Whether no block cost or path cost can leave 16 bits: the largest block cost, P2 in it, and P2 on top.
pub(super) fn fits(search: &Search) -> bool {
    let side = 2 * search.radius + 1;
    let largest = side.saturating_mul(side).saturating_mul(costs::largest_pixel_cost(search));
    largest.saturating_add(2 * search.p2 as usize) <= i16::MAX as usize
}

/// Matches two images, up to and including the median; `set` must be one of [`Set::available`].
pub(super) fn compute(
    set: Set,
    search: &Search,
    block: i32,
    images: [&View<'_>; 2],
    scratch: &mut FastScratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) {
    assert!(Set::available().contains(&set), "{set:?} is not available on this machine");
    if search.columns == 0 {
        out.fill(search.invalid);
        return;
    }
    let kernels = set.kernels(search.disparities);
    scratch.raw.clear();
    scratch.raw.resize(out.len(), search.invalid);
    let raw = Shared::from(&mut scratch.raw[..]);
    for stripe in &search.stripes(block) {
        bands::compute(kernels, search, stripe, images, &mut scratch.memory, tiles, raw);
    }
    let (width, height) = (search.width, search.height);
    let raw = &scratch.raw;
    let out = Shared::from(out);
    let rows = 16;
    tiles.run(height.div_ceil(rows), &|n| {
        for y in n * rows..((n + 1) * rows).min(height) {
            let row = |y: usize| &raw[y * width..][..width];
            // SAFETY: each row is written once; the instruction set is available.
            unsafe {
                let out = out.write(y * width..(y + 1) * width);
                (kernels.median)([row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))], out);
            }
        }
    });
}
