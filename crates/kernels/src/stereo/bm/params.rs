//! What a caller chooses, and which choices OpenCV refuses.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::stereo::params::{ParamError, check_disparities, check_not_negative, check_side, unanswered};

/// What is matched instead of brightness, under OpenCV's names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Prefilter {
    /// The horizontal Sobel derivative: `PREFILTER_XSOBEL`.
    #[default]
    Xsobel,
    /// The difference from the mean of a window: `PREFILTER_NORMALIZED_RESPONSE`.
    NormalizedResponse,
}

/// OpenCV's parameters of `StereoBM`, with OpenCV's defaults.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// How many disparities are searched, px (`numDisparities`): a multiple of 16.
    #[schemars(range(min = 16, max = 2032), extend("multipleOf" = 16))]
    pub disparities: i32,
    /// Smallest disparity searched, px (`minDisparity`); may be negative.
    #[schemars(range(min = -2047, max = 2031))]
    pub min_disparity: i32,
    /// Side of the matched block, px (`blockSize`): odd, less than the image's width and height.
    #[schemars(range(min = 5, max = 255), extend("not" = { "multipleOf": 2 }))]
    pub block: i32,
    /// What is matched (`preFilterType`): `xsobel` or `normalized-response`.
    pub prefilter: Prefilter,
    /// Side of the window of `normalized-response`, px (`preFilterSize`): odd.
    #[schemars(range(min = 5, max = 255), extend("not" = { "multipleOf": 2 }))]
    pub prefilter_size: i32,
    /// Clip of the prefilter (`preFilterCap`).
    #[schemars(range(min = 1, max = 63))]
    pub prefilter_cap: i32,
    /// Least sum of absolute prefiltered values in the block (`textureThreshold`); what has less is not answered.
    #[schemars(range(min = 0))]
    pub texture_threshold: i32,
    /// Per cent by which the best sum must beat all others (`uniquenessRatio`); 0 switches the check off.
    #[schemars(range(min = 0))]
    pub uniqueness: i32,
    /// Largest difference allowed by the left-right check, px (`disp12MaxDiff`); below 0 switches it off.
    pub disp12_max_diff: i32,
    /// Largest region, px, that the speckle filter removes (`speckleWindowSize`); 0 switches it off.
    #[schemars(range(min = 0))]
    pub speckle_window: i32,
    /// Largest disparity step inside a region of the speckle filter (`speckleRange`), in 1/16 px: `StereoBM` takes it
    /// so, `StereoSGBM` in px.
    #[schemars(range(min = 0))]
    pub speckle_range: i32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            min_disparity: 0,
            disparities: 64,
            block: 21,
            prefilter: Prefilter::Xsobel,
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
