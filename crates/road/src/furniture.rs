//! Objects along the street: trees, lamp posts, signs, bollards, people, hedges, railings.

use crate::hash::Draws;
use crate::object::Object;
use crate::shape::{Bounds, Shape};
use crate::surfaces::ground::KERB;
use crate::surfaces::material::Material;
use crate::vector::{Vec3, vec3};

fn upright(x: f32, z: f32, radius: f32, low: f32, high: f32, material: Material) -> Object {
    Object {
        shape: Shape::Column,
        bounds: Bounds { low: vec3(x - radius, low, z - radius), high: vec3(x + radius, high, z + radius) },
        material,
    }
}

fn around(shape: Shape, centre: Vec3, radii: Vec3, material: Material) -> Object {
    Object { shape, bounds: Bounds { low: centre - radii, high: centre + radii }, material }
}

const fn metal(shade: f32) -> Material {
    Material::Plain { colour: vec3(shade, shade * 1.02, shade * 1.03), contrast: 0.06, seed: 77 }
}

/// A trunk with a crown of four clumps that one partly sees through.
pub(crate) fn tree(objects: &mut Vec<Object>, draws: &mut Draws, x: f32, z: f32) {
    let height = draws.between(6.5, 10.5);
    let radius = draws.between(1.9, 3.2);
    let stem = height - 1.5 * radius;
    objects.push(upright(x, z, draws.between(0.11, 0.24), 0.0, stem + 0.8, Material::Bark { seed: draws.bits() }));
    let colour = draws.pick(&[vec3(0.09, 0.15, 0.04), vec3(0.07, 0.12, 0.045), vec3(0.14, 0.16, 0.04)]);
    for _ in 0..4 {
        let size = radius * draws.between(0.55, 0.9);
        let centre = vec3(
            x + draws.between(-0.5, 0.5) * radius,
            stem + draws.between(0.2, 1.1) * radius,
            z + draws.between(-0.5, 0.5) * radius,
        );
        let leaves = Material::Leaves { colour, holes: draws.between(0.42, 0.54), seed: draws.bits() };
        objects.push(around(Shape::Ellipsoid, centre, vec3(size, size * 0.85, size), leaves));
    }
}

pub(crate) fn lamp(objects: &mut Vec<Object>, x: f32, z: f32) {
    objects.push(upright(x, z, 0.075, 0.0, 7.5, metal(0.22)));
    objects.push(around(Shape::Block, vec3(x - 0.9 * x.signum(), 7.4, z), vec3(0.95, 0.05, 0.06), metal(0.25)));
}

/// A thin pole with a round or square plate that faces oncoming eyes.
pub(crate) fn sign(objects: &mut Vec<Object>, draws: &mut Draws, x: f32, z: f32) {
    objects.push(upright(x, z, 0.032, 0.0, 3.0, metal(0.26)));
    let (ground, figure) = draws.pick(&[
        (vec3(0.04, 0.12, 0.45), vec3(0.62, 0.62, 0.62)),
        (vec3(0.60, 0.60, 0.58), vec3(0.50, 0.04, 0.03)),
        (vec3(0.55, 0.45, 0.04), vec3(0.04, 0.04, 0.04)),
    ]);
    let plate = Material::Poster { ground, figure, cells_per_metre: 4.0, seed: draws.bits() };
    objects.push(around(Shape::Block, vec3(x, draws.between(2.3, 2.7), z - 0.045), vec3(0.32, 0.32, 0.012), plate));
}

pub(crate) fn bollard(objects: &mut Vec<Object>, x: f32, z: f32) {
    objects.push(upright(x, z, 0.055, KERB, KERB + 0.9, metal(0.10)));
}

/// A person on the pavement: legs, coat, head.
pub(crate) fn person(objects: &mut Vec<Object>, draws: &mut Draws, x: f32, z: f32) {
    let height = draws.between(1.58, 1.86);
    let cloth = |draws: &mut Draws, bright: f32| Material::Plain {
        colour: vec3(draws.between(0.02, bright), draws.between(0.02, bright), draws.between(0.02, bright)),
        contrast: 0.25,
        seed: draws.bits(),
    };
    let legs = cloth(draws, 0.12);
    for (side, ahead) in [(-0.09, 0.13), (0.09, -0.13)] {
        objects.push(upright(x + side, z + ahead, 0.075, KERB, KERB + 0.5 * height, legs.clone()));
    }
    let coat = cloth(draws, 0.4);
    objects.push(around(Shape::Ellipsoid, vec3(x, KERB + 0.64 * height, z), vec3(0.25, 0.25 * height, 0.17), coat));
    let skin = Material::Plain { colour: vec3(0.34, 0.24, 0.18), contrast: 0.1, seed: 5 };
    objects.push(around(Shape::Ellipsoid, vec3(x, KERB + 0.93 * height, z), vec3(0.09, 0.13, 0.10), skin));
}

pub(crate) fn hedge(objects: &mut Vec<Object>, draws: &mut Draws, x: f32, z: (f32, f32)) {
    let leaves = Material::Leaves { colour: vec3(0.07, 0.12, 0.03), holes: 0.0, seed: draws.bits() };
    let top = KERB + draws.between(0.9, 1.6);
    objects.push(Object {
        shape: Shape::Block,
        bounds: Bounds { low: vec3(x - 0.4, KERB, z.0), high: vec3(x + 0.4, top, z.1) },
        material: leaves,
    });
}

/// A see-through railing of upright bars along the street.
pub(crate) fn railing(objects: &mut Vec<Object>, draws: &mut Draws, x: f32, z: (f32, f32)) {
    let top = KERB + draws.between(1.0, 1.3);
    let bars = Material::Railing { colour: vec3(0.03, 0.04, 0.035), period: draws.between(0.11, 0.15), top };
    objects.push(Object {
        shape: Shape::Block,
        bounds: Bounds { low: vec3(x - 0.01, KERB + 0.08, z.0), high: vec3(x + 0.01, top, z.1) },
        material: bars,
    });
}

/// A box van's or a kiosk's wall: a poster on a frame.
pub(crate) fn billboard(objects: &mut Vec<Object>, draws: &mut Draws, x: f32, z: f32) {
    let poster = Material::Poster {
        ground: vec3(draws.between(0.1, 0.6), draws.between(0.1, 0.6), draws.between(0.1, 0.6)),
        figure: vec3(draws.between(0.02, 0.6), draws.between(0.02, 0.4), draws.between(0.02, 0.3)),
        cells_per_metre: 2.0,
        seed: draws.bits(),
    };
    objects.push(around(Shape::Block, vec3(x, KERB + 1.5, z), vec3(1.3, 0.9, 0.08), poster));
    for side in [-1.1, 1.1] {
        objects.push(upright(x + side, z, 0.04, KERB, KERB + 0.7, metal(0.2)));
    }
}
