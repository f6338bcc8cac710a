//! Which objects a ray can meet at all: lists by tile of a camera's image, and by cell of the sun's view of the street.

use crate::camera::Camera;
use crate::frame::Size;
use crate::object::Object;
use crate::shape::Bounds;
use crate::surfaces::texture::floor;
use crate::vector::Vec3;

/// Lists of objects by cell, all in one allocation.
#[derive(Debug)]
struct Cells {
    starts: Vec<u32>,
    entries: Vec<u32>,
}

/// A rectangle of cells: first and last column, first and last row.
type Extent = (usize, usize, usize, usize);

impl Cells {
    /// Objects enter their cells in the order given.
    fn new(columns: usize, rows: usize, extents: &[(u32, Extent)]) -> Self {
        let mut starts = vec![0_u32; columns * rows + 1];
        for &(_, (c0, c1, r0, r1)) in extents {
            for row in r0..=r1 {
                for cell in &mut starts[row * columns + c0 + 1..=row * columns + c1 + 1] {
                    *cell += 1;
                }
            }
        }
        let mut total = 0;
        for start in &mut starts {
            total += *start;
            *start = total;
        }
        let mut next = starts.clone();
        let mut entries = vec![0; total as usize];
        for &(object, (c0, c1, r0, r1)) in extents {
            for row in r0..=r1 {
                for next in &mut next[row * columns + c0..=row * columns + c1] {
                    entries[*next as usize] = object;
                    *next += 1;
                }
            }
        }
        Self { starts, entries }
    }

    fn list(&self, cell: usize) -> &[u32] {
        &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

const TILE_COLUMNS: usize = 16;
const TILE_ROWS: usize = 8;

/// Where an object can be seen at all: a rectangle of the image (pixels, one to spare on every side), and its least
/// depth.
#[derive(Clone, Copy, Debug)]
struct Seen {
    object: u32,
    nearest: f32,
    left: f32,
    right: f32,
    top: f32,
    bottom: f32,
}

/// A camera's image in tiles: what can be seen in each, nearest first.
#[derive(Debug)]
pub(crate) struct ScreenTiles {
    columns: usize,
    rows: usize,
    cells: Cells,
    seen: Vec<Seen>,
}

impl ScreenTiles {
    pub(crate) fn new(camera: &Camera, size: Size, objects: &[Object]) -> Self {
        let (columns, rows) = (size.width.div_ceil(TILE_COLUMNS), size.height.div_ceil(TILE_ROWS));
        let mut seen: Vec<Seen> = objects
            .iter()
            .enumerate()
            .filter_map(|(index, object)| on_screen(camera, size, index as u32, &object.bounds))
            .collect();
        seen.sort_by(|a, b| a.nearest.total_cmp(&b.nearest).then(a.object.cmp(&b.object)));
        let tile = |at: f32, length: usize, of: usize| (at.max(0.0) as usize).min(length - 1) / of;
        let extents: Vec<_> = seen
            .iter()
            .enumerate()
            .map(|(index, seen)| {
                let across = (tile(seen.left, size.width, TILE_COLUMNS), tile(seen.right, size.width, TILE_COLUMNS));
                let down = (tile(seen.top, size.height, TILE_ROWS), tile(seen.bottom, size.height, TILE_ROWS));
                (index as u32, (across.0, across.1, down.0, down.1))
            })
            .collect();
        Self { columns, rows, cells: Cells::new(columns, rows, &extents), seen }
    }

    /// Calls `meet` with objects that a ray through this place of the image may meet, nearest first. `meet` is given
    /// an object and the depth it has to beat, and returns the depth to beat from then on.
    pub(crate) fn along(&self, column: f32, row: f32, mut limit: f32, mut meet: impl FnMut(u32, f32) -> f32) {
        let tile_column = (column.max(0.0) as usize / TILE_COLUMNS).min(self.columns - 1);
        let tile_row = (row.max(0.0) as usize / TILE_ROWS).min(self.rows - 1);
        for &index in self.cells.list(tile_row * self.columns + tile_column) {
            let seen = &self.seen[index as usize];
            if seen.nearest >= limit {
                break;
            }
            if column >= seen.left && column <= seen.right && row >= seen.top && row <= seen.bottom {
                limit = meet(seen.object, limit);
            }
        }
    }
}

fn on_screen(camera: &Camera, size: Size, object: u32, bounds: &Bounds) -> Option<Seen> {
    // Nothing nearer than this is in the field of view: cut it off, so that the rest projects.
    let cut = camera.position.z + 0.3;
    if bounds.high.z <= cut {
        return None;
    }
    let front = Bounds { low: Vec3 { z: bounds.low.z.max(cut), ..bounds.low }, high: bounds.high };
    let mut seen = Seen { object, nearest: f32::MAX, left: f32::MAX, right: f32::MIN, top: f32::MAX, bottom: f32::MIN };
    for corner in front.corners() {
        let Some((u, v, depth)) = camera.project(corner) else {
            let (left, top) = (f32::MIN, f32::MIN);
            return Some(Seen { object, nearest: 0.0, left, right: f32::MAX, top, bottom: f32::MAX });
        };
        (seen.left, seen.right) = (seen.left.min(u - 1.0), seen.right.max(u + 1.0));
        (seen.top, seen.bottom) = (seen.top.min(v - 1.0), seen.bottom.max(v + 1.0));
        seen.nearest = seen.nearest.min(depth * 0.9999);
    }
    let inside =
        seen.right > -1.0 && seen.left < size.width as f32 && seen.bottom > -1.0 && seen.top < size.height as f32;
    inside.then_some(seen)
}

/// An object's shadow on the road's plane lies within this rectangle, metres from the cells' corner.
#[derive(Clone, Copy, Debug)]
struct Shadow {
    object: u32,
    x: (f32, f32),
    z: (f32, f32),
}

/// The street as the sun sees it: cells of one metre on the road's plane, points carried there along the light.
#[derive(Debug)]
pub(crate) struct SunCells {
    low_x: f32,
    low_z: f32,
    columns: usize,
    rows: usize,
    /// Metres of shift along x and z per metre of height.
    slope: (f32, f32),
    cells: Cells,
    shadows: Vec<Shadow>,
}

/// Shadows are cast within this distance along the street and to either side of it.
const SHADOW_AHEAD: f32 = 150.0;
const SHADOW_BEHIND: f32 = 12.0;
const SHADOW_ASIDE: f32 = 30.0;

impl SunCells {
    pub(crate) fn new(sun: Vec3, camera_z: f32, objects: &[Object]) -> Self {
        let slope = (sun.x / sun.y, sun.z / sun.y);
        let (low_x, low_z) = (-SHADOW_ASIDE, camera_z - SHADOW_BEHIND);
        let (columns, rows) = ((2.0 * SHADOW_ASIDE) as usize, (SHADOW_AHEAD + SHADOW_BEHIND) as usize);
        let mut shadows: Vec<Shadow> = objects
            .iter()
            .enumerate()
            .map(|(index, object)| {
                let (mut x0, mut x1, mut z0, mut z1) = (f32::MAX, f32::MIN, f32::MAX, f32::MIN);
                for corner in object.bounds.corners() {
                    let (x, z) = (corner.x - corner.y * slope.0 - low_x, corner.z - corner.y * slope.1 - low_z);
                    (x0, x1, z0, z1) = (x0.min(x), x1.max(x), z0.min(z), z1.max(z));
                }
                Shadow { object: index as u32, x: (x0 - 0.01, x1 + 0.01), z: (z0 - 0.01, z1 + 0.01) }
            })
            .filter(|s| s.x.1 >= 0.0 && s.z.1 >= 0.0 && s.x.0 < columns as f32 && s.z.0 < rows as f32)
            .collect();
        // Large things first: they end most queries.
        let area = |s: &Shadow| (s.x.1 - s.x.0) * (s.z.1 - s.z.0);
        shadows.sort_by(|a, b| area(b).total_cmp(&area(a)).then(a.object.cmp(&b.object)));
        let cell = |at: f32, count: usize| (at.max(0.0) as usize).min(count - 1);
        let extents: Vec<_> = shadows
            .iter()
            .enumerate()
            .map(|(index, s)| {
                (index as u32, (cell(s.x.0, columns), cell(s.x.1, columns), cell(s.z.0, rows), cell(s.z.1, rows)))
            })
            .collect();
        Self { low_x, low_z, columns, rows, slope, cells: Cells::new(columns, rows, &extents), shadows }
    }

    /// Whether one of the objects that may stand between this point and the sun does, as `blocks` decides.
    pub(crate) fn any_towards_sun(&self, point: Vec3, mut blocks: impl FnMut(u32) -> bool) -> bool {
        let (x, z) = (point.x - point.y * self.slope.0 - self.low_x, point.z - point.y * self.slope.1 - self.low_z);
        let (column, row) = (floor(x), floor(z));
        if column < 0 || row < 0 || column as usize >= self.columns || row as usize >= self.rows {
            return false;
        }
        self.cells.list(row as usize * self.columns + column as usize).iter().any(|&index| {
            let shadow = &self.shadows[index as usize];
            x >= shadow.x.0 && x <= shadow.x.1 && z >= shadow.z.0 && z <= shadow.z.1 && blocks(shadow.object)
        })
    }
}
