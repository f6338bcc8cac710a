//! The fast implementations: costs of 16 candidates at a time, bands of rows that stay in cache, pieces for all
//! threads.
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
//! | row and block sums | 4 | 6 | 2 |
//! | each direction from above | 8 | 3 (two of them across cache lines) | 1 |
//! | each direction along the row | 8, and 4 shuffles | 2 | 1 |
//! | choice | 3 | 1 | 0 |
//!
//! which is about 65 lane operations for five directions, 90 for eight. A Zen 4 core issues 64 lanes of 16 bits a cycle
//! (half as many for saturating sums and shuffles) at 3.6 GHz or so: 28.3 million cells x 65 / 64 = 29 million cycles,
//! 8 ms, for `sgbm`, if nothing but those operations cost anything. Measured there, CPU time of one thread, with the
//! other core and the cache busy (milliseconds; OpenCV 5.0 in the same minutes):
//!
//! | mode | AVX2 | OpenCV | ratio |
//! |---|---|---|---|
//! | `sgbm` | 20.3 | 65.3 | 3.2 |
//! | `hh` | 43.2 | 150.5 | 3.5 |
//! | `3way` | 17.7 | 50.1 | 2.8 |
//! | `hh4` | 32.5 | 136.9 | 4.2 |
//!
//! So `sgbm` runs at 40 % of that roof. What is above it: the minimum over disparities that each pixel of a path along
//! the row waits for (two rows at a time share the wait), reads across cache lines, decisions that are scalar by nature
//! (about a tenth). With two threads on two idle cores a frame took 12.7 ms in `sgbm` (19.7 with one), 12.2 in `3way`,
//! 25 in `hh4`. Memory is not the limit except in `hh` and `hh4`, which write and read 57 MB of costs and 57 MB of
//! sums: at the 20 GB/s this machine gave, 11 ms. A band's costs, sums and row sums take some 12 MB and stay in the
//! last-level cache (80 GB/s); a tile's paths, 18 kB, in the first-level one.
//!
//! # Soundness
//!
//! The buffers are cut among threads by [`bands`] and reached through raw pointers. `cargo +nightly miri test -p
//! depthloom-kernels --test sgbm_paths` runs all of it (without vector instructions) under Miri; with vector
//! instructions under AddressSanitizer: `RUSTFLAGS=-Zsanitizer=address cargo +nightly test --release --target
//! x86_64-unknown-linux-gnu -p depthloom-kernels --test sgbm_paths`.
#![expect(unsafe_code, reason = "vector instructions, and buffers of which several threads write disjoint parts")]

mod aggregate;
#[cfg(target_arch = "x86_64")]
mod avx2;
mod bands;
mod costs;
mod decide;
mod kernels;
mod lanes;
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

/// The kernels of a level. AVX-512 has no kernels: it was not faster than AVX2 on two generations of processors.
fn kernels_of(level: Level, disparities: usize) -> Kernels {
    #[cfg(target_arch = "x86_64")]
    if level.has_avx2() {
        return kernels::avx2::kernels(disparities);
    }
    #[cfg(not(target_arch = "x86_64"))]
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
