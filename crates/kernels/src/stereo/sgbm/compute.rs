//! The entry: checks, and the choice between implementations.

use super::extend::{self, ExtendScratch, cut, extended};
use super::fast::{self, FastScratch};
use super::search::Search;
use super::speckle::SpeckleScratch;
use super::view::check_shapes;
use super::{Error, Maps, Mode, Params, View, plain, speckle};
use crate::memory::{TooMuch, bytes_of};
use crate::simd::Path;
use crate::tiles::Tiles;

/// Buffers that one call leaves for the next; any call may use any scratch.
#[derive(Debug, Default)]
pub struct SgbmScratch {
    fast: FastScratch,
    speckle: SpeckleScratch,
    extend: ExtendScratch,
}

/// Disparities of `left`'s pixels in 1/16 px, [`Params::invalid`] where invalid; the fastest implementation
/// for this machine ([`Path::best`]), spread over `tiles`.
///
/// # Errors
/// Parameters or shapes that OpenCV refuses or does not document ([`Params::check`]), an `out` of another size, and
/// more memory than there is for one call ([`MOST_BYTES`](crate::memory::MOST_BYTES)).
pub fn compute(
    left: &View<'_>,
    right: &View<'_>,
    params: &Params,
    scratch: &mut SgbmScratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) -> Result<(), Error> {
    compute_on(Path::best(), left, right, params, scratch, tiles, out)
}

/// [`compute`] with a chosen implementation; the plain one wherever 16-bit costs might saturate.
///
/// # Errors
/// As [`compute`].
pub fn compute_on(
    path: Path,
    left: &View<'_>,
    right: &View<'_>,
    params: &Params,
    scratch: &mut SgbmScratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) -> Result<(), Error> {
    let maps = Maps { disparity: out, right: None, ambiguity: None };
    compute_maps(path, left, right, params, scratch, tiles, maps)
}

/// [`compute_on`] with further maps.
///
/// # Errors
/// As [`compute`].
pub fn compute_maps(
    path: Path,
    left: &View<'_>,
    right: &View<'_>,
    params: &Params,
    scratch: &mut SgbmScratch,
    tiles: &dyn Tiles,
    mut maps: Maps<'_>,
) -> Result<(), Error> {
    params.check()?;
    check_shapes(left, right, &maps)?;
    let columns = extend::virtual_columns(params);
    let SgbmScratch { fast, speckle, extend } = scratch;
    let job = Job { path, params, columns, tiles };
    if columns == 0 {
        return job.run([left, right], fast, speckle, &mut maps);
    }
    let width = left.width;
    let ExtendScratch { images: [left_data, right_data], disparity, right: right_disparity, ambiguity } = extend;
    let (left, right) = (extended(left, columns, left_data)?, extended(right, columns, right_data)?);
    let pixels = left.width * left.height;
    let mut wide = Maps {
        disparity: sized(disparity, pixels),
        right: maps.right.is_some().then(|| sized(right_disparity, pixels)),
        ambiguity: maps.ambiguity.is_some().then(|| sized(ambiguity, pixels)),
    };
    check_shapes(&left, &right, &wide)?;
    job.run([&left, &right], fast, speckle, &mut wide)?;
    cut(wide.disparity, columns, width, maps.disparity);
    if let (Some(wide), Some(right)) = (wide.right, maps.right) {
        cut(wide, columns, width, right);
    }
    if let (Some(wide), Some(ambiguity)) = (wide.ambiguity, maps.ambiguity) {
        cut(wide, columns, width, ambiguity);
    }
    Ok(())
}

/// A buffer of `len` values of whatever content.
fn sized<T: Clone + Default>(buffer: &mut Vec<T>, len: usize) -> &mut [T] {
    buffer.resize(len, T::default());
    buffer
}

/// One call, with images of any width.
struct Job<'a> {
    path: Path,
    params: &'a Params,
    /// Virtual columns of its images.
    columns: usize,
    tiles: &'a dyn Tiles,
}

impl Job<'_> {
    fn run(
        &self,
        images: [&View<'_>; 2],
        fast: &mut FastScratch,
        speckle: &mut SpeckleScratch,
        maps: &mut Maps<'_>,
    ) -> Result<(), Error> {
        let Self { path, params, columns, tiles } = *self;
        let [left, right] = images;
        let search = Search::new(params, left.width, left.height, left.channels);
        if (left.width as i64) < search.least_width() {
            let (width, needed) = (left.width - columns, search.least_width() - columns as i64);
            return Err(Error::Narrow { width, needed });
        }
        if matches!(params.mode, Mode::Hh | Mode::Hh4) {
            // Costs and sums of the whole image.
            TooMuch::check(bytes_of(&[2, search.row_len(), search.height], size_of::<i16>()))?;
        }
        match path {
            Path::Fast(level) if fast::fits(&search) => {
                fast::compute(level, &search, params.block, images, fast, tiles, maps)?;
            }
            _ => plain::compute(&search, params.block, left, right, maps),
        }
        if params.speckle_window > 0 {
            let range = params.speckle_range.saturating_mul(16);
            let window = params.speckle_window as usize;
            speckle::filter(maps.disparity, search.width, search.invalid, window, range, speckle);
        }
        maps.finish(search.invalid);
        Ok(())
    }
}
