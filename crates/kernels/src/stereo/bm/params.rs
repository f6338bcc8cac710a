//! What a caller chooses, and which choices OpenCV refuses.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::stereo::params::{ParamError, check_disparities, check_not_negative, check_side, invalid_value};

/// The quantity that is matched instead of brightness, under OpenCV's names.
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
    /// Number of disparities searched, px (`numDisparities`): a multiple of 16.
    #[schemars(range(min = 16, max = 2032), extend("multipleOf" = 16))]
    pub disparities: i32,
    /// Smallest disparity searched, px (`minDisparity`). It may be negative.
    #[schemars(range(min = -2047, max = 2031))]
    pub min_disparity: i32,
    /// Side of the matched block, px (`blockSize`): odd, less than the image's width and height.
    #[schemars(range(min = 5, max = 255), extend("not" = { "multipleOf": 2 }))]
    pub block: i32,
    /// Quantity that is matched (`preFilterType`): `xsobel` or `normalized-response`.
    pub prefilter: Prefilter,
    /// Side of the window of `normalized-response`, px (`preFilterSize`): odd.
    #[schemars(range(min = 5, max = 255), extend("not" = { "multipleOf": 2 }))]
    pub prefilter_size: i32,
    /// Bound at which prefiltered values are clipped (`preFilterCap`).
    #[schemars(range(min = 1, max = 63))]
    pub prefilter_cap: i32,
    /// Smallest sum of absolute prefiltered values in the block (`textureThreshold`). A pixel with a smaller sum is
    /// invalid.
    #[schemars(range(min = 0))]
    pub texture_threshold: i32,
    /// Margin in per cent by which the best sum must beat all others (`uniquenessRatio`); 0 disables the check.
    #[schemars(range(min = 0))]
    pub uniqueness: i32,
    /// Largest difference that the left-right check allows, px (`disp12MaxDiff`); negative values disable the check.
    pub disp12_max_diff: i32,
    /// Largest region that the speckle filter removes, px (`speckleWindowSize`); 0 disables the filter.
    #[schemars(range(min = 0))]
    pub speckle_window: i32,
    /// Largest disparity step inside a region of the speckle filter (`speckleRange`), in 1/16 px as in `StereoBM`. In
    /// `StereoSGBM` the unit is px.
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

    /// The value of invalid pixels: one pixel below the smallest disparity, in 1/16 px.
    #[must_use]
    pub const fn invalid(&self) -> i16 {
        invalid_value(self.min_disparity)
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
    fn values_refused_by_opencv_are_refused() {
        let base = Params::default();
        for (params, name, message) in [
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
            assert!(error.to_string().contains(message), "{error}");
        }
    }
}
