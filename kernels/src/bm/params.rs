//! What a caller chooses, and which choices OpenCV refuses.

use std::fmt;

/// What is matched instead of brightness.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Prefilter {
    /// The horizontal Sobel derivative (`PREFILTER_XSOBEL`).
    #[default]
    XSobel,
    /// The difference from the mean of a window (`PREFILTER_NORMALIZED_RESPONSE`).
    NormalizedResponse,
}

/// OpenCV's parameters of `StereoBM`, under the names of this project.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Params {
    /// Smallest disparity searched, px (`minDisparity`); may be negative.
    pub min_disparity: i32,
    /// How many disparities are searched (`numDisparities`): a positive multiple of 16.
    pub disparities: i32,
    /// Side of the matched block, px (`blockSize`): odd, 5..=255, less than the image's width and height.
    pub block: i32,
    /// What is matched (`preFilterType`).
    pub prefilter: Prefilter,
    /// Side of the window of [`Prefilter::NormalizedResponse`], px (`preFilterSize`): odd, 5..=255.
    pub prefilter_size: i32,
    /// Clip of the prefilter (`preFilterCap`): 1..=63.
    pub prefilter_cap: i32,
    /// Least sum of the block's absolute prefiltered values (`textureThreshold`); what has less is not answered.
    pub texture_threshold: i32,
    /// Margin in per cent by which the best sum must beat the others (`uniquenessRatio`); 0 switches it off.
    pub uniqueness: i32,
    /// Left-right check, px (`disp12MaxDiff`); below 0 switches it off.
    pub disp12_max_diff: i32,
    /// Largest region, px, that is removed as a speckle (`speckleWindowSize`); 0 and below switch it off.
    pub speckle_window: i32,
    /// Largest disparity step inside a region, **1/16 px** (`speckleRange`); below 0 switches the filter off.
    pub speckle_range: i32,
}

impl Default for Params {
    /// Those of OpenCV's `StereoBM::create`.
    fn default() -> Self {
        Self {
            min_disparity: 0,
            disparities: 64,
            block: 21,
            prefilter: Prefilter::XSobel,
            prefilter_size: 9,
            prefilter_cap: 31,
            texture_threshold: 10,
            uniqueness: 15,
            disp12_max_diff: -1,
            speckle_window: 0,
            speckle_range: 0,
        }
    }
}

/// A parameter that OpenCV refuses, or whose disparities do not fit its 16 bits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ParamError {
    /// `disparities` is not a positive multiple of 16.
    Disparities(i32),
    /// A window's side is not odd or not in 5..=255.
    Side(&'static str, i32),
    /// `prefilter_cap` is not in 1..=63.
    Cap(i32),
    /// A parameter that must not be negative is.
    Negative(&'static str, i32),
    /// Disparities of the range do not fit 16 bits of 1/16 px.
    Range(i32, i32),
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Disparities(n) => write!(f, "disparities is {n}, which is not a positive multiple of 16"),
            Self::Side(name, n) => write!(f, "{name} is {n}, which is not odd and in 5..=255"),
            Self::Cap(n) => write!(f, "prefilter_cap is {n}, which is not in 1..=63"),
            Self::Negative(name, n) => write!(f, "{name} is {n}, which must not be negative"),
            Self::Range(low, high) => {
                write!(f, "disparities {low}..{high} do not fit 16 bits of 1/16 px: they must lie in -2047..=2047")
            }
        }
    }
}

impl std::error::Error for ParamError {}

impl Params {
    /// Whether OpenCV takes these parameters.
    ///
    /// # Errors
    /// The first parameter that it does not take.
    pub fn check(&self) -> Result<(), ParamError> {
        if self.disparities <= 0 || self.disparities % 16 != 0 {
            return Err(ParamError::Disparities(self.disparities));
        }
        let high = i64::from(self.min_disparity) + i64::from(self.disparities);
        if self.min_disparity < -2047 || high > 2047 {
            return Err(ParamError::Range(self.min_disparity, high.clamp(i32::MIN.into(), i32::MAX.into()) as i32));
        }
        for (name, side) in [("block", self.block), ("prefilter_size", self.prefilter_size)] {
            if !(5..=255).contains(&side) || side % 2 == 0 {
                return Err(ParamError::Side(name, side));
            }
        }
        if !(1..=63).contains(&self.prefilter_cap) {
            return Err(ParamError::Cap(self.prefilter_cap));
        }
        for (name, value) in [("texture_threshold", self.texture_threshold), ("uniqueness", self.uniqueness)] {
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
}

#[cfg(test)]
mod tests {
    use super::{ParamError, Params};

    #[test]
    fn opencvs_own_settings_are_legal() {
        assert_eq!(Params::default().check(), Ok(()));
        assert_eq!(Params { min_disparity: -64, speckle_range: -1, ..Params::default() }.check(), Ok(()));
    }

    #[test]
    fn what_opencv_refuses_is_refused() {
        let base = Params::default();
        for (params, error) in [
            (Params { disparities: 0, ..base.clone() }, ParamError::Disparities(0)),
            (Params { disparities: 24, ..base.clone() }, ParamError::Disparities(24)),
            (Params { block: 3, ..base.clone() }, ParamError::Side("block", 3)),
            (Params { block: 8, ..base.clone() }, ParamError::Side("block", 8)),
            (Params { block: 257, ..base.clone() }, ParamError::Side("block", 257)),
            (Params { prefilter_size: 6, ..base.clone() }, ParamError::Side("prefilter_size", 6)),
            (Params { prefilter_cap: 0, ..base.clone() }, ParamError::Cap(0)),
            (Params { prefilter_cap: 64, ..base.clone() }, ParamError::Cap(64)),
            (Params { texture_threshold: -1, ..base.clone() }, ParamError::Negative("texture_threshold", -1)),
            (Params { uniqueness: -1, ..base.clone() }, ParamError::Negative("uniqueness", -1)),
            (Params { min_disparity: 2000, ..base }, ParamError::Range(2000, 2064)),
        ] {
            assert_eq!(params.check(), Err(error));
        }
    }
}
