//! The entry: checks, bands of rows on several threads, and each band row by row.

use depthloom_threads::locked;
use std::fmt;
use std::ops::Range;
use std::sync::Mutex;

use super::check::RightView;
use super::choice::{first_of, is_rivalled, refined};
use super::fast::{FastSums, Kernels};
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
    fast: FastSums,
    sums_16: Sums<u16>,
    sums_32: Sums<u32>,
    texture: Texture,
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
        let level = Level::best();
        compute_at(level, SumKind::best(level, &search), &search, params, images, scratch, tiles, out);
    }
    Ok(())
}

/// Which sums are kept.
#[derive(Clone, Copy)]
enum SumKind {
    Fast(Kernels),
    Bits16,
    Bits32,
}

impl SumKind {
    /// The fastest that gives the right sums.
    fn best(level: Level, search: &Search) -> Self {
        match Kernels::new(level, search) {
            Some(kernels) => Self::Fast(kernels),
            None if fit_16_bits(search) => Self::Bits16,
            None => Self::Bits32,
        }
    }
}

/// [`compute`] with everything checked, for one instruction set and one kind of sums.
#[expect(clippy::too_many_arguments, reason = "the arguments of `compute`, and what it chose")]
fn compute_at(
    level: Level,
    kind: SumKind,
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
        let Band { fast, sums_16, sums_32, texture, disparity, cost, right_view } = &mut band;
        let row_output = (disparity, cost, right_view);
        let images = &images;
        match kind {
            SumKind::Fast(kernels) => {
                BandRows { search, images, rows, sums: &mut (kernels, fast), texture, row_output, out }.run();
            }
            SumKind::Bits16 => {
                level.run(BandRows { search, images, rows, sums: sums_16, texture, row_output, out });
            }
            SumKind::Bits32 => {
                level.run(BandRows { search, images, rows, sums: sums_32, texture, row_output, out });
            }
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

/// By column, the texture over the block's height.
#[derive(Debug, Default)]
struct Texture(Vec<i32>);

impl Texture {
    fn start(&mut self, search: &Search) {
        self.0.clear();
        self.0.resize(search.columns + 2 * search.radius, 0);
    }

    #[inline(always)]
    fn advance(&mut self, search: &Search, entering: Pair<'_>, leaving: Option<Pair<'_>>) {
        let difference = |row: &Pair<'_>, column| i32::from(row.left[search.left(column)].abs_diff(search.cap));
        for (texture, column) in self.0.iter_mut().zip(-(search.radius as isize)..) {
            let leaves = leaving.as_ref().map_or(0, |leaving| difference(leaving, column));
            *texture += difference(&entering, column) - leaves;
        }
    }
}

/// The sums of a band's rows.
trait RowSums {
    fn start(&mut self, search: &Search);
    /// Adds a row to the sums of columns, and takes off another.
    fn advance(&mut self, search: &Search, entering: Pair<'_>, leaving: Option<Pair<'_>>);
    /// Answers of the searched columns, at their places in the row; the rest of `disparity` stays. `texture` is that of
    /// each column.
    fn answer(&mut self, search: &Search, texture: &[i32], disparity: &mut [i16], cost: &mut [i32]);
}

impl RowSums for (Kernels, &mut FastSums) {
    fn start(&mut self, search: &Search) {
        self.1.start(search);
    }

    fn advance(&mut self, search: &Search, entering: Pair<'_>, leaving: Option<Pair<'_>>) {
        self.1.advance(self.0, search, entering, leaving);
    }

    fn answer(&mut self, search: &Search, texture: &[i32], disparity: &mut [i16], cost: &mut [i32]) {
        self.1.answer(self.0, search, texture, disparity, cost);
    }
}

struct BandRows<'a, S> {
    search: &'a Search,
    images: &'a Images<'a>,
    rows: Range<usize>,
    sums: &'a mut S,
    texture: &'a mut Texture,
    row_output: (&'a mut Vec<i16>, &'a mut Vec<i32>, &'a mut RightView),
    out: &'a mut [i16],
}

impl<S: RowSums> Pass for BandRows<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { search, images, rows, sums, texture, row_output: (disparity, cost, right_view), out } = self;
        let (width, radius) = (search.width, search.radius);
        let columns = search.kept_columns();
        for (place, y) in rows.clone().enumerate() {
            if place == 0 {
                sums.start(search);
                texture.start(search);
            }
            let entering = if place == 0 { y - radius..=y + radius } else { y + radius..=y + radius };
            let leaving = (place > 0).then(|| images.row(width, y - radius - 1));
            for entering in entering {
                let entering = images.row(width, entering);
                sums.advance(search, entering, leaving);
                texture.advance(search, entering, leaving);
            }
            disparity.clear();
            disparity.resize(search.first_column + search.columns, search.invalid);
            cost.resize(disparity.len(), 0);
            sums.answer(search, &texture.0, disparity, cost);
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

impl<S: Sum> RowSums for Sums<S> {
    fn start(&mut self, search: &Search) {
        let columns = search.columns + 2 * search.radius;
        self.columns.clear();
        self.columns.resize(columns * search.disparities, S::default());
    }

    #[inline(always)]
    fn advance(&mut self, search: &Search, entering: Pair<'_>, leaving: Option<Pair<'_>>) {
        let columns = self.columns.chunks_exact_mut(search.disparities).zip(-(search.radius as isize)..);
        match leaving {
            None => columns.for_each(|(sums, column)| accumulate(sums, &entering.column(search, column))),
            Some(leaving) => columns.for_each(|(sums, column)| {
                advance(sums, &entering.column(search, column), &leaving.column(search, column));
            }),
        }
    }

    #[inline(always)]
    fn answer(&mut self, search: &Search, texture: &[i32], disparity: &mut [i16], cost: &mut [i32]) {
        // The usual numbers of candidates as constants: loops without remainders.
        match search.disparities {
            64 => self.answer_of::<64>(search, texture, disparity, cost),
            128 => self.answer_of::<128>(search, texture, disparity, cost),
            _ => self.answer_of::<0>(search, texture, disparity, cost),
        }
    }
}

impl<S: Sum> Sums<S> {
    /// [`RowSums::answer`] for `N` candidates; 0 stands for any number.
    #[inline(always)]
    fn answer_of<const N: usize>(
        &mut self,
        search: &Search,
        column_texture: &[i32],
        disparity: &mut [i16],
        cost: &mut [i32],
    ) {
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
        let mut texture: i32 = column_texture[..side - 1].iter().sum();
        let row_output = disparity[search.first_column..].iter_mut().zip(&mut cost[search.first_column..]);
        for (x, (disparity, cost)) in row_output.enumerate() {
            let (leaving, flat) =
                if x == 0 { (&nothing[..candidates], 0) } else { (column(x - 1), column_texture[x - 1]) };
            let smallest = shift(block, column(x + side - 1), leaving);
            texture += column_texture[x + side - 1] - flat;
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
    use proptest::strategy::Just;
    use proptest::{prop_assert, prop_oneof};

    use super::{BmScratch, Error, SumKind, compute, compute_at};
    use crate::simd::{Level, every_level};
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
            (width, height) in (60usize..170, 12usize..80),
            disparities in prop_oneof![Just(16), Just(32), Just(48), Just(64), Just(96), Just(128)],
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
                let matched = |kind: fn(Level, &Search) -> SumKind| every_level(|level| {
                    let (mut out, mut scratch) = (vec![0; width * height], BmScratch::default());
                    let kind = kind(level, &search);
                    compute_at(level, kind, &search, &params, [&left, &right], &mut scratch, &Serial, &mut out);
                    out
                });
                let expected = matched(|_, _| SumKind::Bits32);
                prop_assert!(matched(|_, _| SumKind::Bits16) == expected);
                prop_assert!(matched(SumKind::best) == expected);
            }
        }
    }
}
