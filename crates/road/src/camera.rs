//! The two cameras of one frame: where they are, which ray belongs to a pixel and which pixel to a point.

use crate::frame::{Calibration, Size};
use crate::vector::{Vec3, vec3};

/// KITTI's rectified colour cameras at [`Size::KITTI`].
const FOCAL_PX: f64 = 721.5377;
const CX_PX: f64 = 609.5593;
const CY_PX: f64 = 172.854;
const BASELINE_M: f64 = 0.532_725;
/// Height of the cameras above the road, metres.
pub(crate) const HEIGHT_M: f32 = 1.65;

/// The calibration at any size: focal length and principal point shrink with the image (pixels stay square).
pub(crate) fn calibration(size: Size) -> Calibration {
    let across = size.width as f64 / Size::KITTI.width as f64;
    let down = size.height as f64 / Size::KITTI.height as f64;
    Calibration { focal_px: FOCAL_PX * across, cx_px: CX_PX * across, cy_px: CY_PX * down, baseline_m: BASELINE_M }
}

/// A ray; one unit of its parameter is one metre of depth along the camera's axis, so the parameter at a hit *is* the
/// depth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
    /// Reciprocals of the direction's components.
    pub inverse: Vec3,
}

impl Ray {
    pub(crate) fn new(origin: Vec3, direction: Vec3) -> Self {
        // A component of exactly zero would make 0 * inf at a face through the origin.
        let nudge = |d: f32| if d.abs() < 1e-9 { 1e-9 } else { d };
        let direction = vec3(nudge(direction.x), nudge(direction.y), nudge(direction.z));
        Self { origin, direction, inverse: vec3(1.0 / direction.x, 1.0 / direction.y, 1.0 / direction.z) }
    }

    pub(crate) fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Camera {
    pub position: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    pub focal_px: f32,
    pub cx_px: f32,
    pub cy_px: f32,
}

impl Camera {
    /// A camera at `position` that looks along z, turned right by the slope `yaw` and down by the slope `pitch`.
    pub(crate) fn new(position: Vec3, yaw: f32, pitch: f32, calibration: &Calibration) -> Self {
        let forward = vec3(yaw, -pitch, 1.0).normalised();
        let right = vec3(forward.z, 0.0, -forward.x).normalised();
        let up = forward.cross(right);
        Self {
            position,
            right,
            up,
            forward,
            focal_px: calibration.focal_px as f32,
            cx_px: calibration.cx_px as f32,
            cy_px: calibration.cy_px as f32,
        }
    }

    /// The same camera moved along its rows by the baseline.
    pub(crate) fn moved_right(&self, metres: f32) -> Self {
        Self { position: self.position + self.right * metres, ..*self }
    }

    /// The ray through a place of the image, in pixels; pixel centres are whole numbers.
    pub(crate) fn ray(&self, column: f32, row: f32) -> Ray {
        let (x, y) = ((column - self.cx_px) / self.focal_px, (self.cy_px - row) / self.focal_px);
        Ray::new(self.position, self.forward + self.right * x + self.up * y)
    }

    /// Column, row and depth of a point; `None` if it is not in front of the camera.
    pub(crate) fn project(&self, point: Vec3) -> Option<(f32, f32, f32)> {
        let offset = point - self.position;
        let depth = offset.dot(self.forward);
        (depth > 0.05).then(|| {
            let scale = self.focal_px / depth;
            (self.cx_px + scale * offset.dot(self.right), self.cy_px - scale * offset.dot(self.up), depth)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_leads_back_to_its_pixel_and_its_parameter_is_depth() {
        let camera = Camera::new(vec3(1.5, HEIGHT_M, 700.0), 0.01, 0.004, &calibration(Size::KITTI));
        for (column, row) in [(0.0, 0.0), (609.0, 172.0), (1241.0, 374.0)] {
            let (u, v, depth) = camera.project(camera.ray(column, row).at(20.0)).expect("in front");
            assert!(
                (u - column).abs() < 0.02 && (v - row).abs() < 0.02 && (depth - 20.0).abs() < 1e-3,
                "{u} {v} {depth}"
            );
        }
    }

    #[test]
    fn intrinsics_shrink_with_the_image() {
        let small = calibration(Size { width: 621, height: 375 });
        assert!((small.focal_px - FOCAL_PX / 2.0).abs() < 1e-9);
        assert!((small.cy_px - CY_PX).abs() < 1e-9);
    }
}
