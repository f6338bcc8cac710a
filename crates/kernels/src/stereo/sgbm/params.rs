//! What a caller chooses, and which choices OpenCV documents.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::stereo::params::{
    ParamError, check_disparities, check_not_negative, check_percentage, check_side, invalid_value,
};

/// Directions along which costs are summed, under OpenCV's names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Five directions in one pass: `MODE_SGBM`, as in Martins et al. 2018.
    #[default]
    Sgbm,
    /// Eight directions in two passes: `MODE_HH`.
    Hh,
    /// Left, right and down, in four stripes: `MODE_SGBM_3WAY`.
    #[serde(rename = "3way")]
    ThreeWay,
    /// Left, right, down and up: `MODE_HH4`.
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
    /// Whether both images are matched with `max(min_disparity + disparities, 0)` copies of their first column before
    /// it, which are then cut off: so that the leftmost columns are searched too. Not a parameter of OpenCV; the result
    /// is OpenCV's on images extended with `cv::copyMakeBorder` and `BORDER_REPLICATE`.
    pub extend_left: bool,
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
            extend_left: false,
        }
    }
}

impl Params {
    /// Whether OpenCV documents these parameters as meaningful.
    ///
    /// # Errors
    /// The first parameter that is not, in the order of the fields.
    pub fn check(&self) -> Result<(), ParamError> {
        check_disparities(self.min_disparity, self.disparities, None)?;
        check_side("block", self.block, &(1..=i32::MAX))?;
        for (name, value) in [("p1", self.p1), ("p2", self.p2)] {
            if !(0..=i32::from(i16::MAX)).contains(&value) {
                let what = format!("{name} is {value}, outside 0..=32767, OpenCV's 16-bit costs");
                return Err(ParamError::new(name, what));
            }
        }
        // Both zero is what OpenCV's factory defaults to, and means 2 and 5.
        if self.p2_used() <= self.p1_used() {
            let (p1, p2) = (self.p1, self.p2);
            let what = format!("p2 must be greater than p1, yet p1 is {p1} and p2 is {p2} (0 stands for 2 and 5)");
            return Err(ParamError::new("p2", what));
        }
        check_not_negative("prefilter_cap", self.prefilter_cap)?;
        check_percentage("uniqueness", self.uniqueness)?;
        check_not_negative("speckle_window", self.speckle_window)?;
        check_not_negative("speckle_range", self.speckle_range)
    }

    /// The value of invalid pixels: one pixel below the smallest disparity, in 1/16 px.
    #[must_use]
    pub const fn invalid(&self) -> i16 {
        invalid_value(self.min_disparity)
    }

    /// The value of invalid pixels of the right image: one pixel below the smallest of its disparities, which are those
    /// of the left image, negated. In 1/16 px.
    #[must_use]
    pub const fn right_invalid(&self) -> i16 {
        invalid_value(1 - (self.min_disparity + self.disparities))
    }

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
    use super::Params;

    #[test]
    fn defaults_and_opencv_factory_penalties_are_legal() {
        assert_eq!(Params::default().check(), Ok(()));
        assert_eq!(Params { p1: 0, p2: 0, ..Params::default() }.check(), Ok(()));
        assert_eq!(Params { min_disparity: -64, ..Params::default() }.check(), Ok(()));
    }

    #[test]
    fn values_undocumented_by_opencv_are_refused() {
        let base = Params::default();
        let order = "p2 must be greater than p1, yet p1 is";
        for (params, name, message) in [
            (
                Params { disparities: 40, ..base.clone() },
                "disparities",
                "is 40, which is not a positive multiple of 16",
            ),
            (Params { min_disparity: 2000, ..base.clone() }, "min_disparity", "2000..2064 do not fit 16 bits"),
            (Params { block: 4, ..base.clone() }, "block", "block is 4, which is not odd and at least 1"),
            (Params { p1: -1, ..base.clone() }, "p1", "p1 is -1, outside 0..=32767, OpenCV's 16-bit costs"),
            (Params { p2: 40_000, ..base.clone() }, "p2", "p2 is 40000, outside 0..=32767, OpenCV's 16-bit costs"),
            (Params { p1: 800, ..base.clone() }, "p2", order),
            (Params { p1: 5, p2: 0, ..base.clone() }, "p2", order),
            (Params { uniqueness: 100, ..base.clone() }, "uniqueness", "is 100, which is not a percentage in 0..=99"),
            (Params { prefilter_cap: -3, ..base.clone() }, "prefilter_cap", "is -3, which must not be negative"),
            (Params { speckle_window: -1, ..base.clone() }, "speckle_window", "is -1, which must not be negative"),
            (Params { speckle_range: -1, ..base }, "speckle_range", "is -1, which must not be negative"),
        ] {
            let error = params.check().unwrap_err();
            assert_eq!(error.name, name);
            assert!(error.to_string().contains(message), "{error}");
        }
    }
}
