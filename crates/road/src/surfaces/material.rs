//! What surfaces are made of: the colour at a point, as a pixel of finite size sees it, and whether there is anything
//! at all.

use crate::light::Light;
use crate::surfaces::car::{CarSkin, WheelSkin};
use crate::surfaces::facade::Facade;
use crate::surfaces::spot::{Spot, plain_noise};
use crate::surfaces::texture::{faded, noise2, noise3, pulses, slab};
use crate::vector::{Vec3, vec3};

/// A material with its parameters.
#[derive(Clone, Debug)]
pub(crate) enum Material {
    Facade(Box<Facade>),
    CarBody(CarSkin),
    CarCabin(CarSkin),
    Wheel(WheelSkin),
    /// Almost one colour, with noise of this contrast: plaster, concrete, cloth, metal.
    Plain {
        colour: Vec3,
        contrast: f32,
        seed: u32,
    },
    RoofTiles {
        colour: Vec3,
        seed: u32,
    },
    Bark {
        seed: u32,
    },
    /// Leaves; `holes` is the share of the surface that one sees through.
    Leaves {
        colour: Vec3,
        holes: f32,
        seed: u32,
    },
    /// Upright bars every `period` metres between two rails.
    Railing {
        colour: Vec3,
        period: f32,
        top: f32,
    },
    /// A sign or poster: bold shapes in two colours.
    Poster {
        ground: Vec3,
        figure: Vec3,
        cells_per_metre: f32,
        seed: u32,
    },
}

impl Material {
    pub(crate) const fn is_of_a_car(&self) -> bool {
        matches!(self, Self::CarBody(_) | Self::CarCabin(_) | Self::Wheel(_))
    }

    /// Whether the surface exists at this point.
    pub(crate) fn is_solid(&self, point: Vec3) -> bool {
        match self {
            Self::Leaves { holes, seed, .. } => {
                let coarse = noise3(*seed, point.x, point.y, point.z, 2.0);
                let fine = noise3(seed.rotate_left(5), point.x, point.y, point.z, 8.0);
                0.5 + 0.5 * (0.55 * coarse + 0.45 * fine) > *holes
            }
            Self::Railing { period, top, .. } => {
                let along = point.z + point.x;
                let up = point.y;
                up > top - 0.05 || (up < 0.3 && up > 0.24) || pulses(along, *period, 0.022, 1e-4) > 0.5
            }
            _ => true,
        }
    }

    /// Whether [`Material::is_solid`] can be false.
    pub(crate) fn has_holes(&self) -> bool {
        match self {
            Self::Leaves { holes, .. } => *holes > 0.0,
            Self::Railing { .. } => true,
            _ => false,
        }
    }

    /// Share of a scanner's pulses that come back, of 255: panes let them through.
    pub(crate) fn reflectivity(&self) -> u8 {
        match self {
            Self::CarCabin(_) => 90,
            Self::CarBody(_) => 215,
            Self::Leaves { .. } => 200,
            Self::Facade(_) => 225,
            _ => 250,
        }
    }

    pub(crate) fn shade(&self, spot: &Spot, light: &Light, lit: bool) -> Vec3 {
        let colour = match self {
            Self::Facade(facade) => return facade.shade(spot, light, lit),
            Self::CarBody(skin) => return skin.body(spot, light, lit),
            Self::CarCabin(skin) => return skin.cabin(spot, light, lit),
            Self::Wheel(skin) => skin.colour(spot),
            Self::Plain { colour, contrast, seed } => {
                let wall = spot.on_wall();
                *colour * (1.0 + contrast * plain_noise(*seed, &wall))
            }
            Self::RoofTiles { colour, seed } => roof_tiles(*colour, *seed, spot),
            Self::Bark { seed } => {
                let p = spot.point;
                let coarse = faded(0.08, spot.footprint, || noise2(*seed, 4.0 * (p.z + p.x), p.y, 4.0));
                let fine = faded(0.05, spot.footprint, || noise2(seed ^ 9, 2.0 * (p.z - p.x), p.y, 16.0));
                vec3(0.105, 0.085, 0.065) * (1.0 + 0.35 * coarse + 0.35 * fine)
            }
            Self::Leaves { colour, seed, .. } => return leaves(*colour, *seed, spot, light, lit),
            Self::Railing { colour, .. } => *colour,
            Self::Poster { ground, figure, cells_per_metre, seed } => {
                let wall = spot.on_wall();
                let blob = noise2(*seed, wall.along, wall.up, *cells_per_metre);
                let edge = (wall.along_px * cells_per_metre).max(0.05);
                ground.mix(*figure, slab(blob, 0.12, 4.0, 2.0 * edge))
            }
        };
        light.reflected(colour, spot.normal, lit)
    }
}

fn roof_tiles(colour: Vec3, seed: u32, spot: &Spot) -> Vec3 {
    let p = spot.point;
    let row = pulses(p.y, 0.22, 0.05, spot.footprint);
    let tint = faded(0.4, spot.footprint, || noise2(seed, p.z, 2.0 * p.y, 2.0));
    colour * (1.0 - 0.45 * row) * (1.0 + 0.25 * tint)
}

fn leaves(colour: Vec3, seed: u32, spot: &Spot, light: &Light, lit: bool) -> Vec3 {
    let p = spot.point;
    let clumps = noise3(seed ^ 2, p.x, p.y, p.z, 2.0);
    let leaf = faded(0.1, spot.footprint, || noise3(seed ^ 3, p.x, p.y, p.z, 16.0));
    // Leaves face every way: the light on them varies more than a smooth surface's would.
    let tilt = (0.45 + 0.75 * leaf + 0.35 * clumps).clamp(0.05, 1.5);
    let sunny = if lit { 0.55 * tilt * (0.6 + 0.4 * spot.normal.dot(light.sun)) } else { 0.0 };
    let shaded = light.reflected(colour, spot.normal, false) * (0.45 + 0.4 * tilt);
    shaded + colour * (1.6 * sunny)
}
