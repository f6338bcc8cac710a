//! Cars as objects of the street.

use crate::hash::Draws;
use crate::object::Object;
use crate::shape::{Bounds, Plane, Shape};
use crate::surfaces::car::{CarSkin, MAKES, PAINTS, WheelSkin};
use crate::surfaces::material::Material;
use crate::vector::vec3;

/// Puts a car on the street: its middle at (x, z), driving along z (`heading` 1) or against it (-1).
pub(crate) fn park(objects: &mut Vec<Object>, draws: &mut Draws, x: f32, z: f32, heading: f32) {
    let make = draws.pick(&[MAKES[0], MAKES[0], MAKES[1], MAKES[1], MAKES[2], MAKES[2], MAKES[3]]);
    let skin = CarSkin { paint: draws.pick(&PAINTS), make, x, z, heading, seed: draws.bits() };
    let (half, wide) = (0.5 * make.length, 0.5 * make.width);
    // Planes in the car's own axes (x to the side, y up, z ahead), turned into the street's by the heading.
    let plane = |nx: f32, ny: f32, nz: f32, through: (f32, f32, f32)| {
        let normal = vec3(nx, ny, nz * heading).normalised();
        Plane { normal, offset: normal.dot(vec3(x + through.0, through.1, z + through.2 * heading)) }
    };
    let body = vec![
        plane(0.0, 0.22, 1.0, (0.0, 0.55, half)),
        plane(0.0, -0.35, 1.0, (0.0, 0.45, half)),
        plane(0.0, 0.12, -1.0, (0.0, 0.55, -half)),
        plane(0.0, -0.35, -1.0, (0.0, 0.45, -half)),
        plane(0.0, 1.0, 0.16, (0.0, make.belt, make.cabin_front * half)),
        plane(1.0, 0.10, 0.0, (wide, 0.6, 0.0)),
        plane(-1.0, 0.10, 0.0, (-wide, 0.6, 0.0)),
        plane(0.35, 0.0, 1.0, (0.72 * wide, 0.0, half)),
        plane(-0.35, 0.0, 1.0, (-0.72 * wide, 0.0, half)),
    ];
    objects.push(Object {
        shape: Shape::Convex(body),
        bounds: Bounds { low: vec3(x - wide, 0.24, z - half), high: vec3(x + wide, make.belt, z + half) },
        material: Material::CarBody(skin),
    });
    let rise = make.roof - make.belt;
    let (front, rear) = (make.cabin_front * half, make.cabin_rear * half);
    let cabin = vec![
        plane(0.0, make.lean_front, rise, (0.0, make.belt, front)),
        plane(0.0, make.lean_rear, -rise, (0.0, make.belt, rear)),
        plane(1.0, 0.28, 0.0, (wide - 0.04, make.belt, 0.0)),
        plane(-1.0, 0.28, 0.0, (-wide + 0.04, make.belt, 0.0)),
    ];
    let (end_a, end_b) = (z + front * heading, z + rear * heading);
    objects.push(Object {
        shape: Shape::Convex(cabin),
        bounds: Bounds {
            low: vec3(x - wide, make.belt, end_a.min(end_b)),
            high: vec3(x + wide, make.roof, end_a.max(end_b)),
        },
        material: Material::CarCabin(skin),
    });
    // What is under a car is dark; without it light would seem to come from below.
    objects.push(Object {
        shape: Shape::Block,
        bounds: Bounds {
            low: vec3(x - wide + 0.18, 0.03, z - half + 0.35),
            high: vec3(x + wide - 0.18, 0.26, z + half - 0.35),
        },
        material: Material::Plain { colour: vec3(0.008, 0.008, 0.009), contrast: 0.0, seed: 0 },
    });
    let spokes = draws.chance(0.6);
    for axle in [0.62, -0.60] {
        for side in [-1.0, 1.0] {
            let (wx, wz) = (x + side * (wide - 0.10), z + axle * half * heading);
            objects.push(Object {
                shape: Shape::Ellipsoid,
                bounds: Bounds { low: vec3(wx - 0.14, 0.0, wz - 0.32), high: vec3(wx + 0.14, 0.64, wz + 0.32) },
                material: Material::Wheel(WheelSkin { y: 0.32, z: wz, spokes }),
            });
        }
    }
}
