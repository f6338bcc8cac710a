//! The fast implementations: costs of 16 or 32 candidates at a time, bands of rows that stay in the cache, pieces for
//! all threads.
//!
//! They rely on 16-bit costs that never saturate ([`fits`]), so that sums may be taken in any order; what could
//! saturate goes to the plain twin. Only the sum over the directions may reach 32767, where adding numbers that are not
//! negative gives the same in any order.
//!
//! # Roofline
//!
//! 1242x375 with 64 disparities searches 441,750 pixels, 28.3 million cells. A cell costs
//!
//! | | operations (lanes) | loads | stores |
//! |---|---|---|---|
//! | pixel cost, two planes, bytes | 17 on half-size lanes | 6 bytes | 1 byte |
//! | sum over the block's height, of two rows at once | 6, half of them to widen bytes | 3 bytes | 1 |
//! | sum over its width | 2 | 3 | 1 |
//! | each direction along the row | 8, and 4 shuffles | 1 | 1 |
//! | each direction from above | 8 | 3 (two of them across cache lines) | 1 |
//! | choice | 3 | 1 | 0 |
//!
//! which is about 75 lane operations for five directions, 100 for eight. A core with AVX-512 does 64 lanes of 16 bits a
//! cycle: 33 million cycles, 11 ms at 3 GHz, for `sgbm`. With AVX2 it does 48 on Intel's cores, 64 on Zen 4.
//!
//! Memory decides the order of the work. On a Xeon whose second-level cache has 2 MiB and whose last level is slow, a
//! band of 24 rows with row sums (12 MB) made all of it wait: one direction from above took as long as three. What a
//! small band needs (pixel costs of 8 rows, costs and sums of 4, paths) has 2.4 MB, and is read half as often. Measured
//! there, two threads on what may be one core (best times in milliseconds; ratios to OpenCV 5.0 of two runs):
//!
//! | mode | bands of 24 rows, AVX2 | now, 1 thread | 2 threads | OpenCV / now, 1 thread | 2 threads |
//! |---|---|---|---|---|---|
//! | `sgbm` | 36 | 24 | 15 | 3.1, 3.9 | 5.2, 6.9 |
//! | `3way` | 38 | 20 | 15 | 3.4, 3.6 | 1.8, 2.8 |
//! | `hh` | 64 | 44 | 23 | 4.2, 4.0 | 6.8, 7.8 |
//! | `hh4` | 59 | 36 | 22 | 3.8, 4.9 | 3.9, 4.6 |
//!
//! `hh` and `hh4` write and read 57 MB of costs and 57 MB of sums besides. AVX-512 takes 0.8 times as long as AVX2
//! there.
//!
//! # Soundness
//!
//! The buffers are cut among threads by [`bands`] and reached through raw pointers. `cargo +nightly miri test -p
//! depthloom-kernels --test sgbm_paths` runs all of it (without vector instructions) under Miri; with vector
//! instructions under AddressSanitizer: `RUSTFLAGS=-Zsanitizer=address cargo +nightly test --release --target
//! x86_64-unknown-linux-gnu -p depthloom-kernels --test sgbm_paths`.
#![expect(unsafe_code, reason = "vector instructions, and buffers of which several threads write disjoint parts")]

mod aggregate;
mod along;
mod bands;
mod block_costs;
mod costs;
mod decide;
mod kernels;
mod right_view;
mod row_disparities;
mod shared;

use bands::{Memory, RawMaps};
use kernels::Kernels;
use shared::Shared;

use super::maps::Maps;
use super::search::Search;
use super::view::View;
use crate::memory::TooMuch;
use crate::simd::Level;
use crate::tiles::Tiles;

/// The kernels of a level. Those of AVX-512 need shifts over two lanes, which the first processors with AVX-512 lack,
/// and vectors of 32 disparities.
fn kernels_of(level: Level, disparities: usize) -> Kernels {
    #[cfg(target_arch = "x86_64")]
    {
        if level.has_avx512_vbmi2() && disparities.is_multiple_of(32) {
            return kernels::avx512::kernels(disparities);
        }
        if level.has_avx2() {
            return kernels::avx2::kernels(disparities);
        }
    }
    #[cfg(target_arch = "aarch64")]
    if level.has_neon() {
        return kernels::neon::kernels(disparities);
    }
    let _ = level;
    kernels::portable::kernels(disparities)
}

#[derive(Debug, Default)]
pub(super) struct FastScratch {
    memory: Memory,
    raw: Vec<i16>,
    raw_right: Vec<i16>,
}

/// Whether no block cost or path cost can leave 16 bits: the largest block cost, P2 in it, and P2 on top.
pub(super) fn fits(search: &Search) -> bool {
    let side = 2 * search.radius + 1;
    let largest = side.saturating_mul(side).saturating_mul(costs::largest_pixel_cost(search));
    largest.saturating_add(2 * search.p2 as usize) <= i16::MAX as usize
}

/// Matches two images, up to and including the median.
pub(super) fn compute(
    level: Level,
    search: &Search,
    block: i32,
    images: [&View<'_>; 2],
    scratch: &mut FastScratch,
    tiles: &dyn Tiles,
    maps: &mut Maps<'_>,
) -> Result<(), TooMuch> {
    if search.columns == 0 {
        maps.clear(search);
        return Ok(());
    }
    let kernels = kernels_of(level, search.disparities);
    let FastScratch { memory, raw, raw_right } = scratch;
    raw.clear();
    raw.resize(maps.disparity.len(), search.invalid);
    raw_right.clear();
    if let Some(right) = &maps.right {
        raw_right.resize(right.len(), search.right_invalid);
    }
    if let Some(ambiguity) = maps.ambiguity.as_deref_mut() {
        ambiguity.fill(1.0);
    }
    let raw_maps = RawMaps {
        disparity: Shared::from(&mut raw[..]),
        right: maps.right.is_some().then(|| Shared::from(&mut raw_right[..])),
        ambiguity: maps.ambiguity.as_deref_mut().map(Shared::from),
    };
    for stripe in &search.stripes(block) {
        bands::compute(kernels, search, stripe, images, memory, tiles, raw_maps)?;
    }
    median(kernels, search, raw, tiles, maps.disparity);
    if let Some(right) = maps.right.as_deref_mut() {
        median(kernels, search, raw_right, tiles, right);
    }
    Ok(())
}

fn median(kernels: Kernels, search: &Search, raw: &[i16], tiles: &dyn Tiles, out: &mut [i16]) {
    let (width, height) = (search.width, search.height);
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
