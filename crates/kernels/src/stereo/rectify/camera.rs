//! A camera with its lens.

/// How a lens moves the point (x, y) = (X / Z, Y / Z) of its image plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// Brown and Conrady's polynomial with a rational radial part, coefficients in OpenCV's order: k1 k2 p1 p2 k3 k4 k5
    /// k6. ROS' `plumb_bob` has the first five, its `rational_polynomial` all; no distortion is zeros.
    Polynomial([f64; 8]),
    /// Kannala and Brandt's: the angle to the axis, `theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`, is
    /// the distance from the centre. OpenCV's `fisheye`, ROS' and Kalibr's `equidistant`.
    Equidistant([f64; 4]),
}

impl Lens {
    /// Whether it moves no point.
    #[must_use]
    pub fn is_none(&self) -> bool {
        matches!(self, Self::Polynomial(coefficients) if coefficients.iter().all(|k| *k == 0.0))
    }

    /// Where a point of the image plane is seen.
    pub(super) fn distorted(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        match *self {
            Self::Polynomial([k1, k2, p1, p2, k3, k4, k5, k6]) => {
                let (x2, y2, xy2) = (x * x, y * y, 2.0 * x * y);
                let r2 = x2 + y2;
                let radial = (1.0 + ((k3 * r2 + k2) * r2 + k1) * r2) / (1.0 + ((k6 * r2 + k5) * r2 + k4) * r2);
                [x * radial + p1 * xy2 + p2 * (r2 + 2.0 * x2), y * radial + p1 * (r2 + 2.0 * y2) + p2 * xy2]
            }
            Self::Equidistant([k1, k2, k3, k4]) => {
                let r = (x * x + y * y).sqrt();
                if r == 0.0 {
                    return [x, y];
                }
                let theta = libm::atan(r);
                let t2 = theta * theta;
                let (t4, t6) = (t2 * t2, t2 * t2 * t2);
                let seen = theta * (1.0 + k1 * t2 + k2 * t4 + k3 * t6 + k4 * (t4 * t4));
                [x * seen / r, y * seen / r]
            }
        }
    }
}

/// A camera with its lens: a point of the image plane is seen at `focal * (x, y) + centre`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Focal length along rows and columns, px.
    pub focal_px: [f64; 2],
    /// Principal point, column and row, px.
    pub centre_px: [f64; 2],
    /// The lens.
    pub lens: Lens,
}

/// Iterations for the inverse of a polynomial: the default of OpenCV's `undistortPoints`, converged or not.
const ITERATIONS: usize = 5;
/// Most iterations for an angle, and its accuracy in radians: those of `fisheye::undistortPoints`.
const ANGLE_ITERATIONS: usize = 10;
const ANGLE_EXACT: f64 = 1e-8;

impl Camera {
    /// The pixel where a point of the image plane is seen.
    pub(super) fn pixel(&self, point: [f64; 2]) -> [f64; 2] {
        let seen = self.lens.distorted(point);
        [0, 1].map(|axis| self.focal_px[axis] * seen[axis] + self.centre_px[axis])
    }

    /// The point of the image plane that is seen at a pixel; `None` if there is no such point, or the search fails.
    pub(super) fn point(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let seen = [0, 1].map(|axis| (pixel[axis] - self.centre_px[axis]) / self.focal_px[axis]);
        match self.lens {
            Lens::Polynomial(coefficients) => Some(polynomial(coefficients, seen)),
            Lens::Equidistant(coefficients) => equidistant(coefficients, seen),
        }
    }
}

/// By [`ITERATIONS`] of a fixed point.
fn polynomial([k1, k2, p1, p2, k3, k4, k5, k6]: [f64; 8], seen: [f64; 2]) -> [f64; 2] {
    let [mut x, mut y] = seen;
    for _ in 0..ITERATIONS {
        let r2 = x * x + y * y;
        let inverse = (1.0 + ((k6 * r2 + k5) * r2 + k4) * r2) / (1.0 + ((k3 * r2 + k2) * r2 + k1) * r2);
        if inverse < 0.0 {
            return seen;
        }
        let aside = [2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y];
        [x, y] = [0, 1].map(|axis| (seen[axis] - aside[axis]) * inverse);
    }
    [x, y]
}

/// By Newton's iteration for the angle.
fn equidistant([k1, k2, k3, k4]: [f64; 4], seen: [f64; 2]) -> Option<[f64; 2]> {
    let distance = (seen[0] * seen[0] + seen[1] * seen[1]).sqrt();
    if distance <= ANGLE_EXACT {
        return Some([0.0; 2]);
    }
    let mut theta = distance;
    for _ in 0..ANGLE_ITERATIONS {
        let t2 = theta * theta;
        let [a, b, c, d] = [k1 * t2, k2 * t2 * t2, k3 * t2 * t2 * t2, k4 * t2 * t2 * t2 * t2];
        let step = (theta * (1.0 + a + b + c + d) - distance) / (1.0 + 3.0 * a + 5.0 * b + 7.0 * c + 9.0 * d);
        theta -= step;
        if step.abs() < ANGLE_EXACT {
            let is_in_front = theta > 0.0 && theta < std::f64::consts::FRAC_PI_2;
            return is_in_front.then(|| seen.map(|of| of * libm::tan(theta) / distance));
        }
    }
    None
}
