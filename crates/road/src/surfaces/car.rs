//! Cars: a body with slanted ends, a tapered cabin with panes, wheels. Paint has next to no texture, panes mirror what
//! is far away.

use crate::light::Light;
use crate::surfaces::spot::Spot;
use crate::surfaces::texture::{faded, noise2, pulses, slab};
use crate::vector::{Vec3, vec3};

/// Sizes of one make, metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Make {
    pub length: f32,
    pub width: f32,
    /// Where the body ends and the panes begin.
    pub belt: f32,
    pub roof: f32,
    /// Cabin's front and rear ends at the belt, as shares of the half length, and how far the panes lean inwards.
    pub cabin_front: f32,
    pub cabin_rear: f32,
    pub lean_front: f32,
    pub lean_rear: f32,
}

pub(crate) const MAKES: [Make; 4] = [
    Make {
        length: 4.5,
        width: 1.76,
        belt: 0.92,
        roof: 1.43,
        cabin_front: 0.42,
        cabin_rear: -0.62,
        lean_front: 0.75,
        lean_rear: 0.6,
    },
    Make {
        length: 4.0,
        width: 1.70,
        belt: 0.94,
        roof: 1.47,
        cabin_front: 0.50,
        cabin_rear: -0.94,
        lean_front: 0.70,
        lean_rear: 0.25,
    },
    Make {
        length: 4.7,
        width: 1.78,
        belt: 0.93,
        roof: 1.48,
        cabin_front: 0.40,
        cabin_rear: -0.95,
        lean_front: 0.75,
        lean_rear: 0.30,
    },
    Make {
        length: 5.0,
        width: 1.92,
        belt: 1.15,
        roof: 2.05,
        cabin_front: 0.74,
        cabin_rear: -0.985,
        lean_front: 0.55,
        lean_rear: 0.05,
    },
];

pub(crate) const PAINTS: [Vec3; 9] = [
    vec3(0.45, 0.46, 0.47),
    vec3(0.30, 0.31, 0.32),
    vec3(0.66, 0.66, 0.65),
    vec3(0.02, 0.02, 0.022),
    vec3(0.05, 0.052, 0.06),
    vec3(0.03, 0.05, 0.14),
    vec3(0.25, 0.03, 0.03),
    vec3(0.05, 0.10, 0.08),
    vec3(0.16, 0.17, 0.18),
];

/// A car's looks and its own axes: `heading` is +1 if it drives along z, -1 against.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CarSkin {
    pub paint: Vec3,
    pub make: Make,
    pub x: f32,
    pub z: f32,
    pub heading: f32,
    pub seed: u32,
}

/// A wheel: hub in the middle of a tyre.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WheelSkin {
    pub y: f32,
    pub z: f32,
    pub spokes: bool,
}

impl WheelSkin {
    pub(crate) fn colour(&self, spot: &Spot) -> Vec3 {
        let (dy, dz) = (spot.point.y - self.y, spot.point.z - self.z);
        let radius = (dy * dy + dz * dz).sqrt();
        let rim = slab(radius, -1.0, 0.20, spot.footprint);
        let spoke =
            if self.spokes { 1.0 - 0.35 * slab((dy.abs() - dz.abs()).abs(), 0.04, 0.10, spot.footprint) } else { 0.9 };
        vec3(0.018, 0.018, 0.02).mix(vec3(0.22, 0.22, 0.23) * spoke, rim)
    }
}

impl CarSkin {
    /// Painted sheet with the few marks a car has: lamps, plates, grille, door gaps, handles, a dark sill.
    pub(crate) fn body(&self, spot: &Spot, light: &Light, lit: bool) -> Vec3 {
        let (p, px) = (spot.point, spot.footprint);
        let (side, ahead) = (p.x - self.x, (p.z - self.z) * self.heading);
        let half = 0.5 * self.make.length;
        let dust = 1.0 + 0.05 * faded(0.25, px, || noise2(self.seed, p.z, p.y + p.x, 4.0));
        let mut colour = self.paint * dust;
        let sill = slab(p.y, -1.0, 0.36, px);
        if spot.normal.x.abs() > 0.7 {
            let gap = slab((ahead - 0.12).abs(), 0.0, 0.008, px).max(slab((ahead + 0.95).abs(), 0.0, 0.008, px));
            colour = colour * (1.0 - 0.6 * gap);
            let handle = slab(p.y, 0.80, 0.83, px) * slab((ahead + 0.45).abs(), 0.40, 0.52, px);
            colour = colour * (1.0 - 0.5 * handle);
            let moulding = slab(p.y, 0.55, 0.58, px);
            colour = colour * (1.0 - 0.25 * moulding);
        } else if spot.normal.y < 0.7 {
            let outer = slab(side.abs(), 0.28 * self.make.width, 0.46 * self.make.width, px);
            let lamps = outer * slab(p.y, 0.60, 0.78, px);
            let plate = slab(side.abs(), -1.0, 0.26, px) * slab(p.y, 0.44, 0.55, px);
            let letters = pulses(side, 0.065, 0.03, px) * slab(p.y, 0.465, 0.525, px);
            let front = ahead > 0.3 * half;
            if front {
                let grille = slab(side.abs(), -1.0, 0.38, px) * slab(p.y, 0.60, 0.72, px);
                colour = colour.mix(vec3(0.02, 0.02, 0.02), grille);
            }
            let lamp = if front { vec3(0.62, 0.63, 0.64) } else { vec3(0.42, 0.03, 0.02) };
            colour = colour.mix(lamp, lamps);
            colour = colour.mix(vec3(0.62, 0.62, 0.60), plate).mix(vec3(0.03, 0.03, 0.03), plate * letters);
        }
        colour = colour.mix(vec3(0.03, 0.03, 0.032), sill);
        let gloss = light.mirrored(spot.mirror()) * (0.08 + 0.12 * spot.normal.y.max(0.0));
        light.reflected(colour, spot.normal, lit) + gloss * (1.0 - sill)
    }

    /// Panes between painted pillars, under a painted roof.
    pub(crate) fn cabin(&self, spot: &Spot, light: &Light, lit: bool) -> Vec3 {
        let (p, px) = (spot.point, spot.footprint);
        let matt = light.reflected(self.paint, spot.normal, lit) + light.mirrored(spot.mirror()) * 0.06;
        if spot.normal.y > 0.9 {
            return matt;
        }
        let (side, ahead) = (p.x - self.x, (p.z - self.z) * self.heading);
        let upright = slab(p.y, self.make.belt + 0.03, self.make.roof - 0.09, px);
        let pane = if spot.normal.x.abs() > 0.7 {
            let half = 0.5 * self.make.length;
            let risen = (p.y - self.make.belt).max(0.0);
            let front =
                self.make.cabin_front * half - risen * self.make.lean_front / (self.make.roof - self.make.belt) - 0.08;
            let rear =
                self.make.cabin_rear * half + risen * self.make.lean_rear / (self.make.roof - self.make.belt) + 0.10;
            let pillars = slab((ahead - 0.05).abs(), -1.0, 0.05, px).max(slab((ahead + 0.98).abs(), -1.0, 0.05, px));
            slab(ahead, rear, front, px) * (1.0 - pillars)
        } else {
            slab(side.abs(), -1.0, 0.5 * self.make.width - 0.16, px)
        };
        let inside = vec3(0.035, 0.036, 0.04) * (1.0 + 0.5 * noise2(self.seed ^ 3, p.z + p.x, p.y, 2.0));
        let glass = inside + light.mirrored(spot.mirror()) * 0.30;
        matt.mix(glass, upright * pane)
    }
}
