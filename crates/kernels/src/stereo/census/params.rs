//! What a caller chooses.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::memory::TooMuch;
use crate::stereo::params::{ParamError, check_disparities, check_percentage, invalid_value};

/// The comparisons in the 9x7 window around a pixel that form its feature.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Census {
    /// Pairs of opposite samples: 31 bits (Spangenberg et al. 2013; libSGM's default).
    #[default]
    Symmetric,
    /// The centre with each sample around it: 62 bits (Zabih and Woodfill 1994).
    Full,
    /// As `full`, without the centre's row and column: 48 bits (libSGM's `CENSUS_9x7`).
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

/// libSGM's parameters and defaults, except for `subpixel`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Number of disparities searched, px: a multiple of 16.
    #[schemars(range(min = 16, max = 256), extend("multipleOf" = 16))]
    pub disparities: i32,
    /// Smallest disparity searched, px. It may be negative.
    #[schemars(range(min = -2047, max = 2031))]
    pub min_disparity: i32,
    /// Penalty for a disparity step of one pixel between neighbours, bits (`P1`): at most `p2`.
    #[schemars(range(min = 0, max = 224))]
    pub p1: i32,
    /// Penalty for any larger step, bits (`P2`): at most 224 for `symmetric`, 193 for `full` and 207 for `off-axis`
    /// features.
    #[schemars(range(min = 0, max = 224))]
    pub p2: i32,
    /// Margin in per cent by which the best cost must be below all others except its neighbours' costs. 5 is libSGM's
    /// `uniqueness` of 0.95; 0 disables the check.
    #[schemars(range(min = 0, max = 99))]
    pub uniqueness: i32,
    /// Whether a parabola through the costs refines disparities to 1/16 px. Otherwise they are whole pixels.
    pub subpixel: bool,
    /// Largest difference that the left-right check allows, px (`LR_max_diff`); negative values disable the check.
    pub lr_max_diff: i32,
    /// Comparisons that form the feature of a pixel: `symmetric`, `full` or `off-axis`.
    pub census: Census,
    /// Number of paths along which costs are summed: 4 (horizontal, vertical) or 8 (also diagonal).
    #[schemars(extend("enum" = [4, 8]))]
    pub paths: i32,
}

impl Default for Params {
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
            paths: 8,
        }
    }
}

/// Why a pair was not matched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Error {
    /// A parameter is out of its range.
    Param(ParamError),
    /// The images are too large for this number of disparities.
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
        if ![4, 8].contains(&self.paths) {
            return Err(ParamError::new("paths", format!("paths is {}, expected 4 or 8", self.paths)));
        }
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

    /// The value of invalid pixels: one pixel below the smallest disparity, in 1/16 px.
    #[must_use]
    pub const fn invalid(&self) -> i16 {
        invalid_value(self.min_disparity)
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
