//! The two pairs of cameras of KITTI's recordings.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Camera pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum KittiCameras {
    /// The colour cameras, 02 and 03.
    #[default]
    Color,
    /// The grey cameras, 00 and 01.
    Grey,
}

impl KittiCameras {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Color => "color",
            Self::Grey => "grey",
        }
    }

    /// Folders of the raw data.
    pub(crate) const fn folders(self) -> [&'static str; 2] {
        match self {
            Self::Color => ["image_02", "image_03"],
            Self::Grey => ["image_00", "image_01"],
        }
    }

    /// Lines of `calib_cam_to_cam.txt`.
    pub(crate) const fn rectified_projections(self) -> [&'static str; 2] {
        match self {
            Self::Color => ["P_rect_02", "P_rect_03"],
            Self::Grey => ["P_rect_00", "P_rect_01"],
        }
    }

    /// Lines of the calibrations of the older benchmarks.
    pub(crate) const fn projections(self) -> [&'static str; 2] {
        match self {
            Self::Color => ["P2", "P3"],
            Self::Grey => ["P0", "P1"],
        }
    }

    /// Line of the left image's size in `calib_cam_to_cam.txt`.
    pub(crate) const fn size(self) -> &'static str {
        match self {
            Self::Color => "S_rect_02",
            Self::Grey => "S_rect_00",
        }
    }
}
