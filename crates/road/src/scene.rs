//! One frame's world: what is there, what a ray meets first, whether the sun gets there.

use crate::camera::{Camera, Ray};
use crate::frame::Size;
use crate::light::Light;
use crate::object::Object;
use crate::screen::{ScreenTiles, SunCells};
use crate::surfaces::ground::{Ground, HALF_WIDTH, KERB};
use crate::surfaces::spot::Spot;
use crate::vector::{Vec3, vec3};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Carriageway,
    Pavement,
    Object(u32),
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    pub depth: f32,
    pub normal: Vec3,
    pub part: Part,
}

/// One eye: a camera and the objects in each tile of its image.
#[derive(Debug)]
pub(crate) struct Eye {
    pub camera: Camera,
    tiles: ScreenTiles,
}

/// Everything that determines a frame's pixels.
#[derive(Debug)]
pub(crate) struct Scene {
    objects: Vec<Object>,
    ground: Ground,
    light: Light,
    sun_cells: SunCells,
    pub left: Eye,
    pub right: Eye,
}

/// Beyond this the ground is lost in haze, metres.
const GROUND_ENDS: f32 = 260.0;

impl Scene {
    pub(crate) fn new(
        objects: Vec<Object>,
        ground: Ground,
        light: Light,
        left: Camera,
        right: Camera,
        size: Size,
    ) -> Self {
        let eye = |camera: Camera| Eye { camera, tiles: ScreenTiles::new(&camera, size, &objects) };
        let (left_eye, right_eye) = (eye(left), eye(right));
        let sun_cells = SunCells::new(light.sun, left.position.z, &objects);
        Self { objects, ground, light, sun_cells, left: left_eye, right: right_eye }
    }

    /// What the eye sees at a place of its image.
    pub(crate) fn first_hit(&self, eye: &Eye, column: f32, row: f32) -> (Ray, Option<Hit>) {
        let ray = eye.camera.ray(column, row);
        let ground = ground_hit(&ray);
        let mut best = None;
        eye.tiles.along(column, row, ground.map_or(f32::INFINITY, |hit| hit.depth), |index, limit| {
            let Some(depth) = self.objects[index as usize].meets(&ray, 0.0, limit) else { return limit };
            best = Some((index, depth));
            depth
        });
        let hit = best.map(|(index, depth)| {
            let object = &self.objects[index as usize];
            Hit { depth, normal: object.shape.normal(&object.bounds, &ray, depth), part: Part::Object(index) }
        });
        (ray, hit.or(ground))
    }

    /// Whether the sun shines on this spot.
    pub(crate) fn is_lit(&self, point: Vec3, hit: &Hit) -> bool {
        if hit.normal.dot(self.light.sun) <= 0.0 {
            return false;
        }
        let from = point + hit.normal * 0.02;
        // Light finds its way between leaves: a crown does not put its own sunny side in the shade.
        let among_leaves = self.has_holes(hit.part);
        let ray = Ray::new(from, self.light.sun);
        !self.sun_cells.any_towards_sun(from, |index| {
            let object = &self.objects[index as usize];
            !(among_leaves && object.material.has_holes()) && object.meets(&ray, 1e-3, f32::INFINITY).is_some()
        })
    }

    pub(crate) fn has_holes(&self, part: Part) -> bool {
        matches!(part, Part::Object(index) if self.objects[index as usize].material.has_holes())
    }

    pub(crate) fn is_car(&self, part: Part) -> bool {
        matches!(part, Part::Object(index) if self.objects[index as usize].material.is_of_a_car())
    }

    /// How much of a laser's light comes back from here, of 255: panes, black paint and leaves swallow or scatter it.
    pub(crate) fn reflectivity(&self, hit: &Hit) -> u8 {
        match hit.part {
            Part::Carriageway | Part::Pavement => 250,
            Part::Object(index) => self.objects[index as usize].material.reflectivity(),
        }
    }

    pub(crate) fn radiance(&self, ray: &Ray, hit: Option<&Hit>, lit: bool, focal_px: f32) -> Vec3 {
        let Some(hit) = hit else { return self.light.sky(ray.direction) };
        let spot =
            Spot { point: ray.at(hit.depth), normal: hit.normal, view: ray.direction, footprint: hit.depth / focal_px };
        let radiance = match hit.part {
            Part::Carriageway => self.light.reflected(self.ground.carriageway(&spot), spot.normal, lit),
            Part::Pavement => self.light.reflected(self.ground.pavement(&spot), spot.normal, lit),
            Part::Object(index) => self.objects[index as usize].material.shade(&spot, &self.light, lit),
        };
        self.light.through_air(radiance, hit.depth)
    }
}

/// The carriageway's plane, the pavements' planes above it, the kerbs between.
fn ground_hit(ray: &Ray) -> Option<Hit> {
    let up = vec3(0.0, 1.0, 0.0);
    if ray.direction.y >= -1e-6 {
        return None;
    }
    let at_height = |y: f32| (y - ray.origin.y) * ray.inverse.y;
    let raised = at_height(KERB);
    let hit = if ray.at(raised).x.abs() > HALF_WIDTH {
        Hit { depth: raised, normal: up, part: Part::Pavement }
    } else {
        let level = at_height(0.0);
        let x = ray.at(level).x;
        if x.abs() > HALF_WIDTH {
            let depth = (HALF_WIDTH * x.signum() - ray.origin.x) * ray.inverse.x;
            Hit { depth, normal: vec3(-x.signum(), 0.0, 0.0), part: Part::Pavement }
        } else {
            Hit { depth: level, normal: up, part: Part::Carriageway }
        }
    };
    (hit.depth < GROUND_ENDS).then_some(hit)
}
