//! The images that are matched, and what can be wrong with them.

use std::fmt;

use super::Maps;
use crate::memory::TooMuch;
use crate::stereo::params::ParamError;

/// An 8-bit image, rows without gaps.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// `width * height * channels` bytes, row after row; colour interleaved (any order of the three channels gives the
    /// same disparities, since their costs are summed).
    pub data: &'a [u8],
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 1 (grey) or 3 (colour).
    pub channels: usize,
}

/// Why no disparities were computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Error {
    /// A parameter is refused.
    Param(ParamError),
    /// Left and right differ in size or channels: (width, height, channels) of each.
    Unequal((usize, usize, usize), (usize, usize, usize)),
    /// An image has neither one nor three channels, or no pixels, or is too large for 32-bit coordinates.
    Shape((usize, usize, usize)),
    /// The image is too narrow for the disparities and the block, as OpenCV sees it in this mode.
    Narrow {
        /// Columns of the image.
        width: usize,
        /// Columns it needs at least.
        needed: i64,
    },
    /// A buffer's length does not match the size of its image.
    Length {
        /// `left`, `right`, `out`, `right disparity` or `ambiguity`.
        buffer: &'static str,
        /// Elements it holds.
        len: usize,
        /// Elements it should hold.
        expected: usize,
    },
    /// The images are too large for this number of disparities: modes of two passes hold all costs.
    Memory(TooMuch),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Param(error) => error.fmt(f),
            Self::Memory(error) => error.fmt(f),
            Self::Unequal((w1, h1, c1), (w2, h2, c2)) => {
                write!(
                    f,
                    "left image is {w1}x{h1} with {c1} channels, right image {w2}x{h2} with {c2}: they must be equal"
                )
            }
            Self::Shape((w, h, c)) => {
                write!(
                    f,
                    "image is {w}x{h} with {c} channels: expected 1 or 3 channels and 1 to 32767 rows and columns"
                )
            }
            Self::Narrow { width, needed } => {
                write!(
                    f,
                    "image is {width} columns wide, too narrow for these disparities and block: at least {needed} are needed"
                )
            }
            Self::Length { buffer, len, expected } => {
                write!(f, "buffer `{buffer}` holds {len} elements where the size of the image requires {expected}")
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

impl From<TooMuch> for Error {
    fn from(error: TooMuch) -> Self {
        Self::Memory(error)
    }
}

impl<'a> View<'a> {
    pub(super) fn row(&self, y: usize) -> &'a [u8] {
        let stride = self.width * self.channels;
        &self.data[y * stride..][..stride]
    }

    fn shape(&self) -> (usize, usize, usize) {
        (self.width, self.height, self.channels)
    }
}

/// Checks both images and the maps against each other.
pub(super) fn check_shapes(left: &View<'_>, right: &View<'_>, maps: &Maps<'_>) -> Result<(), Error> {
    if left.shape() != right.shape() {
        return Err(Error::Unequal(left.shape(), right.shape()));
    }
    let (width, height, channels) = left.shape();
    let sides = 1..=i16::MAX as usize;
    if !sides.contains(&width) || !sides.contains(&height) || !(channels == 1 || channels == 3) {
        return Err(Error::Shape(left.shape()));
    }
    let pixels = width * height;
    let Maps { disparity, right: right_view, ambiguity } = maps;
    for (buffer, len, expected) in [
        ("left", left.data.len(), pixels * channels),
        ("right", right.data.len(), pixels * channels),
        ("out", disparity.len(), pixels),
        ("right disparity", right_view.as_ref().map_or(pixels, |map| map.len()), pixels),
        ("ambiguity", ambiguity.as_ref().map_or(pixels, |map| map.len()), pixels),
    ] {
        if len != expected {
            return Err(Error::Length { buffer, len, expected });
        }
    }
    Ok(())
}
