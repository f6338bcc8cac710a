//! The entry: checks, and the choice between implementations.

use super::fast::{self, FastScratch, Set};
use super::search::Search;
use super::speckle::SpeckleScratch;
use super::view::check_shapes;
use super::{Error, Mode, Params, View, plain, speckle};
use crate::memory::{TooMuch, bytes_of};
use crate::tiles::Tiles;

/// Buffers that one call leaves for the next; any call may use any scratch.
#[derive(Debug, Default)]
pub struct Scratch {
    fast: FastScratch,
    speckle: SpeckleScratch,
}

/// An implementation. All give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// The plain scalar twin, on one thread.
    Plain,
    /// The fast implementation without named instructions.
    Portable,
    /// The fast implementation in AVX2.
    Avx2,
    /// The fast implementation in AVX-512.
    Avx512,
}

impl Path {
    /// The implementations this machine can run, fastest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        let mut paths: Vec<_> = Set::available().into_iter().map(Self::from).collect();
        paths.push(Self::Plain);
        paths
    }

    fn set(self) -> Option<Set> {
        Set::available().into_iter().find(|&set| Self::from(set) == self)
    }
}

impl From<Set> for Path {
    fn from(set: Set) -> Self {
        match set {
            Set::Portable => Self::Portable,
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => Self::Avx2,
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => Self::Avx512,
        }
    }
}

/// Disparities of `left`'s pixels in 1/16 px, [`Params::invalid`] where there is no answer; the fastest implementation
/// for this machine, spread over `tiles`.
///
/// # Errors
/// Parameters or shapes that OpenCV refuses or does not document ([`Params::check`]), an `out` of another size, and more memory
/// than there is for one call ([`MOST_BYTES`](crate::memory::MOST_BYTES)).
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

/// [`compute`] with a chosen implementation; the plain one where this machine has not the chosen one, and wherever 16-bit
/// costs might saturate.
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
    if matches!(params.mode, Mode::Hh | Mode::Hh4) {
        // Costs and sums of the whole image.
        TooMuch::check(bytes_of(&[2, search.row_len(), search.height], size_of::<i16>()))?;
    }
    match path.set() {
        Some(set) if fast::fits(&search) => {
            fast::compute(set, &search, params.block, [left, right], &mut scratch.fast, tiles, out)?;
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
