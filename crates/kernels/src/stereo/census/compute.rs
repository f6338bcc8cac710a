//! The entry: the frame's stages, and how they are spread over tiles.
//!
//! Two sweeps, one down and one up, each sum half of the paths. Each first stores its sums for the half of the image
//! where it begins; in the half where it ends it meets the other's sums, adds its own, and chooses. So no row's sums
//! are written more than twice, and two threads can sweep at a time; transform and checks are spread further.

use super::choice::{Demands, RightBest, choose};
use super::features::{Feature, FeatureRow, comparisons};
use super::finish::{Check, FinishRow, Maps};
use super::paths::{Aggregation, Penalties};
use super::{Census, Error, Params};
use crate::memory;
use crate::raster;
use crate::simd::{Level, Pass};
use crate::tiles::{Tiles, each};

/// Rows of a tile, where rows do not depend on each other.
const TILE_ROWS: usize = 16;

/// A rectified pair of grey images, rows without gaps.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    /// The left image, whose pixels get disparities.
    pub left: &'a [u8],
    /// The right image.
    pub right: &'a [u8],
    /// Columns of both.
    pub width: usize,
    /// Rows of both.
    pub height: usize,
}

/// Buffers that one call leaves for the next; any call may use any scratch.
#[derive(Debug, Default)]
pub struct CensusScratch {
    narrow: Buffers<u32>,
    wide: Buffers<u64>,
    /// Costs summed over paths, by row, column and disparity.
    sums: Vec<u16>,
    left: Vec<u16>,
    right: Vec<u16>,
}

#[derive(Debug, Default)]
struct Buffers<F> {
    left: Vec<F>,
    right: Vec<F>,
    sweeps: [Sweep<F>; 2],
}

#[derive(Debug, Default)]
struct Sweep<F> {
    aggregation: Aggregation<F>,
    right_best: RightBest,
}

/// Disparities of the left image's pixels in 1/16 px, [`Params::invalid`] where invalid; spread over
/// `tiles`.
///
/// Memory: 2 bytes for each pixel and disparity.
///
/// # Errors
/// A parameter out of its range ([`Params::check`]), and more memory than there is for one call
/// ([`memory::MOST_BYTES`]).
///
/// # Panics
/// If an image or `out` has another size than announced, or the images have no pixels.
pub fn compute(
    pair: &Pair<'_>,
    params: &Params,
    scratch: &mut CensusScratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) -> Result<(), Error> {
    compute_at(Level::best(), pair, params, scratch, tiles, out)
}

/// [`compute`] for a chosen instruction set.
///
/// # Errors
/// As [`compute`].
///
/// # Panics
/// As [`compute`].
pub fn compute_at(
    level: Level,
    pair: &Pair<'_>,
    params: &Params,
    scratch: &mut CensusScratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) -> Result<(), Error> {
    params.check()?;
    let Pair { left, right, width, height } = *pair;
    assert!(width > 0 && height > 0, "an image of {width} x {height} pixels is empty");
    raster::check("the left image", left.len(), width, height, 1);
    raster::check("the right image", right.len(), width, height, 1);
    raster::check("the output", out.len(), width, height, 1);
    let pixels = width * height;
    let CensusScratch { narrow, wide, sums, left, right } = scratch;
    memory::reserve(sums, pixels.saturating_mul(lanes(params)))?;
    for map in [&mut *left, right] {
        map.resize(pixels, 0);
    }
    let sums = Summed { sums, maps: [left, right] };
    match params.census {
        Census::Symmetric => narrow.raw_maps(level, pair, params, sums, tiles),
        Census::Full | Census::OffAxis => wide.raw_maps(level, pair, params, sums, tiles),
    }
    let maps = Maps { left, right, width };
    let check =
        Check { min_disparity: params.min_disparity, lr_max_diff: params.lr_max_diff, invalid: params.invalid() };
    each(tiles, out.chunks_mut(TILE_ROWS * width).collect(), |tile, out| {
        let mut medians = vec![0; 2 * width];
        for (row, out) in out.chunks_exact_mut(width).enumerate() {
            let y = tile * TILE_ROWS + row;
            level.run_counting(FinishRow { maps, check, y, out, medians: &mut medians });
        }
    });
    Ok(())
}

/// Costs held for each pixel: the disparities, filled up to whole steps of a sweep.
const fn lanes(params: &Params) -> usize {
    (params.disparities as usize).next_multiple_of(if params.disparities % 64 == 0 { 64 } else { 32 })
}

struct Summed<'a> {
    sums: &'a mut Vec<u16>,
    maps: [&'a mut [u16]; 2],
}

impl<F: Feature> Buffers<F> {
    fn raw_maps(&mut self, level: Level, pair: &Pair<'_>, params: &Params, summed: Summed<'_>, tiles: &dyn Tiles) {
        self.transform(level, pair, params.census, tiles);
        if params.disparities % 64 == 0 {
            self.aggregate::<64>(level, pair, params, summed, tiles);
        } else {
            self.aggregate::<32>(level, pair, params, summed, tiles);
        }
    }

    fn transform(&mut self, level: Level, pair: &Pair<'_>, census: Census, tiles: &dyn Tiles) {
        let comparisons = comparisons(census);
        let mut parts = Vec::new();
        for (image, features) in [(pair.left, &mut self.left), (pair.right, &mut self.right)] {
            features.resize(image.len(), F::default());
            let chunks = features.chunks_mut(TILE_ROWS * pair.width).enumerate();
            parts.extend(chunks.map(|(tile, features)| (image, tile * TILE_ROWS, features)));
        }
        each(tiles, parts, |_, (image, first, features)| {
            for (row, out) in features.chunks_exact_mut(pair.width).enumerate() {
                level.run_counting(FeatureRow {
                    image,
                    width: pair.width,
                    y: first + row,
                    comparisons: &comparisons,
                    out,
                });
            }
        });
    }

    fn aggregate<const N: usize>(
        &mut self,
        level: Level,
        &Pair { width, height, .. }: &Pair<'_>,
        params: &Params,
        Summed { sums, maps: [left_map, right_map] }: Summed<'_>,
        tiles: &dyn Tiles,
    ) {
        let disparities = params.disparities as usize;
        let lanes = lanes(params);
        debug_assert!(lanes.is_multiple_of(N), "a row of costs is whole steps");
        let penalties = Penalties { p1: params.p1 as u8, p2: params.p2 as u8 };
        for (sweep, upward) in self.sweeps.iter_mut().zip([false, true]) {
            let diagonals = params.paths == 8;
            sweep.aggregation.begin(upward, width, (disparities, lanes), penalties, diagonals);
        }
        sums.resize(width * height * lanes, 0);
        let middle = height / 2;
        let (upper_sums, lower_sums) = sums.split_at_mut(middle * width * lanes);
        let (upper_left, lower_left) = left_map.split_at_mut(middle * width);
        let (upper_right, lower_right) = right_map.split_at_mut(middle * width);
        let [down, up] = &mut self.sweeps;
        let frame = Frame {
            left: &self.left,
            right: &self.right,
            width,
            disparities,
            lanes,
            min_disparity: params.min_disparity,
            demands: Demands { uniqueness: params.uniqueness as u32, subpixel: params.subpixel },
        };
        let halves = vec![
            HalfSweep::<F, N> { frame, sweep: &mut *down, first: 0, upward: false, sums: &mut *upper_sums, maps: None },
            HalfSweep::<F, N> {
                frame,
                sweep: &mut *up,
                first: middle,
                upward: true,
                sums: &mut *lower_sums,
                maps: None,
            },
        ];
        each(tiles, halves, |_, half| level.run_counting(half));
        let (upper, lower) = (Some([upper_left, upper_right]), Some([lower_left, lower_right]));
        let ended = vec![
            HalfSweep::<F, N> { frame, sweep: down, first: middle, upward: false, sums: lower_sums, maps: lower },
            HalfSweep::<F, N> { frame, sweep: up, first: 0, upward: true, sums: upper_sums, maps: upper },
        ];
        each(tiles, ended, |_, half| level.run_counting(half));
    }
}

struct Frame<'a, F> {
    left: &'a [F],
    right: &'a [F],
    width: usize,
    disparities: usize,
    lanes: usize,
    min_disparity: i32,
    demands: Demands,
}

impl<F> Clone for Frame<'_, F> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<F> Copy for Frame<'_, F> {}

struct HalfSweep<'a, F, const N: usize> {
    frame: Frame<'a, F>,
    sweep: &'a mut Sweep<F>,
    /// The half's uppermost row.
    first: usize,
    upward: bool,
    sums: &'a mut [u16],
    /// The left and the right raw map of the half, if the other sweep has been here.
    maps: Option<[&'a mut [u16]; 2]>,
}

impl<F: Feature, const N: usize> Pass for HalfSweep<'_, F, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { frame, sweep: Sweep { aggregation, right_best }, first, upward, sums, mut maps } = self;
        let Frame { left, right, width, disparities, lanes, min_disparity, demands } = frame;
        let rows = sums.len() / (width * lanes);
        for step in 0..rows {
            let row = if upward { rows - 1 - step } else { step };
            let sums = &mut sums[row * width * lanes..][..width * lanes];
            if maps.is_none() {
                sums.fill(0);
            }
            let [left, right] = [left, right].map(|features| &features[(first + row) * width..][..width]);
            aggregation.row::<N>(left, right, min_disparity, sums);
            let Some(maps) = &mut maps else { continue };
            let [left, right] = maps.each_mut().map(|map| &mut map[row * width..][..width]);
            right_best.begin(width, disparities);
            for (x, (sums, left)) in sums.chunks_exact(lanes).zip(left).enumerate() {
                *left = choose(x, &sums[..disparities], demands, right_best);
            }
            right_best.write(min_disparity, right);
        }
    }
}
