//! Daylight: the position of the sun, the light of the sky, and the effect of haze.

use crate::hash::Draws;
use crate::surfaces::texture::{floor, noise2};
use crate::vector::{Vec3, vec3};

/// Light on the street, fixed for a street.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Light {
    /// Towards the sun, unit length.
    pub sun: Vec3,
    sun_colour: Vec3,
    ambient: Vec3,
    haze: Vec3,
    seed: u32,
}

/// Depth at which haze halves the contrast, metres.
const HAZE_METRES: f32 = 420.0;

impl Light {
    pub(crate) fn new(seed: u64) -> Self {
        let mut draws = Draws::new(seed, 1, 0);
        let side = if draws.chance(0.5) { 1.0 } else { -1.0 };
        let sun =
            vec3(side * draws.between(0.35, 0.75), draws.between(0.6, 1.0), draws.between(-0.6, 0.5)).normalised();
        let strength = draws.between(1.9, 2.5);
        Self {
            sun,
            sun_colour: vec3(1.0, 0.95, 0.86) * strength,
            ambient: vec3(0.135, 0.15, 0.18),
            haze: vec3(0.80, 0.86, 0.92),
            seed: draws.bits(),
        }
    }

    /// Light that leaves a matt surface of this colour towards the camera.
    pub(crate) fn reflected(&self, colour: Vec3, normal: Vec3, lit: bool) -> Vec3 {
        let sky = self.ambient * (0.7 + 0.3 * normal.y);
        let direct = if lit { normal.dot(self.sun).max(0.0) } else { 0.0 };
        colour.times(sky + self.sun_colour * direct)
    }

    /// What is seen where there is nothing: a bright, almost textureless sky.
    pub(crate) fn sky(&self, direction: Vec3) -> Vec3 {
        let height = direction.y / (direction.x.abs() + direction.z.abs() + 1e-6);
        let blue = (1.6 * height).clamp(0.0, 1.0);
        let cloud = 0.06 * noise2(self.seed, 6.0 * direction.x, 9.0 * direction.y, 0.5);
        vec3(1.25, 1.25, 1.22).mix(vec3(0.62, 0.80, 1.15), blue) * (1.0 + cloud)
    }

    /// What a pane mirrors in this direction: sky above a skyline of blocks, something far away whatever the pane's
    /// own distance.
    pub(crate) fn mirrored(&self, direction: Vec3) -> Vec3 {
        let flat = direction.x.abs() + direction.z.abs() + 1e-3;
        let (bearing, height) = (8.0 * direction.x / flat + 3.0 * direction.z.signum(), direction.y / flat);
        let column = floor(bearing * 1.5);
        let roof = 0.35 + 0.25 * noise2(self.seed ^ 0x51, column as f32, 0.5, 1.0);
        if height > roof {
            return self.sky(direction) * 0.8;
        }
        let shade = 0.22 + 0.16 * noise2(self.seed ^ 0x52, bearing * 2.0, height * 12.0, 1.0);
        vec3(shade, shade * 0.97, shade * 0.9)
    }

    /// Through `depth` metres of air.
    pub(crate) fn through_air(&self, radiance: Vec3, depth: f32) -> Vec3 {
        radiance.mix(self.haze, depth * depth / (depth * depth + HAZE_METRES * HAZE_METRES))
    }
}
