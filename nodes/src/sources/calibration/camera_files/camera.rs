//! Cameras of a calibration, whatever its format.

use depthloom_kernels::rectify::{Camera, Lens, Matrix, View};

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
pub(super) fn camera(k: &[f64; 9], lens: Lens) -> Camera {
    Camera { focal_px: [k[0], k[4]], centre_px: [k[2], k[5]], lens }
}

/// R and P are row-major.
pub(super) fn view(r: &[f64; 9], p: &[f64; 12]) -> (View, f64) {
    (View { rotation: matrix(r), focal_px: [p[0], p[5]], centre_px: [p[2], p[6]] }, p[3])
}

pub(super) fn matrix(numbers: &[f64; 9]) -> Matrix {
    std::array::from_fn(|row| std::array::from_fn(|column| numbers[3 * row + column]))
}
