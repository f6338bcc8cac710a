//! KITTI's calibrations: text files, and the known calibration of each recording day.

use std::path::Path;

use depthloom_graphs::Fault;
use depthloom_graphs::values::Calibration;

use crate::sources::calibration::rectified_pair::{self, NoPair, short};
use crate::sources::dataset::frame_files::File;
use crate::sources::files::named_lines::NamedLines;
use crate::sources::kitti::cameras::KittiCameras;

/// Metres, of the colour pair.
const BASELINE_M: f64 = 0.532_725;

const WANTED: &str = "a calibration file has two lines, `P_rect_02:` (left) and `P_rect_03:` (right), each with the 12 numbers of \
`f 0 cx -f*x 0 f cy 0 0 0 1 0`: px, and x, the camera's place to the right, in metres";

const CAMERAS: &str = "calib_cam_to_cam.txt has `S_rect_0x:` (width, height), `R_rect_00:` (9 numbers) and `P_rect_0x:` of both cameras (12 numbers, \
`f 0 cx -f*x 0 f cy 0 0 0 1 0`: px and metres): take it from the date's calibration zip again";
const SCANNERS: &str = "calib_velo_to_cam.txt has `R:` (9 numbers) and `T:` (3 numbers, metres): take it from the date's calibration zip again";

/// Width of the rectified image, focal length and principal point (column, row) of the left colour camera, px. Each
/// recording day has its own width.
const BY_WIDTH: [(u32, f64, f64, f64); 5] = [
    (1242, 721.5377, 609.5593, 172.854),
    (1241, 718.856, 607.1928, 185.2157),
    (1238, 718.3351, 600.3891, 181.5122),
    (1226, 707.0912, 601.8873, 183.1104),
    (1224, 707.0493, 604.0814, 180.5066),
];

/// The same text for every frame, so that it is printed once. Only the folder's name, because recordings store it.
pub(crate) fn assumption(folder: &Path) -> String {
    format!(
        "no calibration files in {}: depthloom uses KITTI's focal lengths by the width of the image (707 to 722 px) and its baseline of {BASELINE_M:.4} m",
        folder.file_name().unwrap_or(folder.as_os_str()).display(),
    )
}

pub(crate) fn by_width((width, height): (u32, u32)) -> Result<Calibration, Fault> {
    let day = BY_WIDTH.iter().find(|day| day.0 == width).ok_or_else(|| {
        let known: Vec<String> = BY_WIDTH.iter().map(|day| day.0.to_string()).collect();
        Fault::new(format!(
            "the focal length is unknown: there is no calibration file, and no camera of KITTI is {width} px wide ({})",
            known.join(", ")
        ))
        .remedy(format!("put calib_cam_to_cam/000150.txt for frame 000150_10 beside image_2 (KITTI's are in data_scene_flow_calib.zip): {WANTED}"))
    })?;
    let &(_, focal_px, cx_px, cy_px) = day;
    Ok(Calibration { width, height, focal_px, cx_px, cy_px, baseline_m: BASELINE_M, doffs_px: 0.0 })
}

const PROJECTIONS: &str = "a calibration file has the lines `P0:` to `P3:` (grey left, grey right, colour left, colour right), each with the 12 numbers of \
`f 0 cx -f*x 0 f cy 0 0 0 1 0`: px, and x, the camera's place to the right, in metres";

pub(crate) fn from_text(path: &Path, text: &str, size: (u32, u32)) -> Result<Calibration, Fault> {
    pair(&NamedLines::parse(path, text, ':', WANTED)?, KittiCameras::Color.rectified_projections(), size)
}

/// Reads the lines `P0` to `P3` of the older benchmarks.
pub(super) fn from_projections(file: &File, cameras: KittiCameras, size: (u32, u32)) -> Result<Calibration, Fault> {
    pair(&NamedLines::parse(&file.path, &file.text(), ':', PROJECTIONS)?, cameras.projections(), size)
}

pub(crate) fn pair(
    lines: &NamedLines<'_>,
    [left_name, right_name]: [&str; 2],
    (width, height): (u32, u32),
) -> Result<Calibration, Fault> {
    let (left_line, left) = lines.numbers::<12>(left_name)?;
    let (right_line, right) = lines.numbers::<12>(right_name)?;
    let pair = rectified_pair::calibration([left_name, right_name], [&left, &right], (width, height))
        .map_err(|NoPair { camera, what }| lines.fault(Some([left_line, right_line][camera]), what))?;
    if pair.doffs_px != 0.0 {
        let what = format!(
            "{right_name} has its principal point's column at {} px and {left_name} at {} px: KITTI's cameras have the same, so that what is \
             infinitely far has no disparity",
            short(right[2]),
            short(left[2])
        );
        return Err(lines.fault(Some(right_line), what));
    }
    Ok(pair)
}

pub(super) fn day_lines(file: &File) -> Result<NamedLines<'_>, Fault> {
    NamedLines::parse(&file.path, &file.text(), ':', CAMERAS)
}

/// A pair's calibration, for images of the size that the file names.
pub(super) fn of_day(lines: &NamedLines<'_>, cameras: KittiCameras, size: (u32, u32)) -> Result<Calibration, Fault> {
    let (line, [width, height]) = lines.numbers::<2>(cameras.size())?;
    if (width, height) != (f64::from(size.0), f64::from(size.1)) {
        let what = format!("{} states {width}x{height}, but the image is {}x{}", cameras.size(), size.0, size.1);
        return Err(lines.fault(Some(line), what).remedy("take image and calibration of one date"));
    }
    pair(lines, cameras.rectified_projections(), size)
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{by_width, from_text};

    const TEXT: &str = "calib_time: 09-Jan-2012 13:57:47
P_rect_02: 7.215377e+02 0.000000e+00 6.095593e+02 4.485728e+01 0.000000e+00 7.215377e+02 1.728540e+02 2.163791e-01 0.000000e+00 0.000000e+00 1.000000e+00 2.745884e-03
P_rect_03: 7.215377e+02 0.000000e+00 6.095593e+02 -3.395242e+02 0.000000e+00 7.215377e+02 1.728540e+02 2.199936e+00 0.000000e+00 0.000000e+00 1.000000e+00 2.729905e-03
";

    fn error(text: &str) -> String {
        from_text(Path::new("000150.txt"), text, (1242, 375)).unwrap_err().to_string()
    }

    #[test]
    fn kittis_own_file_gives_focal_length_and_baseline() {
        let calibration = from_text(Path::new("000150.txt"), TEXT, (1242, 375)).unwrap();
        assert_eq!(calibration.focal_px, 721.5377);
        assert_eq!((calibration.cx_px, calibration.cy_px), (609.5593, 172.854));
        assert!((calibration.baseline_m - 0.5327).abs() < 1e-4);
    }

    #[test]
    fn the_table_by_width_agrees_with_the_file_of_that_day() {
        let calibration = by_width((1242, 375)).unwrap();
        let file = from_text(Path::new("000150.txt"), TEXT, (1242, 375)).unwrap();
        assert_eq!(
            (calibration.focal_px, calibration.cx_px, calibration.cy_px),
            (file.focal_px, file.cx_px, file.cy_px)
        );
        assert!(by_width((640, 480)).is_err());
    }

    #[test]
    fn a_bad_line_is_named_by_its_number() {
        assert_eq!(
            error(&TEXT.replace("4.485728e+01", "x")),
            "000150.txt:2: P_rect_02 holds `x`, which is not a number"
        );
        assert_eq!(
            error(&TEXT.replace("2.729905e-03", "")),
            "000150.txt:3: P_rect_03 holds 11 numbers, expected the 12 of a 3x4 matrix"
        );
        assert_eq!(error("garbage"), "000150.txt:1: `garbage` has no `:` after a name");
        assert_eq!(error("P_rect_02: 1 2 nan 4"), "000150.txt:1: P_rect_02 holds `nan`, which is not a number");
    }

    #[test]
    fn fault_52_a_calibration_that_no_camera_has_is_refused_with_its_line_and_number() {
        for number in ["1e300", "1e-300", "-7", "2000000"] {
            let message = error(&TEXT.replace("7.215377e+02", number));
            assert!(message.starts_with(&format!("000150.txt:2: the focal length is {number} px")), "{message}");
        }
        let far = error(&TEXT.replace("-3.395242e+02", "-1e300"));
        assert!(far.starts_with("000150.txt:3: the baseline is 1.38") && far.contains("e297 m"), "{far}");
        let near = error(&TEXT.replace("-3.395242e+02", "44.857279"));
        assert!(near.starts_with("000150.txt:3: the baseline is 1.3"), "{near}");
        assert!(error(&TEXT.replace("6.095593e+02", "1e300")).contains("the principal point's column is 1e300 px"));
    }

    #[test]
    fn cameras_with_different_focal_lengths_or_principal_points_are_not_rectified() {
        let right = TEXT.find("P_rect_03").unwrap();
        let unlike =
            |from: &str, to: &str| error(&format!("{}{}", &TEXT[..right], TEXT[right..].replacen(from, to, 1)));
        assert_eq!(
            unlike("7.215377e+02", "6.500000e+02"),
            "000150.txt:3: P_rect_03 has a focal length of 650 px and P_rect_02 one of 721.5377 px: rectified cameras have the same"
        );
        assert!(
            unlike("6.095593e+02", "6.1e+02")
                .starts_with("000150.txt:3: P_rect_03 has its principal point's column at 610 px")
        );
        assert!(
            unlike("1.728540e+02", "1.7e+02")
                .starts_with("000150.txt:3: P_rect_03 has its principal point's row at 170 px")
        );
        let nearly = format!("{}{}", &TEXT[..right], TEXT[right..].replacen("7.215377e+02", "7.215378e+02", 1));
        assert!(from_text(Path::new("000150.txt"), &nearly, (1242, 375)).is_ok(), "the last digit that KITTI writes");
    }

    #[test]
    fn missing_cameras_and_impossible_ones_are_errors() {
        assert_eq!(error(""), "000150.txt: there is no line `P_rect_02`");
        assert!(error(&TEXT.replace("P_rect_03", "P_rect_01")).ends_with("there is no line `P_rect_03`"));
        assert!(error(&TEXT.replace("7.215377e+02", "0")).contains("000150.txt:2: the focal length is 0 px, expected"));
        assert!(error(&TEXT.replace("-3.395242e+02", "3.395242e+02")).contains("m right of the left one"));
    }
}
