//! The two pairs of cameras of KITTI's recordings, and the calibration files of a recording day.

use depthloom_graphs::Fault;
use depthloom_graphs::values::Calibration;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sources::dataset::frame_files::File;
use crate::sources::files::named_lines::NamedLines;
use crate::sources::kitti::calibration;

const CAMERAS: &str = "calib_cam_to_cam.txt has `S_rect_0x:` (width, height), `R_rect_00:` (9 numbers) and `P_rect_0x:` of both cameras (12 numbers, \
`f 0 cx -f*x 0 f cy 0 0 0 1 0`: px and metres): take it from the date's calibration zip again";
const SCANNERS: &str = "calib_velo_to_cam.txt has `R:` (9 numbers) and `T:` (3 numbers, metres): take it from the date's calibration zip again";

/// Which pair of cameras.
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

    const fn size(self) -> &'static str {
        match self {
            Self::Color => "S_rect_02",
            Self::Grey => "S_rect_00",
        }
    }
}

pub(super) fn lines(file: &File) -> Result<NamedLines<'_>, Fault> {
    NamedLines::parse(&file.path, &file.text(), ':', CAMERAS)
}

/// A pair's calibration, for images of the size that the file names.
pub(super) fn calibration(
    lines: &NamedLines<'_>,
    cameras: KittiCameras,
    size: (u32, u32),
) -> Result<Calibration, Fault> {
    let (line, [width, height]) = lines.numbers::<2>(cameras.size())?;
    if (width, height) != (f64::from(size.0), f64::from(size.1)) {
        let what = format!("{} says {width}x{height}, and the image is {}x{}", cameras.size(), size.0, size.1);
        return Err(lines.fault(Some(line), what).remedy("take image and calibration of one date"));
    }
    calibration::pair(lines, cameras.rectified_projections(), size)
}

/// From the scanner to the left image: `P_rect R_rect_00 [R|T]`, 3x4, row-major.
pub(super) fn scanner_projection(
    lines: &NamedLines<'_>,
    scanner: &File,
    cameras: KittiCameras,
) -> Result<[f64; 12], Fault> {
    let scanner = NamedLines::parse(&scanner.path, &scanner.text(), ':', SCANNERS)?;
    let ((_, r), (_, t)) = (scanner.numbers::<9>("R")?, scanner.numbers::<3>("T")?);
    let (_, rectify) = lines.numbers::<9>("R_rect_00")?;
    let (_, p) = lines.numbers::<12>(cameras.rectified_projections()[0])?;
    // Rectified camera coordinates from the scanner's, 4x4 without its last row.
    let places = || (0..3).flat_map(|row| (0..4).map(move |column| (row, column)));
    let mut turned = [0.0; 12];
    for (row, column) in places() {
        let from_scanner = |k: usize| if column == 3 { t[k] } else { r[3 * k + column] };
        turned[4 * row + column] = (0..3).map(|k| rectify[3 * row + k] * from_scanner(k)).sum();
    }
    let mut projection = [0.0; 12];
    for (row, column) in places() {
        let last = if column == 3 { p[4 * row + 3] } else { 0.0 };
        projection[4 * row + column] = (0..3).map(|k| p[4 * row + k] * turned[4 * k + column]).sum::<f64>() + last;
    }
    Ok(projection)
}
