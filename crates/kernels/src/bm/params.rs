//! What a caller chooses, and which choices OpenCV refuses.

use crate::params::{ParamError, check_disparities, check_not_negative, check_side, unanswered};

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

impl Params {
    /// Whether OpenCV takes these parameters.
    ///
    /// # Errors
    /// The first parameter that it does not take.
    pub fn check(&self) -> Result<(), ParamError> {
        check_disparities(self.min_disparity, self.disparities, None)?;
        for (name, side) in [("block", self.block), ("prefilter_size", self.prefilter_size)] {
            check_side(name, side, &(5..=255))?;
        }
        if !(1..=63).contains(&self.prefilter_cap) {
            let what = format!("prefilter_cap is {}, which is not in 1..=63", self.prefilter_cap);
            return Err(ParamError::new("prefilter_cap", what));
        }
        check_not_negative("texture_threshold", self.texture_threshold)?;
        check_not_negative("uniqueness", self.uniqueness)
    }

    /// What an unanswered pixel holds: one pixel below the smallest disparity, in 1/16 px.
    #[must_use]
    pub const fn invalid(&self) -> i16 {
        unanswered(self.min_disparity)
    }
}

#[cfg(test)]
mod tests {
    use super::Params;

    #[test]
    fn opencvs_own_settings_are_legal() {
        assert_eq!(Params::default().check(), Ok(()));
        assert_eq!(Params { min_disparity: -64, speckle_range: -1, ..Params::default() }.check(), Ok(()));
    }

    #[test]
    fn what_opencv_refuses_is_refused() {
        let base = Params::default();
        for (params, name, told) in [
            (Params { disparities: 24, ..base.clone() }, "disparities", "which is not a positive multiple of 16"),
            (Params { min_disparity: 2000, ..base.clone() }, "min_disparity", "2000..2064 do not fit 16 bits"),
            (Params { block: 3, ..base.clone() }, "block", "block is 3, which is not odd and in 5..=255"),
            (Params { block: 257, ..base.clone() }, "block", "block is 257, which is not odd and in 5..=255"),
            (Params { prefilter_size: 6, ..base.clone() }, "prefilter_size", "prefilter_size is 6, which is not odd"),
            (
                Params { prefilter_cap: 0, ..base.clone() },
                "prefilter_cap",
                "prefilter_cap is 0, which is not in 1..=63",
            ),
            (Params { prefilter_cap: 64, ..base.clone() }, "prefilter_cap", "is 64, which is not in 1..=63"),
            (Params { texture_threshold: -1, ..base.clone() }, "texture_threshold", "which must not be negative"),
            (Params { uniqueness: -1, ..base }, "uniqueness", "uniqueness is -1, which must not be negative"),
        ] {
            let error = params.check().unwrap_err();
            assert_eq!(error.name, name);
            assert!(error.to_string().contains(told), "{error}");
        }
    }
}
