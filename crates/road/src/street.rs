//! A street: a seed, a size of image, and the car's steps along it.

use crate::camera::{Camera, HEIGHT_M, calibration};
use crate::frame::{Calibration, Frame, Run, Size};
use crate::hash::Draws;
use crate::layout::{EGO_LANE, Stretch};
use crate::light::Light;
use crate::render::render;
use crate::scene::Scene;
use crate::surfaces::ground::Ground;
use crate::surfaces::texture::WRAP_METRES;
use crate::vector::vec3;

/// Frames after which the street begins again.
const FRAMES: u64 = 1 << 32;
/// Speed of the car, metres a second.
const SPEED: f64 = 13.5;

/// A street and the camera pair that is driven along it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Street {
    seed: u64,
    size: Size,
    step_m: f64,
}

impl Street {
    /// Metres between frames unless [`Street::with_step`] says otherwise: a car in town looked at three or four times
    /// a second, so that a few dozen frames already show different places.
    pub const STEP_M: f64 = 4.0;

    /// The street of this seed, seen at this size.
    ///
    /// # Panics
    /// If the size has no pixels.
    #[must_use]
    pub const fn new(seed: u64, size: Size) -> Self {
        assert!(size.width > 0 && size.height > 0, "an image has pixels");
        Self { seed, size, step_m: Self::STEP_M }
    }

    /// The same street driven along in other steps, metres a frame.
    #[must_use]
    pub const fn with_step(self, step_m: f64) -> Self {
        Self { step_m, ..self }
    }

    /// The cameras, the same in all frames.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        calibration(self.size)
    }

    /// Frame `index`, a pure function of seed, size, step and index. `run` may spread the work over threads; the bits
    /// stay the same.
    #[must_use]
    pub fn frame(&self, index: u64, run: Run<'_>) -> Frame {
        let scene = self.scene(index);
        render(&scene, self.seed, index, self.size, &self.calibration(), run)
    }

    pub(crate) fn scene(&self, index: u64) -> Scene {
        // Metres stay exact far beyond any experiment; then the street begins again.
        let camera_m = (index % FRAMES) as f64 * self.step_m;
        let wrap = f64::from(WRAP_METRES);
        let origin_m = (camera_m / wrap).floor() * wrap;
        let stretch = Stretch { seed: self.seed, camera_m, origin_m, time_s: camera_m / SPEED };
        // The car sways in its lane, nods and turns a little: the road is never quite where a level camera would see
        // it.
        let mut draws = Draws::new(self.seed, 4, index.cast_signed());
        let calibration = self.calibration();
        let position = vec3(EGO_LANE + draws.between(-0.3, 0.3), HEIGHT_M, (camera_m - origin_m) as f32);
        let left = Camera::new(position, draws.between(-0.015, 0.015), draws.between(-0.008, 0.008), &calibration);
        let right = left.moved_right(calibration.baseline_m as f32);
        Scene::new(stretch.objects(), Ground::new(self.seed), Light::new(self.seed), left, right, self.size)
    }
}
