//! The carriageway and its pavements.

use crate::hash::{Draws, hash2, unit};
use crate::surfaces::spot::Spot;
use crate::surfaces::texture::{faded, floor, fraction, noise_grazing, noise2, pulses, slab, surviving};
use crate::vector::{Vec3, vec3};

/// Half the carriageway's width, parking strips included, metres.
pub(crate) const HALF_WIDTH: f32 = 6.3;
/// Where the parking strip begins.
pub(crate) const LANES_END: f32 = 4.0;
/// Height of the pavement above the carriageway.
pub(crate) const KERB: f32 = 0.13;
/// Zebra crossings lie this far apart; the scene's wrap is a multiple.
const CROSSING_PERIOD: f32 = 128.0;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Ground {
    asphalt: Vec3,
    flags: Vec3,
    crossing: f32,
    seed: u32,
}

impl Ground {
    pub(crate) fn new(seed: u64) -> Self {
        let mut draws = Draws::new(seed, 2, 0);
        let grey = draws.between(0.13, 0.18);
        let flag = draws.between(0.24, 0.32);
        Self {
            asphalt: vec3(grey * 0.97, grey, grey * 1.03),
            flags: vec3(flag, flag * 0.97, flag * 0.92),
            crossing: draws.between(20.0, 100.0),
            seed: draws.bits(),
        }
    }

    pub(crate) fn carriageway(&self, spot: &Spot) -> Vec3 {
        let (x, z) = (spot.point.x, spot.point.z);
        let across = spot.footprint;
        let along = spot.stretched(vec3(0.0, 0.0, 1.0));
        let broad = noise_grazing(self.seed, z, x, 0.25, along);
        let medium = faded(0.5, across, || noise_grazing(self.seed ^ 1, z, x, 2.0, along));
        let grit = faded(0.031, across, || noise_grazing(self.seed ^ 2, z, x, 32.0, along));
        let pebbles = faded(0.125, across, || noise_grazing(self.seed ^ 3, z, x, 8.0, along));
        let tracks = slab((x.abs() - 1.85).abs(), 0.55, 0.95, 0.3);
        let mut colour = self.asphalt
            * ((1.0 + 0.07 * broad + 0.04 * medium + 0.04 * pebbles + 0.10 * grit) * (1.0 - 0.06 * tracks));
        colour = colour * (1.0 - 0.35 * self.cracks(x, z, across, along));
        colour = self.patches(colour, x, z, across, along);
        let paint = self.paint(x, z, across, along);
        if paint == 0.0 {
            return colour;
        }
        let wear = (0.75 + 0.35 * noise_grazing(self.seed ^ 6, z, x, 4.0, along)).clamp(0.0, 1.0);
        colour.mix(vec3(0.55, 0.55, 0.53), 0.9 * paint * wear)
    }

    /// Thin dark lines where a broad noise crosses zero.
    fn cracks(&self, x: f32, z: f32, across: f32, along: f32) -> f32 {
        if noise2(self.seed ^ 9, z, x, 1.0 / 16.0) < 0.3 {
            return 0.0;
        }
        let jagged = 0.25 * noise2(self.seed ^ 8, z, x, 2.0);
        let level = noise2(self.seed ^ 7, z, x, 0.25) + jagged;
        slab(level, -0.012, 0.012, 0.02 + 0.5 * along.max(across))
    }

    /// Repairs: rectangles of another asphalt, and manhole covers.
    fn patches(&self, colour: Vec3, x: f32, z: f32, across: f32, along: f32) -> Vec3 {
        let cell = floor(z / 8.0);
        let h = |salt: u32| unit(hash2(self.seed ^ salt, cell & 127, 0));
        let (u, v) = (x + 4.5 - 8.0 * h(20), 8.0 * fraction(z / 8.0) - 3.0 * h(21));
        if h(22) < 0.45 {
            let patch = slab(u, 0.0, 0.6 + 1.6 * h(23), across) * slab(v, 0.2, 1.2 + 3.5 * h(24), along);
            return colour * (1.0 - patch * (0.28 - 0.40 * h(25)));
        }
        if h(22) < 0.75 {
            let (du, dv) = (u - 0.4, v - 1.0);
            let radius = (du * du + dv * dv).sqrt();
            let blurred = along.min(1.0).max(across);
            let cover = slab(radius, -1.0, 0.33, blurred);
            let rim = slab(radius, 0.28, 0.33, blurred);
            return colour.mix(vec3(0.07, 0.065, 0.06), cover * 0.8).mix(vec3(0.16, 0.15, 0.14), rim);
        }
        colour
    }

    /// Share of the pixel under paint: a broken line in the middle, lines along the parking strips, zebra crossings.
    fn paint(&self, x: f32, z: f32, across: f32, along: f32) -> f32 {
        let middle = slab(x, -0.06, 0.06, across) * pulses(z, 8.0, 3.0, along);
        let parking = slab(x.abs(), LANES_END, LANES_END + 0.12, across);
        let bays = slab(x.abs(), LANES_END, HALF_WIDTH - 0.4, across) * pulses(z, 32.0, 0.12, along);
        let zebra = pulses(z - self.crossing, CROSSING_PERIOD, 3.2, along) * pulses(x + 0.25, 1.0, 0.5, across);
        middle.max(parking * 0.8).max(bays * 0.8).max(zebra)
    }

    /// Colour of the pavement: flags with joints, granite along the kerb.
    pub(crate) fn pavement(&self, spot: &Spot) -> Vec3 {
        let (x, z) = (spot.point.x, spot.point.z);
        let (across, along) = (spot.footprint, spot.stretched(vec3(0.0, 0.0, 1.0)));
        let inside = x.abs() - HALF_WIDTH;
        let grit = faded(0.031, across, || noise_grazing(self.seed ^ 11, z, x, 32.0, along));
        let gum = faded(0.25, across, || noise_grazing(self.seed ^ 15, z, x, 4.0, along));
        let stains = noise_grazing(self.seed ^ 12, z, x, 1.0, along);
        let worn = 1.0 + 0.07 * grit + 0.03 * gum + 0.07 * stains;
        if spot.normal.y < 0.5 || inside < 0.28 {
            let joint = pulses(z, 1.0, 0.015, along);
            let own = faded(1.0, along, || noise2(self.seed ^ 13, floor(z) as f32, 0.0, 1.0));
            let face = if spot.normal.y < 0.5 { 0.75 } else { 1.0 };
            return vec3(0.30, 0.295, 0.285) * (face * worn * (1.0 + 0.1 * own) * (1.0 - 0.5 * joint));
        }
        let joints = pulses(z, 0.5, 0.012, along) + pulses(x, 0.5, 0.012, across);
        let own = surviving(0.5, across)
            * faded(0.5, along, || noise2(self.seed ^ 14, floor(2.0 * z) as f32 * 0.5, floor(2.0 * x) as f32, 2.0));
        self.flags * (worn * (1.0 + 0.10 * own) * (1.0 - 0.3 * joints.min(1.0)))
    }
}
