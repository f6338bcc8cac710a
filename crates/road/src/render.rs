//! From a scene to a frame, band of rows by band of rows.
//!
//! Every pixel is looked at once at its centre; where a neighbour shows something else (another thing, another face,
//! light or shadow) four rays are averaged, elsewhere textures know how to fade by themselves.

use std::sync::Mutex;

use depthloom_threads::locked;

use crate::camera::Ray;
use crate::frame::{Calibration, Frame, Run, Size};
use crate::lidar::scan;
use crate::scene::{Eye, Hit, Part, Scene};
use crate::sensor::Sensor;
use crate::vector::{Vec3, vec3};

/// Rows of a band: one tile of work. Depends on nothing but the image.
const BAND_ROWS: usize = 24;
/// Where the four rays of a mixed pixel pass, in pixels from its centre.
const SUBPIXELS: [(f32, f32); 4] = [(-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)];
/// Light that the sensor cannot tell from more.
const WHITE: f32 = 1.3;
/// Relative difference of depth above which a surface hides another from the right camera, and not itself.
const NEARER: f32 = 1e-3;

struct Band<'a> {
    first_row: usize,
    left: &'a mut [u8],
    right: &'a mut [u8],
    depth: &'a mut [f32],
    occluded: &'a mut [bool],
    cars: &'a mut [bool],
    reflects: &'a mut [u8],
}

/// What one look at a pixel's centre found.
#[derive(Clone, Copy)]
struct Look {
    ray: Ray,
    hit: Option<Hit>,
    lit: bool,
    /// Whether the surface is foliage or a railing.
    leafy: bool,
}

pub(crate) fn render(
    scene: &Scene,
    seed: u64,
    index: u64,
    size: Size,
    calibration: &Calibration,
    run: Run<'_>,
) -> Frame {
    let pixels = size.pixels();
    let (mut left, mut right) = (vec![0; 3 * pixels], vec![0; 3 * pixels]);
    let (mut depth, mut occluded, mut reflects) = (vec![f32::NAN; pixels], vec![false; pixels], vec![0; pixels]);
    let mut cars = vec![false; pixels];
    {
        let chunk = BAND_ROWS * size.width;
        let bands: Vec<Mutex<Band<'_>>> = left
            .chunks_mut(3 * chunk)
            .zip(right.chunks_mut(3 * chunk))
            .zip(depth.chunks_mut(chunk))
            .zip(occluded.chunks_mut(chunk))
            .zip(cars.chunks_mut(chunk))
            .zip(reflects.chunks_mut(chunk))
            .enumerate()
            .map(|(band, (((((left, right), depth), occluded), cars), reflects))| {
                Mutex::new(Band { first_row: band * BAND_ROWS, left, right, depth, occluded, cars, reflects })
            })
            .collect();
        let sensors = [Sensor::new(seed, index, 0), Sensor::new(seed, index, 1)];
        run(bands.len(), &|band| {
            // Each band is taken once: the lock only hands the slices over, and a poisoned one means that a panic is
            // on its way up already.
            let mut band = locked(&bands[band]);
            band.fill(scene, &sensors, size);
        });
    }
    let sparse = scan(seed, index, size, calibration, &depth, &reflects);
    Frame { size, left, right, depth, occluded, cars, sparse, calibration: *calibration }
}

impl Band<'_> {
    fn fill(&mut self, scene: &Scene, sensors: &[Sensor; 2], size: Size) {
        let rows = self.depth.len() / size.width;
        let looks = look(scene, &scene.left, self.first_row, rows, size);
        for (pixel, look) in looks[size.width..][..rows * size.width].iter().enumerate() {
            let Some(hit) = look.hit else { continue };
            self.depth[pixel] = hit.depth;
            self.occluded[pixel] = is_hidden(scene, look.ray.at(hit.depth), size);
            self.cars[pixel] = scene.is_car(hit.part);
            self.reflects[pixel] = scene.reflectivity(&hit);
        }
        expose(scene, &scene.left, &looks, &sensors[0], self.first_row, size, self.left);
        let looks = look(scene, &scene.right, self.first_row, rows, size);
        expose(scene, &scene.right, &looks, &sensors[1], self.first_row, size, self.right);
    }
}

fn look(scene: &Scene, eye: &Eye, first_row: usize, rows: usize, size: Size) -> Vec<Look> {
    let mut looks = Vec::with_capacity((rows + 2) * size.width);
    for row in 0..rows + 2 {
        let v = (first_row + row) as f32 - 1.0;
        for column in 0..size.width {
            let (ray, hit) = scene.first_hit(eye, column as f32, v);
            let lit = is_lit(scene, &ray, hit.as_ref());
            looks.push(Look { ray, hit, lit, leafy: hit.is_some_and(|hit| scene.has_holes(hit.part)) });
        }
    }
    looks
}

/// Whether the right camera sees something nearer in the direction of this point, or does not look there.
fn is_hidden(scene: &Scene, point: Vec3, size: Size) -> bool {
    let Some((column, row, depth)) = scene.right.camera.project(point) else { return true };
    if column < -0.5 || column > size.width as f32 - 0.5 {
        return true;
    }
    let (_, hit) = scene.first_hit(&scene.right, column, row);
    hit.is_some_and(|hit| hit.depth < depth * (1.0 - NEARER))
}

fn expose(scene: &Scene, eye: &Eye, looks: &[Look], sensor: &Sensor, first_row: usize, size: Size, image: &mut [u8]) {
    let width = size.width;
    for (pixel, bytes) in image.chunks_exact_mut(3).enumerate() {
        let (row, column) = (pixel / width, pixel % width);
        let at = pixel + width;
        let here = &looks[at];
        let beside = [at - usize::from(column > 0), at + usize::from(column + 1 < width), at - width, at + width];
        let radiance = if beside.iter().any(|&there| differs(here, &looks[there])) {
            let around = [at, beside[0], beside[1], beside[2], beside[3]].map(|there| &looks[there]);
            mixed_radiance(scene, eye, around, (column as f32, (first_row + row) as f32))
        } else {
            scene.radiance(&here.ray, here.hit.as_ref(), here.lit, eye.camera.focal_px)
        };
        bytes.copy_from_slice(&sensor.expose(radiance, first_row * width + pixel));
    }
}

/// The mean of four rays through a pixel whose centre and neighbours are `around`.
fn mixed_radiance(scene: &Scene, eye: &Eye, around: [&Look; 5], (column, row): (f32, f32)) -> Vec3 {
    // Where sun or shadow is all that is to be seen around, there is no need to ask for each ray.
    let mut seen = around.iter().filter(|look| look.hit.is_some()).map(|look| look.lit);
    let first = seen.next();
    let lit_everywhere = first.filter(|lit| seen.all(|other| other == *lit));
    let sum = SUBPIXELS.iter().fold(vec3(0.0, 0.0, 0.0), |sum, &(right, down)| {
        let (ray, hit) = scene.first_hit(eye, column + right, row + down);
        let lit = lit_everywhere.unwrap_or_else(|| is_lit(scene, &ray, hit.as_ref()));
        // Light beyond white is clipped where it falls: a bright sky does not eat the branches before it.
        let radiance = scene.radiance(&ray, hit.as_ref(), lit, eye.camera.focal_px);
        sum + vec3(radiance.x.min(WHITE), radiance.y.min(WHITE), radiance.z.min(WHITE))
    });
    sum * (1.0 / SUBPIXELS.len() as f32)
}

fn is_lit(scene: &Scene, ray: &Ray, hit: Option<&Hit>) -> bool {
    hit.is_some_and(|hit| scene.is_lit(ray.at(hit.depth), hit))
}

/// Whether two neighbouring pixels show different surfaces, or the same one in light and in shadow. Leaves before
/// leaves do not count: they are all edges.
fn differs(a: &Look, b: &Look) -> bool {
    match (&a.hit, &b.hit) {
        (None, None) => false,
        (Some(a_hit), Some(b_hit)) => {
            let curved = a_hit.part != Part::Carriageway && a_hit.normal.dot(b_hit.normal) < 0.75;
            !(a.leafy && b.leafy) && (a.lit != b.lit || a_hit.part != b_hit.part || curved)
        }
        _ => true,
    }
}
