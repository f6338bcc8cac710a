//! Where things stand: the street's plan, cut into lots, slots and blocks that are each a hash of their number, so
//! that any stretch of it can be laid out alone.

use crate::furniture::{billboard, bollard, hedge, lamp, person, railing, sign, tree};
use crate::hash::Draws;
use crate::object::Object;
use crate::parking::park;
use crate::shape::{Bounds, Plane, Shape};
use crate::surfaces::facade::Facade;
use crate::surfaces::ground::{HALF_WIDTH, KERB, LANES_END};
use crate::surfaces::material::Material;
use crate::vector::vec3;

/// Length of street before and behind the camera that is laid out, metres.
pub(crate) const AHEAD: f64 = 230.0;
const BEHIND: f64 = 24.0;
/// Middle of the lane that the camera drives in.
pub(crate) const EGO_LANE: f32 = 1.65;
/// Where house fronts stand when they are not set back.
const FRONT: f32 = HALF_WIDTH + 3.0;
/// Metres of street a lot has on average, and by how much its ends are moved.
const LOT: f64 = 19.0;
const LOT_JITTER: f32 = 5.0;
/// Parking is allowed or not by blocks of this length.
const BLOCK: f64 = 48.0;

/// Kinds of things, so that their draws differ.
mod kind {
    pub(crate) const LOT_END: u64 = 10;
    pub(crate) const LOT: u64 = 12;
    pub(crate) const BLOCK: u64 = 14;
    pub(crate) const SLOT: u64 = 16;
    pub(crate) const TRAFFIC: u64 = 18;
    pub(crate) const POST: u64 = 20;
    pub(crate) const WALKER: u64 = 22;
    pub(crate) const LEAD: u64 = 24;
}

/// A stretch of street: the seed, the camera's place along it, and where the scene's own z begins.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretch {
    pub seed: u64,
    /// Metres from the street's beginning to the camera, and to the scene's z = 0.
    pub camera_m: f64,
    pub origin_m: f64,
    /// Seconds since the first frame: for what moves.
    pub time_s: f64,
}

impl Stretch {
    fn scene(&self, metres: f64) -> f32 {
        (metres - self.origin_m) as f32
    }

    /// Numbers of the cells of this length that are in sight.
    fn cells(&self, length: f64) -> std::ops::RangeInclusive<i64> {
        ((self.camera_m - BEHIND) / length).floor() as i64..=((self.camera_m + AHEAD) / length).floor() as i64
    }

    pub(crate) fn objects(&self) -> Vec<Object> {
        let mut objects = Vec::with_capacity(1024);
        for side in [-1.0, 1.0] {
            for lot in self.cells(LOT) {
                self.lot(&mut objects, side, lot);
            }
            for slot in self.cells(6.3) {
                self.parked(&mut objects, side, slot);
            }
            for post in self.cells(11.0) {
                self.posts(&mut objects, side, post);
            }
            for walker in self.cells(14.0) {
                self.walker(&mut objects, side, walker);
            }
        }
        self.traffic(&mut objects);
        objects
    }

    fn draws(&self, kind: u64, side: f32, index: i64) -> Draws {
        Draws::new(self.seed, kind + u64::from(side > 0.0), index)
    }

    fn lot_end(&self, side: f32, lot: i64) -> f32 {
        self.scene(lot as f64 * LOT) + self.draws(kind::LOT_END, side, lot).between(-LOT_JITTER, LOT_JITTER)
    }

    fn lot(&self, objects: &mut Vec<Object>, side: f32, lot: i64) {
        let mut draws = self.draws(kind::LOT, side, lot);
        let (z0, z1) = (self.lot_end(side, lot), self.lot_end(side, lot + 1));
        let front = FRONT + draws.pick(&[0.0, 0.0, 0.0, 0.6, 1.5, 3.0]);
        let use_of_lot = draws.between(0.0, 1.0);
        if use_of_lot < 0.22 {
            // A garden: hedge or railing on the street, trees, a plain wall behind.
            let edge = side * (FRONT + 0.3);
            if draws.chance(0.5) {
                hedge(objects, &mut draws, edge, (z0 + 0.2, z1 - 0.2));
            } else {
                railing(objects, &mut draws, edge, (z0 + 0.2, z1 - 0.2));
            }
            for _ in 0..2 {
                let (x, z) = (side * (FRONT + draws.between(2.5, 6.0)), draws.between(z0 + 2.0, z1 - 2.0));
                tree(objects, &mut draws, x, z);
            }
            house(objects, &mut draws, side, FRONT + 9.0, (z0, z1), 1.0);
            return;
        }
        if use_of_lot < 0.28 {
            // A yard open to the street, with a billboard.
            billboard(objects, &mut draws, side * (FRONT + 2.0), 0.5 * (z0 + z1));
            house(objects, &mut draws, side, FRONT + 12.0, (z0, z1), 1.0);
            return;
        }
        let plain = if draws.chance(0.3) { 1.0 } else { 0.0 };
        let gap = draws.pick(&[0.0, 0.0, 0.0, 2.5]);
        house(objects, &mut draws, side, front, (z0, z1 - gap), plain);
        if front > FRONT + 1.0 && draws.chance(0.6) {
            railing(objects, &mut draws, side * (FRONT + 0.2), (z0, z1));
        }
    }

    fn parked(&self, objects: &mut Vec<Object>, side: f32, slot: i64) {
        let metres = slot as f64 * 6.3;
        let mut block = self.draws(kind::BLOCK, side, (metres / BLOCK).floor() as i64);
        let share = if side > 0.0 { block.pick(&[0.0, 0.1, 0.3, 0.5]) } else { block.pick(&[0.4, 0.7, 0.85, 0.95]) };
        let mut draws = self.draws(kind::SLOT, side, slot);
        if !draws.chance(share) {
            return;
        }
        let x = side * (0.5 * (LANES_END + HALF_WIDTH) + 0.1 + draws.between(-0.12, 0.12));
        let z = self.scene(metres) + 3.1 + draws.between(-0.5, 0.5);
        let heading = if draws.chance(0.85) { side } else { -side };
        park(objects, &mut draws, x, z, heading);
    }

    fn posts(&self, objects: &mut Vec<Object>, side: f32, post: i64) {
        let metres = post as f64 * 11.0;
        let trees = self.draws(kind::BLOCK, side, (metres / BLOCK).floor() as i64 ^ 0x5555).chance(0.7);
        let mut draws = self.draws(kind::POST, side, post);
        let (x, z) = (side * (HALF_WIDTH + 0.55), self.scene(metres) + draws.between(-1.5, 1.5));
        match draws.between(0.0, 1.0) {
            _ if post.rem_euclid(4) == 0 && side < 0.0 => lamp(objects, x, z),
            r if trees && r < 0.85 => tree(objects, &mut draws, x + 0.35 * side, z),
            r if r < 0.45 => sign(objects, &mut draws, x, z),
            r if r < 0.60 => (0..4).for_each(|i| bollard(objects, x, z + 1.5 * i as f32)),
            r if r < 0.74 => railing(objects, &mut draws, side * (HALF_WIDTH + 0.35), (z, z + 8.0)),
            _ => {}
        }
    }

    fn walker(&self, objects: &mut Vec<Object>, side: f32, walker: i64) {
        let mut draws = self.draws(kind::WALKER, side, walker);
        if draws.chance(0.5) {
            let pace = draws.between(-1.4, 1.4) as f64;
            let z = self.scene(walker as f64 * 14.0 + (self.time_s * pace).rem_euclid(14.0));
            let x = side * draws.between(HALF_WIDTH + 0.9, FRONT - 0.5);
            person(objects, &mut draws, x, z);
        }
    }

    /// Oncoming cars in the other lane, and sometimes one ahead in ours.
    fn traffic(&self, objects: &mut Vec<Object>) {
        let driven = 11.0 * self.time_s;
        let spacing = 34.0;
        let first = ((self.camera_m - BEHIND + driven) / spacing).floor() as i64;
        let last = ((self.camera_m + AHEAD + driven) / spacing).floor() as i64;
        for car in first..=last {
            let mut draws = Draws::new(self.seed, kind::TRAFFIC, car);
            if draws.chance(0.6) {
                let metres = car as f64 * spacing + f64::from(draws.between(0.0, 24.0)) - driven;
                park(objects, &mut draws, -1.85 + 0.2, self.scene(metres), -1.0);
            }
        }
        // A car ahead keeps its distance for a while, then another (or none) takes its place.
        let mut draws = Draws::new(self.seed, kind::LEAD, (self.time_s / 6.0).floor() as i64);
        if draws.chance(0.6) {
            let gap = f64::from(draws.between(13.0, 45.0)) + 0.6 * (self.time_s % 6.0);
            park(objects, &mut draws, EGO_LANE, self.scene(self.camera_m + gap), 1.0);
        }
    }
}

/// A house between two ends along the street, roof on top; `plain` is the chance that its walls have no windows.
fn house(objects: &mut Vec<Object>, draws: &mut Draws, side: f32, front: f32, (z0, z1): (f32, f32), plain: f32) {
    let floors = draws.pick(&[1, 2, 2, 3, 3, 4]);
    let windows = !draws.chance(plain);
    let origin = z0 + draws.between(0.3, 1.0);
    let facade = Facade::new(draws, origin, floors, windows);
    let depth = draws.between(9.0, 12.0);
    let (near, far) = (side * front, side * (front + depth));
    let top = facade.top;
    objects.push(Object {
        shape: Shape::Block,
        bounds: Bounds { low: vec3(near.min(far), -0.5, z0), high: vec3(near.max(far), top, z1) },
        material: Material::Facade(Box::new(facade)),
    });
    if draws.chance(0.7) {
        let (rise, eaves) = (draws.between(2.5, 4.0), 0.35);
        let colour = draws.pick(&[vec3(0.20, 0.09, 0.06), vec3(0.10, 0.10, 0.11), vec3(0.16, 0.10, 0.08)]);
        let slope = |x: f32, outward: f32| {
            let normal = vec3(outward * rise, 0.5 * depth, 0.0).normalised();
            Plane { normal, offset: normal.dot(vec3(x, top, 0.0)) }
        };
        objects.push(Object {
            shape: Shape::Convex(vec![slope(near - side * eaves, -side), slope(far + side * eaves, side)]),
            bounds: Bounds {
                low: vec3(near.min(far) - eaves, top - 0.1, z0),
                high: vec3(near.max(far) + eaves, top + rise, z1),
            },
            material: Material::RoofTiles { colour, seed: draws.bits() },
        });
    }
    if draws.chance(0.5) && floors > 1 {
        // A downpipe, as thin as poles get.
        let x = near - side * 0.06;
        objects.push(Object {
            shape: Shape::Column,
            bounds: Bounds { low: vec3(x - 0.05, KERB, z0 + 0.1), high: vec3(x + 0.05, top, z0 + 0.2) },
            material: Material::Plain { colour: vec3(0.16, 0.17, 0.17), contrast: 0.05, seed: 3 },
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// House fronts between two places of the street: their ends, metres from its beginning.
    fn fronts(camera_m: f64, origin_m: f64, between: std::ops::Range<f64>) -> Vec<(f64, f64)> {
        let stretch = Stretch { seed: 5, camera_m, origin_m, time_s: 0.0 };
        let houses = stretch.objects().into_iter().filter(|object| matches!(object.material, Material::Facade(_)));
        houses
            .map(|house| (f64::from(house.bounds.low.z) + origin_m, f64::from(house.bounds.high.z) + origin_m))
            .filter(|(low, high)| *low > between.start && *high < between.end)
            .collect()
    }

    #[test]
    fn houses_stand_where_they_stood_in_the_last_frame() {
        for (before, after) in [((100.0, 0.0), (104.0, 0.0)), ((1020.0, 0.0), (1024.0, 1024.0))] {
            let between = after.0 + 10.0..before.0 + 190.0;
            let (a, b) = (fronts(before.0, before.1, between.clone()), fronts(after.0, after.1, between));
            assert!(a.len() > 10, "a street has houses: {}", a.len());
            assert_eq!(a.len(), b.len());
            for (a, b) in a.iter().zip(&b) {
                assert!((a.0 - b.0).abs() < 1e-3 && (a.1 - b.1).abs() < 1e-3, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn no_object_is_in_the_lane_of_the_camera() {
        for step in 0..200 {
            let camera_m = f64::from(step) * 4.0;
            let stretch = Stretch { seed: 9, camera_m, origin_m: 0.0, time_s: camera_m / 13.5 };
            let (low, high) = (camera_m as f32 - 1.0, camera_m as f32 + 5.0);
            for object in stretch.objects() {
                let b = object.bounds;
                let beside = b.high.x < EGO_LANE - 0.9 || b.low.x > EGO_LANE + 0.9 || b.low.y > 2.5;
                assert!(beside || b.high.z < low || b.low.z > high, "step {step}: {b:?}");
            }
        }
    }
}
