//! The crops of KITTI evaluations: the part of the image that is scored.

use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A crop, given as shares of the image's height and width; each bound is the product with the size in f64, truncated.
///
/// Garg: rows .40810811 to .99189189, columns .03594771 to .96405229; the usual one since monodepth. Eigen: rows
/// .3324324 to .91351351, columns .0359477 to .96405229.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(description = "The part of the image that is scored.")]
pub enum Crop {
    /// The whole image.
    #[default]
    None,
    /// Garg et al. 2016.
    Garg,
    /// Eigen et al. 2014.
    Eigen,
}

/// A part of an image: rows and columns, each from the first inside to the first outside.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Window {
    /// Rows.
    pub rows: Range<usize>,
    /// Columns.
    pub columns: Range<usize>,
}

impl Crop {
    /// The pixels inside, of an image of that size.
    #[must_use]
    pub fn window(self, width: usize, height: usize) -> Window {
        let ([top, bottom], [left, right]) = match self {
            Self::None => return Window { rows: 0..height, columns: 0..width },
            Self::Garg => ([0.408_108_11, 0.991_891_89], [0.035_947_71, 0.964_052_29]),
            Self::Eigen => ([0.332_432_4, 0.913_513_51], [0.035_947_7, 0.964_052_29]),
        };
        let at = |share: f64, size: usize| (share * size as f64) as usize;
        Window { rows: at(top, height)..at(bottom, height), columns: at(left, width)..at(right, width) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn garg_and_eigen_crops_of_a_kitti_image_are_those_of_the_literature() {
        // Rows 153..371 and columns 44..1197 of 375x1242 are the numbers published with monodepth. The Eigen bounds are
        // numpy's: np.array([.3324324*375, .91351351*375, .0359477*1242, .96405229*1242]).astype(int) = [124, 342, 44,
        // 1197].
        assert_eq!(Crop::Garg.window(1242, 375), Window { rows: 153..371, columns: 44..1197 });
        assert_eq!(Crop::Eigen.window(1242, 375), Window { rows: 124..342, columns: 44..1197 });
        assert_eq!(Crop::None.window(1242, 375), Window { rows: 0..375, columns: 0..1242 });
    }
}
