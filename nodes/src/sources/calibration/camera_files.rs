//! Calibrations of two cameras: OpenCV's `FileStorage` (YAML, XML, JSON), ROS' `camera_info` YAML, Kalibr's camchain.

mod document;
mod kalibr;
mod opencv;
mod ros;

use std::path::Path;

use depthloom_graphs::Fault;
use depthloom_kernels::rectify::{Camera, Lens, Matrix, View};

use document::Document;

pub(crate) const FORMS: &str = "a calibration is OpenCV's FileStorage (YAML, XML or JSON, in one file or two: M1, D1, M2, D2 and R, T, or R1, R2, P1, P2), two \
    camera_info YAML files of ROS (left, then right), or Kalibr's camchain YAML (cam0 left, cam1 right)";

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CalibratedCamera {
    pub size: Option<(u32, u32)>,
    pub camera: Camera,
    /// The rectified view, and element [0, 3] of its projection: `-f * x` of the camera's position.
    pub rectified: Option<(View, f64)>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CameraPair {
    pub cameras: [CalibratedCamera; 2],
    /// Rotation and translation from the left camera's frame to the right one's.
    pub pose: Option<(Matrix, [f64; 3])>,
    /// By the format's definition.
    pub in_metres: bool,
}

/// `fisheye`: OpenCV's coefficients are those of its `fisheye` module, which the file does not say.
pub(crate) fn read(files: &[(&Path, &[u8])], fisheye: bool) -> Result<CameraPair, Fault> {
    let documents = files.iter().map(|(path, bytes)| Document::parse(path, bytes)).collect::<Result<Vec<_>, _>>()?;
    let pair = match documents.as_slice() {
        [one] if kalibr::is(one) => kalibr::read(one),
        [left, right] if ros::is(left) && ros::is(right) => ros::read([left, right]),
        [one] if ros::is(one) => {
            Err(one.fault("it is the calibration of one camera").remedy(format!("name both: {FORMS}")))
        }
        // One of the two is ROS': the other should be, too.
        [left, right] if ros::is(left) || ros::is(right) => {
            let (other, side) = if ros::is(left) { (right, "right") } else { (left, "left") };
            let what = format!("it is not a complete calibration of the {side} camera: {}", ros::missing(other));
            Err(other.fault(what).remedy(format!("is the file cut off? {FORMS}")))
        }
        all => opencv::read(all, fisheye),
    }?;
    let determinant = |r: &Matrix| {
        r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1]) - r[0][1] * (r[1][0] * r[2][2] - r[1][2] * r[2][0])
            + r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0])
    };
    if pair.pose.is_some_and(|(rotation, _)| determinant(&rotation) < 0.0) {
        return Err(documents[0]
            .fault("the rotation between the cameras is a reflection: its determinant is negative".to_owned())
            .remedy(FORMS));
    }
    for (side, camera) in pair.cameras.iter().enumerate() {
        let numbers = [camera.camera.focal_px, camera.camera.centre_px].concat();
        let lens = match &camera.camera.lens {
            Lens::Polynomial(coefficients) => coefficients.as_slice(),
            Lens::Equidistant(coefficients) => coefficients.as_slice(),
        };
        let is_sound = numbers.iter().chain(lens).all(|number| number.is_finite() && number.abs() < 1e9)
            && camera.camera.focal_px.iter().all(|focal| *focal >= 1.0);
        if !is_sound {
            let side = ["left", "right"][side];
            return Err(documents[side_file(side, &documents)]
                .fault(format!("the {side} camera's numbers are no camera's: focal lengths {:?} px, principal point {:?} px, lens {lens:?}",
                    camera.camera.focal_px, camera.camera.centre_px))
                .remedy(FORMS));
        }
    }
    Ok(pair)
}

fn side_file(side: &str, documents: &[Document<'_>]) -> usize {
    if side == "right" && documents.len() == 2 && ros::is(&documents[1]) { 1 } else { 0 }
}

/// `model` as ROS, Kalibr and Foxglove name it.
pub(crate) fn lens(model: &str, coefficients: &[f64]) -> Result<Lens, String> {
    let shown = |what: &str| format!("{what}, and `{model}` has {} coefficients here", coefficients.len());
    let only = |count: usize| -> Result<(), String> {
        match coefficients.len() >= count && coefficients[count..].iter().all(|k| *k == 0.0) {
            true => Ok(()),
            false => Err(shown(&format!("{count} coefficients are known"))),
        }
    };
    let at = |at: usize| coefficients.get(at).copied().unwrap_or(0.0);
    match model {
        "plumb_bob" | "radtan" | "rational_polynomial" | "opencv" => {
            if coefficients.len() < 8 {
                if !matches!(coefficients.len(), 0 | 4 | 5) {
                    return Err(shown("a polynomial has 4, 5 or 8 coefficients"));
                }
            } else if only(8).is_err() {
                return Err(
                    "thin prisms and tilted sensors (coefficients beyond the eighth) are not rectified here".to_owned()
                );
            }
            Ok(Lens::Polynomial(std::array::from_fn(at)))
        }
        "equidistant" | "fisheye" | "kannala_brandt" | "kannala_brandt4" => {
            only(4)?;
            Ok(Lens::Equidistant(std::array::from_fn(at)))
        }
        "" | "none" if coefficients.iter().all(|k| *k == 0.0) => Ok(Lens::Polynomial([0.0; 8])),
        _ => Err(format!(
            "the lens `{model}` is not known: plumb_bob (radtan), rational_polynomial and equidistant (fisheye) are"
        )),
    }
}

/// K is row-major.
fn camera(k: &[f64; 9], lens: Lens) -> Camera {
    Camera { focal_px: [k[0], k[4]], centre_px: [k[2], k[5]], lens }
}

/// R and P are row-major.
fn view(r: &[f64; 9], p: &[f64; 12]) -> (View, f64) {
    (View { rotation: matrix(r), focal_px: [p[0], p[5]], centre_px: [p[2], p[6]] }, p[3])
}

fn matrix(numbers: &[f64; 9]) -> Matrix {
    std::array::from_fn(|row| std::array::from_fn(|column| numbers[3 * row + column]))
}
