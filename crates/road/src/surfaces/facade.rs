//! House fronts: windows that repeat strictly, on brick, stone or plaster.

use crate::hash::Draws;
use crate::light::Light;
use crate::surfaces::spot::{Spot, Wall, plain_noise};
use crate::surfaces::texture::{faded, floor, noise_grazing, noise2, pulses, slab, surviving};
use crate::vector::{Vec3, vec3};

/// What the wall between the windows is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Masonry {
    Plaster,
    Brick,
    Stone,
}

/// One house's front. Metres.
#[derive(Clone, Debug)]
pub(crate) struct Facade {
    pub masonry: Masonry,
    colour: Vec3,
    trim: Vec3,
    /// False: not a single window, a plain wall.
    windows: bool,
    shop: bool,
    origin: f32,
    period: f32,
    width: f32,
    sill: f32,
    window_height: f32,
    /// Height of the ground floor, then of every floor above.
    ground_floor: f32,
    pub floor: f32,
    pub top: f32,
    seed: u32,
}

impl Facade {
    /// A house of `floors` storeys above its ground floor, windows counted from `origin`.
    pub(crate) fn new(draws: &mut Draws, origin: f32, floors: u32, windows: bool) -> Self {
        let masonry = draws.pick(&[
            Masonry::Plaster,
            Masonry::Plaster,
            Masonry::Plaster,
            Masonry::Plaster,
            Masonry::Brick,
            Masonry::Stone,
        ]);
        let colour = match masonry {
            Masonry::Plaster => draws.pick(&[
                vec3(0.42, 0.40, 0.35),
                vec3(0.48, 0.41, 0.28),
                vec3(0.36, 0.37, 0.37),
                vec3(0.46, 0.34, 0.26),
                vec3(0.33, 0.37, 0.33),
            ]),
            Masonry::Brick => draws.pick(&[vec3(0.25, 0.105, 0.065), vec3(0.22, 0.13, 0.09), vec3(0.33, 0.24, 0.14)]),
            Masonry::Stone => draws.pick(&[vec3(0.30, 0.26, 0.21), vec3(0.27, 0.15, 0.12)]),
        } * draws.between(0.8, 1.1);
        let (ground_floor, floor) = (draws.between(3.4, 4.2), draws.between(2.9, 3.4));
        Self {
            masonry,
            colour,
            trim: draws.pick(&[vec3(0.50, 0.48, 0.43), vec3(0.34, 0.29, 0.23), vec3(0.20, 0.17, 0.15)]),
            windows,
            shop: draws.chance(0.35),
            origin,
            period: draws.between(1.9, 3.3),
            width: draws.between(0.95, 1.25),
            sill: draws.between(0.75, 0.95),
            window_height: draws.between(1.45, 1.8),
            ground_floor,
            floor,
            top: ground_floor + floor * floors as f32 + 0.5,
            seed: draws.bits(),
        }
    }

    pub(crate) fn shade(&self, spot: &Spot, light: &Light, lit: bool) -> Vec3 {
        if spot.normal.y > 0.5 {
            return light.reflected(vec3(0.12, 0.11, 0.11), spot.normal, lit);
        }
        let wall = spot.on_wall();
        let mut colour = self.masonry_colour(&wall);
        let mut pane = 0.0;
        if self.windows {
            let above = wall.up - self.ground_floor;
            let (base, storey, opening, tall) = if above > 0.0 {
                (
                    self.ground_floor + floor(above / self.floor) as f32 * self.floor,
                    self.floor,
                    self.width,
                    self.window_height,
                )
            } else if self.shop {
                (-0.35, self.ground_floor, self.period * 0.8, 2.2)
            } else {
                (0.15, self.ground_floor, self.width, self.window_height + 0.2)
            };
            let has_room = base + storey < self.top + 0.1;
            if has_room {
                let (u, v) = (wall.along - self.origin - 0.5 * (self.period - opening), wall.up - base - self.sill);
                let inside = |frame: f32| {
                    let rows = slab(v, frame, tall - frame, wall.up_px);
                    if rows == 0.0 {
                        0.0
                    } else {
                        rows * pulses(u - frame, self.period, opening - 2.0 * frame, wall.along_px)
                    }
                };
                // Stone around the opening and a sill under it, the frame, two sashes, the pane behind.
                let surround = inside(-0.14);
                let sill = slab(v, -0.19, -0.05, wall.up_px);
                if sill > 0.0 {
                    let sill = sill * pulses(u + 0.2, self.period, opening + 0.4, wall.along_px);
                    colour = colour.mix(self.trim * 1.15, sill);
                }
                if surround > 0.0 {
                    colour = colour.mix(self.trim, 0.85 * surround).mix(vec3(0.55, 0.54, 0.52), inside(0.0));
                    let bar = pulses(u - 0.5 * opening + 0.03, self.period, 0.06, wall.along_px);
                    let transom = slab(v, 0.68 * tall, 0.68 * tall + 0.05, wall.up_px);
                    pane = inside(0.07) * (1.0 - bar.max(transom));
                }
            }
            let cornice = slab(above, -0.25, -0.02, wall.up_px);
            colour = colour.mix(self.trim, cornice * 0.9);
        }
        colour = colour.mix(self.trim * 0.8, slab(wall.up, self.top - 0.4, self.top, wall.up_px));
        let plinth = slab(wall.up, -1.0, 0.65, wall.up_px);
        colour = colour * (1.0 - 0.4 * plinth);
        let matt = light.reflected(colour, spot.normal, lit);
        if pane <= 0.0 {
            return matt;
        }
        // Curtains in some windows, the same in all pixels of a pane.
        let column = floor((wall.along - self.origin) / self.period);
        let curtain = 0.10 + 0.10 * noise2(self.seed ^ 4, column as f32, floor(wall.up / self.floor) as f32, 1.0);
        let behind = light.reflected(vec3(curtain, curtain, curtain * 0.95), spot.normal, false);
        let glass = behind * 0.8 + light.mirrored(spot.mirror()) * 0.32;
        matt.mix(glass, pane)
    }

    fn masonry_colour(&self, wall: &Wall) -> Vec3 {
        let stained = 1.0 + 0.07 * plain_noise(self.seed, wall);
        match self.masonry {
            Masonry::Plaster => self.colour * stained,
            Masonry::Brick => self.courses(wall, (0.25, 0.083), 0.013, 0.26) * stained,
            Masonry::Stone => {
                let rough =
                    faded(0.06, wall.up_px, || noise_grazing(self.seed ^ 3, wall.along, wall.up, 16.0, wall.along_px));
                self.courses(wall, (0.9, 0.45), 0.03, 0.16) * (stained + 0.10 * rough)
            }
        }
    }

    /// Bricks or blocks in running bond: joints in mortar, and every stone its own shade.
    fn courses(&self, wall: &Wall, (length, height): (f32, f32), joint: f32, variety: f32) -> Vec3 {
        let row = floor(wall.up / height);
        let shift = if row & 1 == 0 { 0.0 } else { 0.5 * length };
        let along = wall.along - self.origin + shift;
        let bed = pulses(wall.up, height, joint, wall.up_px);
        let head = pulses(along, length, joint, wall.along_px) * surviving(height, wall.up_px);
        let own = surviving(height, wall.up_px)
            * faded(length, wall.along_px, || noise2(self.seed ^ 5, floor(along / length) as f32, row as f32, 1.0));
        let mortar = vec3(0.36, 0.34, 0.31);
        (self.colour * (1.0 + variety * own)).mix(mortar, (bed + head).min(1.0) * 0.7)
    }
}
