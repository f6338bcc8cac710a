//! What a caller chooses.

use std::fmt;
use std::ops::RangeInclusive;

use crate::memory::TooMuch;

/// Which comparisons in the 9x7 window around a pixel make its feature.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Census {
    /// Each of the 31 pairs of samples opposite each other: is the first brighter? (`SYMMETRIC_CENSUS_9x7` of libSGM.)
    #[default]
    Symmetric,
    /// Each of the 62 samples around the centre: is the centre brighter? (The transform of the paper.)
    Full,
    /// As `Full`, without the centre's row and column: 48 samples (`CENSUS_9x7` of libSGM).
    OffAxis,
}

impl Census {
    /// Bits of a feature, and so the largest cost of a match.
    #[must_use]
    pub const fn bits(self) -> i32 {
        match self {
            Self::Symmetric => 31,
            Self::Full => 62,
            Self::OffAxis => 48,
        }
    }
}

/// Along which paths costs are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Paths {
    /// Horizontal and vertical.
    Four,
    /// Horizontal, vertical and diagonal.
    #[default]
    Eight,
}

/// What to search, and what to believe.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Params {
    /// Smallest disparity searched, px; may be negative.
    pub min_disparity: i32,
    /// How many disparities are searched: a multiple of 16 in 16..=256.
    pub disparities: i32,
    /// Cost of a disparity change of one pixel between neighbours on a path, in bits: 0..=`p2`.
    pub p1: i32,
    /// Cost of any larger change, in bits: up to 255 less [`Census::bits`], so that a path's cost fits a byte.
    pub p2: i32,
    /// Per cent by which the best cost must be below all others but its neighbours', 0..=99; 0 switches the check off. libSGM's
    /// `uniqueness` of 0.95 is 5.
    pub uniqueness: i32,
    /// Whether a parabola through the costs refines the answer to 1/16 px.
    pub subpixel: bool,
    /// Largest difference between the left and the right map's answer, px; negative: not checked.
    pub lr_max_diff: i32,
    /// The feature.
    pub census: Census,
    /// The paths.
    pub paths: Paths,
}

impl Default for Params {
    /// libSGM's values with sub-pixel answers, for 64 disparities.
    fn default() -> Self {
        Self {
            min_disparity: 0,
            disparities: 64,
            p1: 10,
            p2: 120,
            uniqueness: 5,
            subpixel: true,
            lr_max_diff: 1,
            census: Census::Symmetric,
            paths: Paths::Eight,
        }
    }
}

/// A parameter outside of its range.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ParamError {
    /// `disparities` is no multiple of 16 in 16..=256.
    Disparities(i32),
    /// Disparities of the range do not fit 16 bits of 1/16 px.
    Range(i32, i32),
    /// `p2` is not in 0..=255 less the feature's bits.
    P2(i32, Census),
    /// `p1` is not in 0..=`p2`.
    P1(i32, i32),
    /// `uniqueness` is not in 0..=99.
    Uniqueness(i32),
}

/// Why a pair was not matched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Error {
    /// A parameter is out of its range.
    Param(ParamError),
    /// The images are too large for so many disparities.
    Memory(TooMuch),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Param(error) => error.fmt(f),
            Self::Memory(error) => error.fmt(f),
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

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Disparities(n) => write!(f, "disparities is {n}, which is not a multiple of 16 in 16..=256"),
            Self::Range(low, high) => {
                write!(f, "disparities {low}..{high} do not fit 16 bits of 1/16 px: they must lie in -2047..=2047")
            }
            Self::P2(p2, census) => {
                let bits = census.bits();
                write!(f, "p2 is {p2}, outside 0..={}: with features of {bits} bits, costs must fit a byte", 255 - bits)
            }
            Self::P1(p1, p2) => write!(f, "p1 is {p1}, outside 0..=p2, and p2 is {p2}"),
            Self::Uniqueness(n) => write!(f, "uniqueness is {n}, which is not a percentage in 0..=99"),
        }
    }
}

impl std::error::Error for ParamError {}

impl Params {
    /// Whether every parameter is in its range.
    ///
    /// # Errors
    /// The first that is not.
    pub fn check(&self) -> Result<(), ParamError> {
        let within = |range: RangeInclusive<i32>, value| range.contains(&value);
        if !within(16..=256, self.disparities) || self.disparities % 16 != 0 {
            return Err(ParamError::Disparities(self.disparities));
        }
        if !within(-2047..=2047 - self.disparities, self.min_disparity) {
            return Err(ParamError::Range(self.min_disparity, self.min_disparity.saturating_add(self.disparities)));
        }
        if !within(0..=255 - self.census.bits(), self.p2) {
            return Err(ParamError::P2(self.p2, self.census));
        }
        if !within(0..=self.p2, self.p1) {
            return Err(ParamError::P1(self.p1, self.p2));
        }
        if !within(0..=99, self.uniqueness) {
            return Err(ParamError::Uniqueness(self.uniqueness));
        }
        Ok(())
    }

    /// What stands where there is no answer: one pixel below the smallest disparity, in 1/16 px.
    #[must_use]
    pub const fn invalid(&self) -> i16 {
        ((self.min_disparity - 1) * 16) as i16
    }
}

#[cfg(test)]
mod tests {
    use super::{Census, ParamError, Params};

    #[test]
    fn each_parameter_has_its_range() {
        let refused = |change: fn(&mut Params)| {
            let mut params = Params::default();
            change(&mut params);
            params.check().err()
        };
        assert_eq!(refused(|_| {}), None);
        assert_eq!(refused(|p| p.disparities = 40), Some(ParamError::Disparities(40)));
        assert_eq!(refused(|p| p.disparities = 272), Some(ParamError::Disparities(272)));
        assert_eq!(refused(|p| p.disparities = 0), Some(ParamError::Disparities(0)));
        assert_eq!(refused(|p| p.min_disparity = 1984), Some(ParamError::Range(1984, 2048)));
        assert_eq!(refused(|p| p.min_disparity = i32::MIN), Some(ParamError::Range(i32::MIN, i32::MIN + 64)));
        assert_eq!(refused(|p| p.p2 = 224), None);
        assert_eq!(refused(|p| p.p2 = 225), Some(ParamError::P2(225, Census::Symmetric)));
        assert_eq!(refused(|p| (p.p2, p.census) = (194, Census::Full)), Some(ParamError::P2(194, Census::Full)));
        assert_eq!(refused(|p| (p.p2, p.census) = (207, Census::OffAxis)), None);
        assert_eq!(refused(|p| p.p1 = 121), Some(ParamError::P1(121, 120)));
        assert_eq!(refused(|p| p.p1 = -1), Some(ParamError::P1(-1, 120)));
        assert_eq!(refused(|p| p.uniqueness = 100), Some(ParamError::Uniqueness(100)));
    }
}
