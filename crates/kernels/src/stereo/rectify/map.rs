//! Where the pixels of a rectified image come from.

use super::camera::Camera;
use super::matrix::{Matrix, inverse, product, times};

/// What a camera is turned and projected to: one of a rectified pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// From the camera's frame to the rectified one: OpenCV's `R1`, `R2`.
    pub rotation: Matrix,
    /// Focal length along rows and columns, px: `P[0,0]`, `P[1,1]`.
    pub focal_px: [f64; 2],
    /// Principal point, column and row, px: `P[0,2]`, `P[1,2]`.
    pub centre_px: [f64; 2],
}

impl View {
    /// The pixel of a point in the rectified frame.
    pub(super) fn pixel(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        [self.focal_px[0] * x / z + self.centre_px[0], self.focal_px[1] * y / z + self.centre_px[1]]
    }
}

/// How exactly a place between pixels is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// As it is, in 32-bit floats: OpenCV 5 with `CV_32FC1` maps.
    #[default]
    Float,
    /// In steps of 1/32 px: OpenCV 4, and OpenCV 5 with `CV_16SC2` maps.
    Fixed,
}

/// Steps of a pixel in [`Interpolation::Fixed`].
pub(super) const STEPS: i32 = 32;

/// The position of each pixel of a rectified image in the camera's image.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    pub(super) size: (usize, usize),
    pub(super) places: Places,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Places {
    /// Column and row, px; an infinite one lies nowhere.
    Float(Vec<[f32; 2]>),
    /// Column and row in [`STEPS`] of a pixel.
    Fixed(Vec<[i32; 2]>),
}

impl Map {
    /// The map of a camera to a view of (width, height): OpenCV's `initUndistortRectifyMap`.
    #[must_use]
    pub fn new(camera: &Camera, view: &View, (width, height): (u32, u32), interpolation: Interpolation) -> Self {
        // Of a rotation that a file gives in few digits the inverse is not the transpose, and OpenCV inverts the
        // product.
        let projection =
            [[view.focal_px[0], 0.0, view.centre_px[0]], [0.0, view.focal_px[1], view.centre_px[1]], [0.0, 0.0, 1.0]];
        let back = inverse(&product(&projection, &view.rotation));
        let place = |column: u32, row: u32| {
            let [x, y, z] = times(&back, [f64::from(column), f64::from(row), 1.0]);
            // Points behind the camera are not visible.
            if z > 0.0 { camera.pixel([x / z, y / z]) } else { [f64::INFINITY; 2] }
        };
        let all = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let all = all.map(|(column, row)| place(column, row));
        let places = match interpolation {
            Interpolation::Float => Places::Float(all.map(|place| place.map(|at| at as f32)).collect()),
            Interpolation::Fixed => {
                let fixed = |at: f64| libm::rint(at * f64::from(STEPS)) as i32;
                Places::Fixed(all.map(|place| place.map(fixed)).collect())
            }
        };
        Self { size: (width as usize, height as usize), places }
    }

    /// Columns and rows of the rectified image.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The position of a pixel of the rectified image in the camera's image, column and row, px.
    ///
    /// # Panics
    /// If there is no such pixel.
    #[must_use]
    pub fn place(&self, column: usize, row: usize) -> [f64; 2] {
        let at = row * self.size.0 + column;
        match &self.places {
            Places::Float(places) => places[at].map(f64::from),
            Places::Fixed(places) => places[at].map(|steps| f64::from(steps) / f64::from(STEPS)),
        }
    }
}
