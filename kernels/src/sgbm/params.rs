//! What a caller chooses, and which choices OpenCV documents.

use std::fmt;

/// Which directions are summed, and how OpenCV names the choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Five directions: left, right, and three from the row above (`MODE_SGBM`).
    #[default]
    Sgbm,
    /// Eight directions, two passes over the image (`MODE_HH`).
    Hh,
    /// Left, right and down, in four overlapping stripes (`MODE_SGBM_3WAY`).
    ThreeWay,
    /// Left, right, down and up (`MODE_HH4`).
    Hh4,
}

/// OpenCV's parameters of `StereoSGBM`, under the names of this project.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Params {
    /// Smallest disparity searched, px (`minDisparity`); may be negative.
    pub min_disparity: i32,
    /// How many disparities are searched (`numDisparities`): a positive multiple of 16.
    pub disparities: i32,
    /// Side of the matched block, px (`blockSize`): odd.
    pub block: i32,
    /// Penalty for a disparity change of one between neighbours (`P1`); 0 stands for OpenCV's 2.
    pub p1: i32,
    /// Penalty for a larger change (`P2`), greater than `p1`; 0 stands for OpenCV's 5.
    pub p2: i32,
    /// Left-right check, px (`disp12MaxDiff`). OpenCV takes 0 and below as 1; only a huge value switches the check off.
    pub disp12_max_diff: i32,
    /// Clip of the x-Sobel prefilter (`preFilterCap`); OpenCV uses `max(cap, 15) | 1`.
    pub prefilter_cap: i32,
    /// Margin in per cent by which the best cost must beat the others (`uniquenessRatio`); 0 switches it off.
    pub uniqueness: i32,
    /// Largest region, px, that is removed as a speckle (`speckleWindowSize`); 0 switches it off.
    pub speckle_window: i32,
    /// Largest disparity step inside a region, px (`speckleRange`).
    pub speckle_range: i32,
    /// Directions.
    pub mode: Mode,
}

impl Default for Params {
    /// The project's golden settings (`design/conventions.md`): five directions, 64 disparities, no checks.
    fn default() -> Self {
        Self {
            min_disparity: 0,
            disparities: 64,
            block: 5,
            p1: 200,
            p2: 800,
            disp12_max_diff: -1,
            prefilter_cap: 63,
            uniqueness: 0,
            speckle_window: 0,
            speckle_range: 0,
            mode: Mode::Sgbm,
        }
    }
}

/// A parameter outside what OpenCV documents or what its 16-bit arithmetic can hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ParamError {
    /// `disparities` is not a positive multiple of 16.
    Disparities(i32),
    /// `block` is not odd and positive.
    Block(i32),
    /// A penalty is negative or above 32767.
    Penalty(&'static str, i32),
    /// `p2` is not greater than `p1`: both as OpenCV would use them.
    PenaltyOrder(i32, i32),
    /// `uniqueness` is not in 0..=99.
    Uniqueness(i32),
    /// A parameter that must not be negative is.
    Negative(&'static str, i32),
    /// Disparities of the range do not fit 16 bits of 1/16 px.
    Range(i32, i32),
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Disparities(n) => write!(f, "disparities is {n}, which is not a positive multiple of 16"),
            Self::Block(n) => write!(f, "block is {n}, which is not odd and at least 1"),
            Self::Penalty(name, n) => write!(f, "{name} is {n}, outside 0..=32767, OpenCV's 16-bit costs"),
            Self::PenaltyOrder(p1, p2) => {
                write!(f, "p2 must be greater than p1, yet p1 is {p1} and p2 is {p2} (0 stands for 2 and 5)")
            }
            Self::Uniqueness(n) => write!(f, "uniqueness is {n}, which is not a percentage in 0..=99"),
            Self::Negative(name, n) => write!(f, "{name} is {n}, which must not be negative"),
            Self::Range(low, high) => {
                write!(f, "disparities {low}..{high} do not fit 16 bits of 1/16 px: they must lie in -2047..=2047")
            }
        }
    }
}

impl std::error::Error for ParamError {}

impl Params {
    /// Whether OpenCV documents these parameters as meaningful.
    ///
    /// # Errors
    /// The first parameter that is not, in the order of the fields.
    pub fn check(&self) -> Result<(), ParamError> {
        if self.disparities <= 0 || self.disparities % 16 != 0 {
            return Err(ParamError::Disparities(self.disparities));
        }
        let high = i64::from(self.min_disparity) + i64::from(self.disparities);
        if self.min_disparity < -2047 || high > 2047 {
            return Err(ParamError::Range(self.min_disparity, high.clamp(i32::MIN.into(), i32::MAX.into()) as i32));
        }
        if self.block < 1 || self.block % 2 == 0 {
            return Err(ParamError::Block(self.block));
        }
        for (name, value) in [("p1", self.p1), ("p2", self.p2)] {
            if !(0..=i32::from(i16::MAX)).contains(&value) {
                return Err(ParamError::Penalty(name, value));
            }
        }
        // Both zero is what OpenCV's factory defaults to, and means 2 and 5.
        if self.p2_used() <= self.p1_used() {
            return Err(ParamError::PenaltyOrder(self.p1, self.p2));
        }
        if self.prefilter_cap < 0 {
            return Err(ParamError::Negative("prefilter_cap", self.prefilter_cap));
        }
        if !(0..=99).contains(&self.uniqueness) {
            return Err(ParamError::Uniqueness(self.uniqueness));
        }
        for (name, value) in [("speckle_window", self.speckle_window), ("speckle_range", self.speckle_range)] {
            if value < 0 {
                return Err(ParamError::Negative(name, value));
            }
        }
        Ok(())
    }

    /// What an unanswered pixel holds: one pixel below the smallest disparity, in 1/16 px.
    #[must_use]
    pub fn invalid(&self) -> i16 {
        ((self.min_disparity - 1) * 16) as i16
    }

    /// P1 as OpenCV uses it.
    pub(super) fn p1_used(&self) -> i32 {
        if self.p1 > 0 { self.p1 } else { 2 }
    }

    /// P2 as OpenCV uses it, before it is raised above P1.
    pub(super) fn p2_used(&self) -> i32 {
        if self.p2 > 0 { self.p2 } else { 5 }
    }
}

#[cfg(test)]
mod tests {
    use super::{ParamError, Params};

    #[test]
    fn defaults_and_opencv_factory_penalties_are_legal() {
        assert_eq!(Params::default().check(), Ok(()));
        assert_eq!(Params { p1: 0, p2: 0, ..Params::default() }.check(), Ok(()));
        assert_eq!(Params { min_disparity: -64, ..Params::default() }.check(), Ok(()));
    }

    #[test]
    fn what_opencv_does_not_document_is_refused() {
        let base = Params::default();
        for (params, error) in [
            (Params { disparities: 0, ..base.clone() }, ParamError::Disparities(0)),
            (Params { disparities: 40, ..base.clone() }, ParamError::Disparities(40)),
            (Params { disparities: -16, ..base.clone() }, ParamError::Disparities(-16)),
            (Params { block: 4, ..base.clone() }, ParamError::Block(4)),
            (Params { block: 0, ..base.clone() }, ParamError::Block(0)),
            (Params { p1: -1, ..base.clone() }, ParamError::Penalty("p1", -1)),
            (Params { p2: 40_000, ..base.clone() }, ParamError::Penalty("p2", 40_000)),
            (Params { p1: 800, ..base.clone() }, ParamError::PenaltyOrder(800, 800)),
            (Params { p1: 5, p2: 0, ..base.clone() }, ParamError::PenaltyOrder(5, 0)),
            (Params { uniqueness: 100, ..base.clone() }, ParamError::Uniqueness(100)),
            (Params { uniqueness: -1, ..base.clone() }, ParamError::Uniqueness(-1)),
            (Params { prefilter_cap: -3, ..base.clone() }, ParamError::Negative("prefilter_cap", -3)),
            (Params { speckle_window: -1, ..base.clone() }, ParamError::Negative("speckle_window", -1)),
            (Params { min_disparity: 2000, ..base.clone() }, ParamError::Range(2000, 2064)),
            (Params { min_disparity: i32::MAX, ..base }, ParamError::Range(i32::MAX, i32::MAX)),
        ] {
            assert_eq!(params.check(), Err(error));
        }
    }

    #[test]
    fn errors_name_the_value_and_the_remedy() {
        let error = Params { disparities: 40, ..Params::default() }.check().unwrap_err();
        assert_eq!(error.to_string(), "disparities is 40, which is not a positive multiple of 16");
    }
}
