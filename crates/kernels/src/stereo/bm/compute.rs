//! The entry: checks, bands of rows on several threads, and each band row by row.

use depthloom_threads::locked;
use std::fmt;
use std::ops::Range;
use std::sync::Mutex;

use super::check::RightView;
use super::choice::{first_of, is_rivalled, refined};
use super::search::Search;
use super::sums::{Pair, Sum, accumulate, advance, fit_16_bits, shift, widen};
use super::{Params, prefilter};
use crate::raster::check;
use crate::simd::{Level, Pass};
use crate::stereo::params::ParamError;
use crate::stereo::sgbm::{SpeckleScratch, filter_speckles};
use crate::tiles::Tiles;

/// Why no disparities were computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Error {
    /// A parameter is refused.
    Param(ParamError),
    /// The block is not smaller than the image.
    Small {
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
        /// Side of the block, px.
        block: i32,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Param(error) => error.fmt(f),
            Self::Small { width, height, block } => {
                write!(f, "image is {width}x{height}, too small for a block of {block}: both sides must be larger")
            }
        }
    }
}

impl std::error::Error for Error {}

impl From<ParamError> for Error {
    fn from(error: ParamError) -> Self {
        Self::Param(error)
    }
}

/// Buffers that one call leaves for the next; any call may use any scratch.
#[derive(Debug, Default)]
pub struct BmScratch {
    left: Vec<u8>,
    right: Vec<u8>,
    bands: Mutex<Vec<Band>>,
    speckle: SpeckleScratch,
}

#[derive(Debug, Default)]
struct Band {
    sums_16: Sums<u16>,
    sums_32: Sums<u32>,
    disparity: Vec<i16>,
    cost: Vec<i32>,
    right_view: RightView,
}

#[derive(Debug, Default)]
struct Sums<S> {
    /// By column and candidate, over the block's height.
    columns: Vec<S>,
    /// By candidate, over the block.
    block: Vec<S>,
    /// By column, the texture over the block's height.
    texture: Vec<i32>,
}

/// Least rows of a band. Its first row costs as much as half a block of others.
const BAND: usize = 32;

/// Disparities of `left`'s pixels in 1/16 px, [`Params::invalid`] where invalid; grey images, spread over
/// `tiles`.
///
/// # Errors
/// Parameters that OpenCV refuses ([`Params::check`]), and an image no larger than the block.
#[expect(clippy::too_many_arguments, reason = "two images and their size, then what every matcher takes")]
pub fn compute(
    left: &[u8],
    right: &[u8],
    width: usize,
    height: usize,
    params: &Params,
    scratch: &mut BmScratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) -> Result<(), Error> {
    check("left", left.len(), width, height, 1);
    check("right", right.len(), width, height, 1);
    check("disparity", out.len(), width, height, 1);
    params.check()?;
    if width.min(height) <= params.block as usize {
        return Err(Error::Small { width, height, block: params.block });
    }
    out.fill(params.invalid());
    if let Some(search) = Search::new(params, width, height) {
        let images = [left, right];
        compute_at(Level::best(), fit_16_bits(&search), &search, params, images, scratch, tiles, out);
    }
    Ok(())
}

/// [`compute`] with everything checked, for one instruction set and with sums of 16 bits (`narrow`) or 32.
#[expect(clippy::too_many_arguments, reason = "the arguments of `compute`, and what it chose")]
fn compute_at(
    level: Level,
    narrow: bool,
    search: &Search,
    params: &Params,
    [left, right]: [&[u8]; 2],
    scratch: &mut BmScratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) {
    let (width, height) = (search.width, search.height);
    for (image, filtered) in [(left, &mut scratch.left), (right, &mut scratch.right)] {
        filtered.resize(width * height, 0);
        in_bands(tiles, 0..height, width, filtered, &|rows, out| {
            prefilter::rows(level, params, image, (width, height), rows, out);
        });
    }
    let BmScratch { left, right, bands, speckle } = scratch;
    let (bands, images) = (&*bands, Images { left, right });
    // The bottom margin goes to the last band, which may write to it.
    let top = search.radius * width;
    in_bands(tiles, search.kept_rows(), width, &mut out[top..], &|rows, out| {
        let lock = || locked(bands);
        let mut band = lock().pop().unwrap_or_default();
        let Band { sums_16, sums_32, disparity, cost, right_view } = &mut band;
        let row_output = (disparity, cost, right_view);
        if narrow {
            level.run(BandRows { search, images: &images, rows, sums: sums_16, row_output, out });
        } else {
            level.run(BandRows { search, images: &images, rows, sums: sums_32, row_output, out });
        }
        lock().push(band);
    });
    if params.speckle_window > 0 && params.speckle_range >= 0 {
        filter_speckles(out, width, search.invalid, params.speckle_window as usize, params.speckle_range, speckle);
    }
}

/// Cuts `rows` into bands by their number alone; the last band gets what is left of `out`.
fn in_bands<T: Send>(
    tiles: &dyn Tiles,
    rows: Range<usize>,
    width: usize,
    mut out: &mut [T],
    work: &(dyn Fn(Range<usize>, &mut [T]) + Sync),
) {
    let count = (rows.len() / BAND).max(1);
    let start_of = |band: usize| rows.start + rows.len() * band / count;
    let mut parts = Vec::with_capacity(count);
    for band in 0..count {
        let rows = start_of(band)..start_of(band + 1);
        let len = if band + 1 == count { out.len() } else { rows.len() * width };
        let (part, rest) = out.split_at_mut(len);
        out = rest;
        parts.push(Mutex::new((rows, part)));
    }
    tiles.run(count, &|band| {
        let mut part = locked(&parts[band]);
        let (rows, out) = &mut *part;
        work(rows.clone(), out);
    });
}

struct Images<'a> {
    left: &'a [u8],
    right: &'a [u8],
}

impl<'a> Images<'a> {
    fn row(&self, width: usize, y: usize) -> Pair<'a> {
        let row = |image: &'a [u8]| &image[y * width..][..width];
        Pair { left: row(self.left), right: row(self.right) }
    }
}

struct BandRows<'a, S> {
    search: &'a Search,
    images: &'a Images<'a>,
    rows: Range<usize>,
    sums: &'a mut Sums<S>,
    row_output: (&'a mut Vec<i16>, &'a mut Vec<i32>, &'a mut RightView),
    out: &'a mut [i16],
}

impl<S: Sum> Pass for BandRows<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { search, images, rows, sums, row_output: (disparity, cost, right_view), out } = self;
        let (width, radius) = (search.width, search.radius);
        let columns = search.kept_columns();
        for (place, y) in rows.clone().enumerate() {
            if place == 0 {
                sums.start(search);
                for y in y - radius..=y + radius {
                    sums.add_row(search, images.row(width, y));
                }
            } else {
                sums.next_row(search, images.row(width, y + radius), images.row(width, y - radius - 1));
            }
            disparity.clear();
            disparity.resize(search.first_column + search.columns, search.invalid);
            cost.resize(disparity.len(), 0);
            sums.answer_row(search, disparity, cost);
            if let Some(max_diff) = search.disp12_max_diff {
                right_view.check(search, max_diff, disparity, cost);
            }
            out[place * width..][columns.clone()].copy_from_slice(&disparity[columns.clone()]);
            if y + 1 == search.height - radius && disparity.len() > width {
                // What OpenCV finds beyond the right border lands in the row below.
                let beyond = &disparity[width..];
                out[(place + 1) * width..][..beyond.len()].copy_from_slice(beyond);
            }
        }
    }
}

impl<S: Sum> Sums<S> {
    fn start(&mut self, search: &Search) {
        let columns = search.columns + 2 * search.radius;
        self.columns.clear();
        self.columns.resize(columns * search.disparities, S::default());
        self.texture.clear();
        self.texture.resize(columns, 0);
    }

    #[inline(always)]
    fn add_row(&mut self, search: &Search, entering: Pair<'_>) {
        let sums = self.columns.chunks_exact_mut(search.disparities).zip(&mut self.texture);
        for ((sums, texture), column) in sums.zip(-(search.radius as isize)..) {
            let entering = entering.column(search, column);
            accumulate(sums, &entering);
            *texture += i32::from(entering.left.abs_diff(search.cap));
        }
    }

    #[inline(always)]
    fn next_row(&mut self, search: &Search, entering: Pair<'_>, leaving: Pair<'_>) {
        let sums = self.columns.chunks_exact_mut(search.disparities).zip(&mut self.texture);
        for ((sums, texture), column) in sums.zip(-(search.radius as isize)..) {
            let (entering, leaving) = (entering.column(search, column), leaving.column(search, column));
            advance(sums, &entering, &leaving);
            *texture += i32::from(entering.left.abs_diff(search.cap)) - i32::from(leaving.left.abs_diff(search.cap));
        }
    }

    /// Answers of the searched columns, at their places in the row; the rest of `disparity` stays.
    #[inline(always)]
    fn answer_row(&mut self, search: &Search, disparity: &mut [i16], cost: &mut [i32]) {
        // The usual numbers of candidates as constants: loops without remainders.
        match search.disparities {
            64 => self.answer_row_of::<64>(search, disparity, cost),
            128 => self.answer_row_of::<128>(search, disparity, cost),
            _ => self.answer_row_of::<0>(search, disparity, cost),
        }
    }

    /// [`Self::answer_row`] for `N` candidates; 0 stands for any number.
    #[inline(always)]
    fn answer_row_of<const N: usize>(&mut self, search: &Search, disparity: &mut [i16], cost: &mut [i32]) {
        let (candidates, side) = (if N == 0 { search.disparities } else { N }, 2 * search.radius + 1);
        self.block.clear();
        self.block.resize(candidates, S::default());
        let block = &mut self.block[..candidates];
        let column = |index: usize| &self.columns[index * candidates..][..candidates];
        for index in 0..side - 1 {
            widen(block, column(index));
        }
        // What leaves before the first block is complete: nothing.
        let nothing = vec![S::default(); candidates];
        let mut texture: i32 = self.texture[..side - 1].iter().sum();
        let row_output = disparity[search.first_column..].iter_mut().zip(&mut cost[search.first_column..]);
        for (x, (disparity, cost)) in row_output.enumerate() {
            let (leaving, flat) =
                if x == 0 { (&nothing[..candidates], 0) } else { (column(x - 1), self.texture[x - 1]) };
            let smallest = shift(block, column(x + side - 1), leaving);
            texture += self.texture[x + side - 1] - flat;
            if texture < search.texture_threshold {
                continue;
            }
            let best = first_of(block, smallest);
            if is_rivalled(search, block, best) {
                continue;
            }
            *disparity = refined(search, block, best);
            *cost = smallest.wide();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{ProptestConfig, any, proptest};
    use proptest::{prop_assert_eq, prop_oneof};

    use super::{BmScratch, Error, compute, compute_at};
    use crate::simd::every_level;
    use crate::stereo::bm::search::Search;
    use crate::stereo::bm::{Params, Prefilter};
    use crate::tiles::Serial;

    /// A right image of noise and a left one that shows it shifted.
    fn pair(width: usize, height: usize, shift: usize, seed: u64) -> (Vec<u8>, Vec<u8>) {
        let mut state = seed | 1;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        };
        let right: Vec<u8> = (0..width * height).map(|_| noise()).collect();
        let left = (0..width * height).map(|i| right[i.saturating_sub(shift)].saturating_add(noise() / 16)).collect();
        (left, right)
    }

    #[test]
    fn a_shifted_image_is_found() {
        let (left, right) = pair(160, 90, 9, 5);
        let mut disparity = vec![0; 160 * 90];
        let params = Params { disparities: 32, block: 9, ..Params::default() };
        compute(&left, &right, 160, 90, &params, &mut BmScratch::default(), &Serial, &mut disparity).unwrap();
        for (i, fixed) in disparity.into_iter().enumerate() {
            let inside = (31 + 4..160 - 4).contains(&(i % 160)) && (4..90 - 4).contains(&(i / 160));
            if inside {
                assert!((i32::from(fixed) - 9 * 16).abs() <= 8, "{fixed} at {i}");
            } else {
                assert_eq!(fixed, -16);
            }
        }
    }

    #[test]
    fn an_image_no_larger_than_the_block_is_refused() {
        let error = compute(
            &[0; 63],
            &[0; 63],
            9,
            7,
            &Params { block: 7, ..Params::default() },
            &mut BmScratch::default(),
            &Serial,
            &mut [0; 63],
        );
        assert_eq!(error, Err(Error::Small { width: 9, height: 7, block: 7 }));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn instruction_sets_and_the_width_of_sums_change_nothing(
            (width, height) in (60usize..110, 12usize..80),
            disparities in prop_oneof![proptest::strategy::Just(16), proptest::strategy::Just(48)],
            (min_disparity, block) in (-20i32..10, 2i32..5),
            (uniqueness, disp12_max_diff) in (0i32..30, -1i32..3),
            normalized in any::<bool>(),
            seed in any::<u64>(),
        ) {
            let prefilter = if normalized { Prefilter::NormalizedResponse } else { Prefilter::Xsobel };
            let block = block * 2 + 1;
            let params = Params { disparities, min_disparity, block, uniqueness, disp12_max_diff, prefilter, ..Params::default() };
            let (left, right) = pair(width, height, 7, seed);
            if let Some(search) = Search::new(&params, width, height) {
                let matched = |narrow| every_level(|level| {
                    let mut out = vec![0; width * height];
                    compute_at(level, narrow, &search, &params, [&left, &right], &mut BmScratch::default(), &Serial, &mut out);
                    out
                });
                prop_assert_eq!(matched(true), matched(false));
            }
        }
    }
}
