//! What one look at the street gives.

/// An image's width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Size {
    /// KITTI's usual size after rectification.
    pub const KITTI: Self = Self { width: 1242, height: 375 };

    /// Pixels in all.
    #[must_use]
    pub fn pixels(self) -> usize {
        self.width * self.height
    }
}

/// The rectified pair: one focal length, one principal point, and a baseline along the rows. Pixel centres have integer
/// coordinates, as in KITTI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Focal length in pixels, the same along rows and columns.
    pub focal_px: f64,
    /// Column of the principal point.
    pub cx_px: f64,
    /// Row of the principal point.
    pub cy_px: f64,
    /// Distance of the right camera from the left one, metres.
    pub baseline_m: f64,
}

impl Calibration {
    /// Columns between a point's places in the left and the right image, for a depth in metres.
    #[must_use]
    pub fn disparity_px(&self, depth_m: f64) -> f64 {
        self.focal_px * self.baseline_m / depth_m
    }
}

/// One frame: the pair as the cameras deliver it, and the ground truth. Rows from the top, no padding.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Width and height of everything below.
    pub size: Size,
    /// Left image, RGB, 8 bits each, interleaved.
    pub left: Vec<u8>,
    /// Right image, likewise.
    pub right: Vec<u8>,
    /// Exact depth along the left camera's axis at pixel centres, metres; NaN where there is nothing (sky).
    pub depth: Vec<f32>,
    /// True where the surface of a left pixel is not seen by the right camera: hidden behind something nearer, or
    /// outside its image.
    pub occluded: Vec<bool>,
    /// True where a left pixel shows a car, as KITTI's `obj_map` marks them.
    pub cars: Vec<bool>,
    /// What a 64-beam laser scanner would have returned: a sparse subset of `depth`, NaN elsewhere. Occluded pixels
    /// are in it, as in KITTI's `disp_occ`; [`Frame::sparse_visible`] leaves them out.
    pub sparse: Vec<f32>,
    /// The cameras.
    pub calibration: Calibration,
}

impl Frame {
    /// `sparse` without the pixels that the right camera does not see, as in KITTI's `disp_noc`.
    #[must_use]
    pub fn sparse_visible(&self) -> Vec<f32> {
        self.sparse.iter().zip(&self.occluded).map(|(&depth, &hidden)| if hidden { f32::NAN } else { depth }).collect()
    }
}

/// Who does the work: called with a number of tiles and what renders one, it has called that for each of them, in any
/// order and on any thread, when it returns.
pub type Run<'a> = &'a dyn Fn(usize, &(dyn Fn(usize) + Sync));
