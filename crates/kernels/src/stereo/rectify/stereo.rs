//! From two cameras to a rectified pair.

use super::camera::{Camera, Lens};
use super::map::View;
use super::matrix::{Matrix, cross, norm, product, rotation_about, times, transposed, vector_of};

/// A rectified pair: what both cameras are turned and projected to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectified {
    /// Left and right view, of one focal length and one principal point.
    pub views: [View; 2],
    /// The right camera's place in the left one's frame, along rows (1: of OpenCV's `P2[0,3] = f * x`), in the
    /// translation's unit: negative where it is to the right.
    pub translation: f64,
}

/// The rectification of two cameras, the right one of which sees a point of the left one's frame at
/// `rotation * point + translation`: OpenCV's `stereoRectify` with `CALIB_ZERO_DISPARITY`, for images of (width,
/// height) of both. `alpha` between 0 (no pixel without an image) and 1 (all pixels of both images are kept); `None`
/// leaves the focal length as it is. Where both lenses are equidistant it is `fisheye::stereoRectify`, with `alpha` as
/// its `balance`, 0 if `None`.
///
/// `None` if the lenses are of two kinds, a point of an equidistant lens is behind it, or the cameras are one above
/// the other or in one place.
#[must_use]
pub fn stereo_rectify(
    cameras: [&Camera; 2],
    (width, height): (u32, u32),
    rotation: &Matrix,
    translation: [f64; 3],
    alpha: Option<f64>,
) -> Option<Rectified> {
    // Both are turned by half of the rotation, then so that the line between them lies along rows.
    let half = rotation_about(vector_of(rotation).map(|component| -0.5 * component));
    let t = times(&half, translation);
    if t[0].abs() <= t[1].abs() {
        return None;
    }
    let across = cross(t, [if t[0] > 0.0 { 1.0 } else { -1.0 }, 0.0, 0.0]);
    let length = norm(across);
    let level = match length > 0.0 {
        true => across.map(|component| component * libm::acos((t[0].abs() / norm(t)).min(1.0)) / length),
        false => across,
    };
    let level = rotation_about(level);
    let turned = [product(&level, &transposed(&half)), product(&level, &half)];
    let right = times(&turned[1], translation)[0];

    let lenses = cameras.map(|camera| matches!(camera.lens, Lens::Equidistant(_)));
    if lenses[0] != lenses[1] {
        return None;
    }
    if lenses[0] {
        let views = equidistant(cameras, &turned, (width, height), alpha.unwrap_or(0.0).clamp(0.0, 1.0))?;
        return Some(Rectified { views, translation: right });
    }
    let size = [f64::from(width), f64::from(height)];
    let focal = 0.5 * (cameras[0].focal_px[1] + cameras[1].focal_px[1]);
    let mut centre = [0.0; 2];
    for (camera, turned) in cameras.iter().zip(&turned) {
        let mut mean = [0.0; 2];
        for corner in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
            // Points are floats of 32 bits there, before they are projected and after.
            let float = |number: f64| f64::from(number as f32);
            let [x, y] = camera.point([0, 1].map(|axis| corner[axis] * (size[axis] - 1.0)))?.map(float);
            let [x, y, z] = times(turned, [x, y, 1.0]);
            mean = [mean[0] + 0.25 * float(focal * (x * (1.0 / z))), mean[1] + 0.25 * float(focal * (y * (1.0 / z)))];
        }
        // One principal point for both: the mean of theirs.
        centre = [0, 1].map(|axis| centre[axis] + 0.5 * (0.5 * (size[axis] - 1.0) - mean[axis]));
    }
    let views = |focal: f64| [0, 1].map(|k| View { rotation: turned[k], focal_px: [focal; 2], centre_px: centre });
    let scale = match alpha {
        Some(alpha) => scale(cameras, &views(focal), size, alpha.min(1.0))?,
        None => 1.0,
    };
    Some(Rectified { views: views(scale * focal), translation: right })
}

/// Points of a grid along each axis, by which OpenCV finds what of a rectified image is seen.
const GRID: u32 = 9;

/// By how much the focal length grows so that nothing is black (`alpha` 0), nothing is lost (1), or something between.
fn scale(cameras: [&Camera; 2], views: &[View; 2], size: [f64; 2], alpha: f64) -> Option<f64> {
    let (mut inner, mut outer) = (f64::NEG_INFINITY, f64::INFINITY);
    for (camera, view) in cameras.iter().zip(views) {
        let mut inside = [[f64::NEG_INFINITY, f64::INFINITY]; 2];
        let mut around = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for row in 0..GRID {
            for column in 0..GRID {
                let at = [column, row];
                let share = at.map(|k| f64::from(k) / f64::from(GRID - 1));
                let [x, y] = camera.point([0, 1].map(|axis| share[axis] * (size[axis] - 1.0)))?;
                let seen = view.pixel(times(&view.rotation, [x, y, 1.0]));
                for axis in 0..2 {
                    around[axis] = [around[axis][0].min(seen[axis]), around[axis][1].max(seen[axis])];
                    if at[axis] == 0 {
                        inside[axis][0] = inside[axis][0].max(seen[axis]);
                    } else if at[axis] == GRID - 1 {
                        inside[axis][1] = inside[axis][1].min(seen[axis]);
                    }
                }
            }
        }
        for axis in 0..2 {
            let centre = view.centre_px[axis];
            let needed =
                |[low, high]: [f64; 2]| [centre / (centre - low), (size[axis] - 1.0 - centre) / (high - centre)];
            inner = needed(inside[axis]).into_iter().fold(inner, f64::max);
            outer = needed(around[axis]).into_iter().fold(outer, f64::min);
        }
    }
    Some(inner * (1.0 - alpha) + outer * alpha)
}

/// The views of equidistant lenses: of each the middles of the image's sides decide, `balance` between 0 (as large as
/// it has to be to lose them) and 1 (they all stay).
fn equidistant(
    cameras: [&Camera; 2],
    turned: &[Matrix; 2],
    (width, height): (u32, u32),
    balance: f64,
) -> Option<[View; 2]> {
    let (mut focal, mut centre) = (f64::INFINITY, [0.0; 2]);
    for (camera, turned) in cameras.iter().zip(turned) {
        // Half of an odd number is rounded down there.
        let size = [f64::from(width), f64::from(height)];
        let half = [f64::from(width / 2), f64::from(height / 2)];
        let sides = [[half[0], 0.0], [size[0], half[1]], [half[0], size[1]], [0.0, half[1]]];
        let aspect = camera.focal_px[0] / camera.focal_px[1];
        let mut points = [[0.0; 2]; 4];
        for (point, side) in points.iter_mut().zip(sides) {
            let [x, y] = camera.point(side)?;
            let [x, y, z] = times(turned, [x, y, 1.0]);
            *point = [x / z, aspect * y / z];
        }
        let mean = [0, 1].map(|axis| 0.25 * points.iter().map(|point| point[axis]).sum::<f64>());
        let size = [size[0], aspect * size[1]];
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for axis in 0..2 {
            for point in points {
                // The sides nearest to and farthest from the middle stand for all between them.
                let focal = 0.5 * size[axis] / (point[axis] - mean[axis]).abs();
                let is_end = points.iter().all(|other| other[axis] <= point[axis])
                    || points.iter().all(|other| other[axis] >= point[axis]);
                if is_end {
                    (least, most) = (least.min(focal), most.max(focal));
                }
            }
        }
        let own = balance * least + (1.0 - balance) * most;
        focal = focal.min(own / aspect);
        let at = [0.5 * size[0] - own * mean[0], (0.5 * size[1] - own * mean[1]) / aspect];
        centre = [0, 1].map(|axis| centre[axis] + 0.5 * at[axis]);
    }
    Some([0, 1].map(|k| View { rotation: turned[k], focal_px: [focal; 2], centre_px: centre }))
}
