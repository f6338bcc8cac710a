//! What a caller chooses.

use std::fmt;

use crate::memory::TooMuch;
use crate::params::{ParamError, check_disparities, check_percentage, unanswered};

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

impl Params {
    /// Whether every parameter is in its range.
    ///
    /// # Errors
    /// The first that is not.
    pub fn check(&self) -> Result<(), ParamError> {
        check_disparities(self.min_disparity, self.disparities, Some(256))?;
        let (p1, p2, bits) = (self.p1, self.p2, self.census.bits());
        if !(0..=255 - bits).contains(&p2) {
            let most = 255 - bits;
            let what = format!("p2 is {p2}, outside 0..={most}: with features of {bits} bits, costs must fit a byte");
            return Err(ParamError::new("p2", what));
        }
        if !(0..=p2).contains(&p1) {
            return Err(ParamError::new("p1", format!("p1 is {p1}, outside 0..=p2, and p2 is {p2}")));
        }
        check_percentage("uniqueness", self.uniqueness)
    }

    /// What stands where there is no answer: one pixel below the smallest disparity, in 1/16 px.
    #[must_use]
    pub const fn invalid(&self) -> i16 {
        unanswered(self.min_disparity)
    }
}

#[cfg(test)]
mod tests {
    use super::{Census, Params};

    #[test]
    fn each_parameter_has_its_range() {
        let refused = |change: fn(&mut Params)| {
            let mut params = Params::default();
            change(&mut params);
            params.check().err().map(|error| (error.name, error.to_string()))
        };
        let not = |name, what: &str| Some((name, what.to_owned()));
        assert_eq!(refused(|_| {}), None);
        let what = "disparities is 272, which is not a multiple of 16 in 16..=256";
        assert_eq!(refused(|p| p.disparities = 272), not("disparities", what));
        assert_eq!(refused(|p| p.min_disparity = 1984).map(|(name, _)| name), Some("min_disparity"));
        assert_eq!(refused(|p| p.p2 = 224), None);
        let what = "p2 is 225, outside 0..=224: with features of 31 bits, costs must fit a byte";
        assert_eq!(refused(|p| p.p2 = 225), not("p2", what));
        let what = "p2 is 194, outside 0..=193: with features of 62 bits, costs must fit a byte";
        assert_eq!(refused(|p| (p.p2, p.census) = (194, Census::Full)), not("p2", what));
        assert_eq!(refused(|p| (p.p2, p.census) = (207, Census::OffAxis)), None);
        assert_eq!(refused(|p| p.p1 = 121), not("p1", "p1 is 121, outside 0..=p2, and p2 is 120"));
        assert_eq!(refused(|p| p.p1 = -1), not("p1", "p1 is -1, outside 0..=p2, and p2 is 120"));
        assert_eq!(refused(|p| p.uniqueness = 100).map(|(name, _)| name), Some("uniqueness"));
    }
}
