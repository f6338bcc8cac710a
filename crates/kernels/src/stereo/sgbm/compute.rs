//! The entry: checks, and the choice between implementations.

use super::fast::{self, FastScratch};
use super::search::Search;
use super::speckle::SpeckleScratch;
use super::view::check_shapes;
use super::{Error, Mode, Params, View, plain, speckle};
use crate::memory::{TooMuch, bytes_of};
use crate::simd::Path;
use crate::tiles::Tiles;

/// Buffers that one call leaves for the next; any call may use any scratch.
#[derive(Debug, Default)]
pub struct SgbmScratch {
    fast: FastScratch,
    speckle: SpeckleScratch,
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
    params.check()?;
    check_shapes(left, right, out.len())?;
    let search = Search::new(params, left.width, left.height, left.channels);
    if (left.width as i64) < search.least_width() {
        return Err(Error::Narrow { width: left.width, needed: search.least_width() });
    }
    if matches!(params.mode, Mode::Hh | Mode::Hh4) {
        // Costs and sums of the whole image.
        TooMuch::check(bytes_of(&[2, search.row_len(), search.height], size_of::<i16>()))?;
    }
    match path {
        Path::Fast(level) if fast::fits(&search) => {
            fast::compute(level, &search, params.block, [left, right], &mut scratch.fast, tiles, out)?;
        }
        _ => plain::compute(&search, params.block, left, right, out),
    }
    if params.speckle_window > 0 {
        let range = params.speckle_range.saturating_mul(16);
        let window = params.speckle_window as usize;
        speckle::filter(out, search.width, search.invalid, window, range, &mut scratch.speckle);
    }
    Ok(())
}
