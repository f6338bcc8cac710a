//! From a scene to a frame, band of rows by band of rows.
//!
//! Every pixel is looked at once at its centre; where a neighbour shows something else (another thing, another face,
//! light or shadow) four rays are averaged, elsewhere textures know how to fade by themselves.

use std::sync::{Mutex, PoisonError};

use super::camera::Ray;
use super::frame::{Calibration, Frame, Size};
use super::lidar::scan;
use super::scene::{Eye, Hit, Part, Scene};
use super::sensor::Sensor;
use super::street::Run;
use super::vector::{Vec3, vec3};

/// Rows of a band: one tile of work. Depends on nothing but the image.
const BAND_ROWS: usize = 16;
/// Where the four rays of a mixed pixel pass, in pixels from its centre.
const SUBPIXELS: [(f32, f32); 4] = [(-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)];
/// Relative difference of depth above which a surface hides another from the right camera, and not itself.
const NEARER: f32 = 1e-3;

/// A band's rows of all outputs.
struct Band<'a> {
    first_row: usize,
    left: &'a mut [u8],
    right: &'a mut [u8],
    depth: &'a mut [f32],
    occluded: &'a mut [bool],
    reflects: &'a mut [u8],
}

/// What one look at a pixel's centre found.
#[derive(Clone, Copy)]
struct Look {
    ray: Ray,
    hit: Option<Hit>,
    lit: bool,
}

/// Renders both images and the truth.
pub(super) fn render(
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
    {
        let chunk = BAND_ROWS * size.width;
        let bands: Vec<Mutex<Band<'_>>> = left
            .chunks_mut(3 * chunk)
            .zip(right.chunks_mut(3 * chunk))
            .zip(depth.chunks_mut(chunk))
            .zip(occluded.chunks_mut(chunk))
            .zip(reflects.chunks_mut(chunk))
            .enumerate()
            .map(|(band, ((((left, right), depth), occluded), reflects))| {
                Mutex::new(Band { first_row: band * BAND_ROWS, left, right, depth, occluded, reflects })
            })
            .collect();
        let sensors = [Sensor::new(seed, index, 0), Sensor::new(seed, index, 1)];
        run(bands.len(), &|band| {
            // Each band is taken once: the lock only hands the slices over, and a poisoned one means that a panic is
            // on its way up already.
            let mut band = bands[band].lock().unwrap_or_else(PoisonError::into_inner);
            band.fill(scene, &sensors, size);
        });
    }
    let sparse = scan(seed, index, size, calibration, &depth, &reflects);
    Frame { size, left, right, depth, occluded, sparse, calibration: *calibration }
}

impl Band<'_> {
    fn fill(&mut self, scene: &Scene, sensors: &[Sensor; 2], size: Size) {
        let rows = self.depth.len() / size.width;
        let looks = look(scene, &scene.left, self.first_row, rows, size);
        for (pixel, look) in looks[size.width..][..rows * size.width].iter().enumerate() {
            let Some(hit) = look.hit else { continue };
            self.depth[pixel] = hit.depth;
            self.occluded[pixel] = is_hidden(scene, look.ray.at(hit.depth), size);
            self.reflects[pixel] = scene.reflectivity(&hit);
        }
        expose(scene, &scene.left, &looks, &sensors[0], self.first_row, size, self.left);
        let looks = look(scene, &scene.right, self.first_row, rows, size);
        expose(scene, &scene.right, &looks, &sensors[1], self.first_row, size, self.right);
    }
}

/// Looks at the centres of a band's pixels, and of one row more above and below.
fn look(scene: &Scene, eye: &Eye, first_row: usize, rows: usize, size: Size) -> Vec<Look> {
    let mut looks = Vec::with_capacity((rows + 2) * size.width);
    for row in 0..rows + 2 {
        let v = (first_row + row) as f32 - 1.0;
        for column in 0..size.width {
            looks.push(look_at(scene, eye, column as f32, v));
        }
    }
    looks
}

fn look_at(scene: &Scene, eye: &Eye, column: f32, row: f32) -> Look {
    let (ray, hit) = scene.first_hit(eye, column, row);
    let lit = hit.is_some_and(|hit| scene.is_lit(ray.at(hit.depth), &hit));
    Look { ray, hit, lit }
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
        let mixed = differs(here, &looks[at - width])
            || differs(here, &looks[at + width])
            || (column > 0 && differs(here, &looks[at - 1]))
            || (column + 1 < width && differs(here, &looks[at + 1]));
        let focal = eye.camera.focal_px;
        let radiance = if mixed {
            let (u, v) = (column as f32, (first_row + row) as f32);
            let sum = SUBPIXELS.iter().fold(vec3(0.0, 0.0, 0.0), |sum, &(du, dv)| {
                let look = look_at(scene, eye, u + du, v + dv);
                // Light beyond white is clipped where it falls: a bright sky does not eat the branches before it.
                let radiance = scene.radiance(&look.ray, look.hit.as_ref(), look.lit, focal);
                sum + vec3(radiance.x.min(1.3), radiance.y.min(1.3), radiance.z.min(1.3))
            });
            sum * 0.25
        } else {
            scene.radiance(&here.ray, here.hit.as_ref(), here.lit, focal)
        };
        bytes.copy_from_slice(&sensor.expose(radiance, first_row * width + pixel));
    }
}

/// Whether two neighbouring pixels show different surfaces, or the same one in light and in shadow.
fn differs(a: &Look, b: &Look) -> bool {
    match (&a.hit, &b.hit) {
        (None, None) => false,
        (Some(a_hit), Some(b_hit)) => {
            a.lit != b.lit
                || a_hit.part != b_hit.part
                || (a_hit.part != Part::Carriageway && a_hit.normal.dot(b_hit.normal) < 0.75)
        }
        _ => true,
    }
}
