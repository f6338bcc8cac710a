//! Where a ray meets a surface, as materials see it.

use crate::surfaces::texture::{faded, noise_grazing};
use crate::vector::{Vec3, vec3};

/// A place on a surface and how it is looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    pub point: Vec3,
    pub normal: Vec3,
    /// Direction of the ray that got here.
    pub view: Vec3,
    /// Side of the patch that one pixel covers when it is looked at squarely, metres.
    pub footprint: f32,
}

impl Spot {
    /// The same patch along a tangent of the surface, where slanted views stretch it.
    pub(crate) fn stretched(&self, tangent: Vec3) -> f32 {
        let view = self.view.normalised();
        let facing = view.dot(self.normal).abs().max(0.02);
        let along = view.dot(tangent).abs();
        self.footprint * ((1.0 - along) + along / facing)
    }

    /// Direction of what a mirror here would show.
    pub(crate) fn mirror(&self) -> Vec3 {
        self.view - self.normal * (2.0 * self.view.dot(self.normal))
    }

    /// Horizontal and vertical coordinates on an upright wall, with the pixel's footprint along each; `along` is z on
    /// walls beside the street, x on walls that face the camera.
    pub(crate) fn on_wall(&self) -> Wall {
        if self.normal.x.abs() > self.normal.z.abs() {
            Wall {
                along: self.point.z,
                up: self.point.y,
                along_px: self.stretched(vec3(0.0, 0.0, 1.0)),
                up_px: self.footprint,
            }
        } else {
            Wall {
                along: self.point.x,
                up: self.point.y,
                along_px: self.stretched(vec3(1.0, 0.0, 0.0)),
                up_px: self.footprint,
            }
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Wall {
    pub along: f32,
    pub up: f32,
    pub along_px: f32,
    pub up_px: f32,
}

/// Stains and grain of an almost plain wall.
pub(crate) fn plain_noise(seed: u32, wall: &Wall) -> f32 {
    let at = |salt: u32, cells: f32| {
        faded(1.0 / cells, wall.up_px, || noise_grazing(seed ^ salt, wall.along, wall.up, cells, wall.along_px))
    };
    0.4 * at(0, 0.5) + 0.3 * at(1, 4.0) + 0.5 * at(2, 32.0)
}
