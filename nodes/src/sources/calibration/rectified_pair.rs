//! The calibration of a rectified pair from two projections, and the numbers that a camera can have.

use std::ops::RangeInclusive;

use depthloom_graphs::values::Calibration;

/// From a fisheye to a telescope, from an endoscope to two aeroplanes.
pub(crate) const FOCAL_PX: RangeInclusive<f64> = 1.0..=1e6;
pub(crate) const CENTRE_PX: RangeInclusive<f64> = -1e6..=1e6;
pub(crate) const BASELINE_M: RangeInclusive<f64> = 1e-4..=1e4;

/// One unit in the last of KITTI's seven digits.
const FOCAL_TOLERANCE: f64 = 1.5e-6;
const CENTRE_TOLERANCE_PX: f64 = 1e-3;

#[derive(Debug)]
pub(crate) struct NoPair {
    /// 0 left, 1 right.
    pub camera: usize,
    pub what: String,
}

/// Projections are 3x4, row-major. The baseline is `Pr[0,3] / -Pr[0,0] - Pl[0,3] / -Pl[0,0]`, `doffs` is `Pr[0,2] -
/// Pl[0,2]`. Both cameras must have one focal length and one row of the principal point.
pub(crate) fn calibration(
    [left_name, right_name]: [&str; 2],
    [left, right]: [&[f64; 12]; 2],
    (width, height): (u32, u32),
) -> Result<Calibration, NoPair> {
    let of_right = |what: String| NoPair { camera: 1, what };
    for (camera, matrix) in [left, right].into_iter().enumerate() {
        let bounds = [
            (0, "the focal length", FOCAL_PX),
            (2, "the principal point's column", CENTRE_PX),
            (6, "the principal point's row", CENTRE_PX),
        ];
        for (at, what, possible) in bounds {
            if let Some(what) = out_of_bounds(what, matrix[at], &possible, "px") {
                return Err(NoPair { camera, what });
            }
        }
    }
    if (right[0] - left[0]).abs() > FOCAL_TOLERANCE * left[0] {
        return Err(of_right(format!(
            "{right_name} has a focal length of {} px and {left_name} one of {} px: rectified cameras have the same",
            short(right[0]),
            short(left[0])
        )));
    }
    if (right[6] - left[6]).abs() > CENTRE_TOLERANCE_PX {
        return Err(of_right(format!(
            "{right_name} has its principal point's row at {} px and {left_name} at {} px: rectified cameras have the same",
            short(right[6]),
            short(left[6])
        )));
    }
    let baseline_m = right[3] / -right[0] - left[3] / -left[0];
    if baseline_m <= 0.0 {
        return Err(of_right(format!("the right camera is {} m right of the left one", short(baseline_m))));
    }
    if let Some(what) = out_of_bounds("the baseline", baseline_m, &BASELINE_M, "m") {
        return Err(of_right(what));
    }
    let apart = right[2] - left[2];
    let doffs_px = if apart.abs() > CENTRE_TOLERANCE_PX { apart } else { 0.0 };
    Ok(Calibration { width, height, focal_px: left[0], cx_px: left[2], cy_px: left[6], baseline_m, doffs_px })
}

fn out_of_bounds(what: &str, number: f64, possible: &RangeInclusive<f64>, unit: &str) -> Option<String> {
    let (least, most) = (possible.start(), possible.end());
    (!possible.contains(&number))
        .then(|| format!("{what} is {} {unit}, expected {least} to {most} {unit}", short(number)))
}

/// A number of a calibration that no camera has.
#[derive(Debug)]
pub(crate) struct Implausible {
    pub is_baseline: bool,
    pub what: String,
}

pub(crate) fn check_plausible(calibration: &Calibration) -> Result<(), Implausible> {
    let numbers = [
        ("the focal length", calibration.focal_px, FOCAL_PX, "px"),
        ("the principal point's column", calibration.cx_px, CENTRE_PX, "px"),
        ("the principal point's row", calibration.cy_px, CENTRE_PX, "px"),
        ("the distance of the principal points", calibration.doffs_px, CENTRE_PX, "px"),
        ("the baseline", calibration.baseline_m, BASELINE_M, "m"),
    ];
    let wrong = numbers.into_iter().find_map(|(what, number, possible, unit)| {
        out_of_bounds(what, number, &possible, unit).map(|what| Implausible { is_baseline: unit == "m", what })
    });
    wrong.map_or(Ok(()), Err)
}

/// The principal point at the centre of an image; pixel centres have integer coordinates.
pub(crate) fn middle((width, height): (u32, u32)) -> (f64, f64) {
    ((f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0)
}

/// `1e300` without its zeros.
pub(crate) fn short(number: f64) -> String {
    if number == 0.0 || (1e-3..1e7).contains(&number.abs()) { number.to_string() } else { format!("{number:e}") }
}
