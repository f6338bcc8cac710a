//! The entry: checks, and the choice between implementations.

use super::search::Search;
use super::view::check_shapes;
use super::{Error, Params, View, plain};
use crate::tiles::Tiles;

/// Buffers that one call leaves for the next; any call may use any scratch.
#[derive(Debug, Default)]
pub struct Scratch {}

/// An implementation. All give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// The plain scalar twin, on one thread.
    Plain,
}

impl Path {
    /// The implementations this machine can run, fastest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        vec![Self::Plain]
    }
}

/// Disparities of `left`'s pixels in 1/16 px, [`Params::invalid`] where there is no answer; the fastest implementation
/// for this machine, spread over `tiles`.
///
/// # Errors
/// Parameters or shapes that OpenCV refuses or does not document ([`Params::check`]), and an `out` of another size.
pub fn compute(
    left: &View<'_>,
    right: &View<'_>,
    params: &Params,
    scratch: &mut Scratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) -> Result<(), Error> {
    compute_on(Path::available()[0], left, right, params, scratch, tiles, out)
}

/// [`compute`] with a chosen implementation.
///
/// # Errors
/// As [`compute`].
pub fn compute_on(
    path: Path,
    left: &View<'_>,
    right: &View<'_>,
    params: &Params,
    scratch: &mut Scratch,
    tiles: &dyn Tiles,
    out: &mut [i16],
) -> Result<(), Error> {
    params.check()?;
    check_shapes(left, right, out.len())?;
    let search = Search::new(params, left.width, left.height, left.channels);
    if (left.width as i64) < search.least_width() {
        return Err(Error::Narrow { width: left.width, needed: search.least_width() });
    }
    let _ = (scratch, tiles);
    match path {
        Path::Plain => plain::compute(&search, params.block, left, right, out),
    }
    plain::finish(&search, params.speckle_window, params.speckle_range, out);
    Ok(())
}
