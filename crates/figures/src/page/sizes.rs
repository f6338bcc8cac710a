//! The sizes of pictures, and how many bytes pictures take in them.

use super::maps::{COARSE, FINE, Steps};
use super::series::{Role, Series, class_of};

/// The usual bytes of a pixel: of an image, and of a map with coarse steps.
const USUAL_BYTES: (f64, f64) = (0.35, 0.5);
/// The height of usual pictures, as a share of their width.
const USUAL_HEIGHT: f64 = 0.3;
/// The powers of the width that bytes grow with: for wider pictures than the probed ones, and for narrower ones, where
/// neighbouring pixels differ more. Both give an estimate that is rather too large.
const GROWTH: (f64, f64) = (2.0, 1.6);
/// The bytes of a map with fine steps, as a multiple of those with coarse steps.
const FINE_BYTES: f64 = 1.4;
/// How large the pictures are, and how fine their numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Size {
    /// The most columns of images; of estimates and truths; and of all other maps.
    pub(super) image: u32,
    pub(super) main: u32,
    other: u32,
    pub(super) steps: Steps,
}

const fn size(image: u32, main: u32, other: u32, steps: Steps) -> Size {
    Size { image, main, other, steps }
}

/// From the largest to the smallest.
pub(super) const SIZES: [Size; 15] = [
    size(640, 640, 640, FINE),
    size(640, 640, 320, FINE),
    size(640, 640, 320, COARSE),
    size(640, 560, 280, COARSE),
    size(576, 496, 248, COARSE),
    size(512, 432, 216, COARSE),
    size(512, 384, 192, COARSE),
    size(448, 336, 168, COARSE),
    size(448, 300, 150, COARSE),
    size(400, 272, 136, COARSE),
    size(400, 248, 124, COARSE),
    size(384, 224, 112, COARSE),
    size(352, 200, 100, COARSE),
    size(320, 176, 88, COARSE),
    size(320, 152, 76, COARSE),
];

/// What the width of a picture depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Class {
    Image,
    Main,
    Other,
}

impl Size {
    pub(super) fn widest(&self, class: Class) -> u32 {
        match class {
            Class::Image => self.image,
            Class::Main => self.main,
            Class::Other => self.other,
        }
    }
}

/// The bytes that pictures usually take in a size.
pub(super) fn usual_bytes(series: &[Series], size: &Size) -> f64 {
    let of_layer = |of: &Series, place: usize| {
        let class = class_of(of, place);
        let width = f64::from(size.widest(class));
        let pixels = frames_with(of, class) as f64 * USUAL_HEIGHT * width * width;
        let fine = if size.steps == FINE { FINE_BYTES } else { 1.0 };
        pixels * if of.layers[place].role == Role::Image { USUAL_BYTES.0 } else { fine * USUAL_BYTES.1 }
    };
    series.iter().map(|of| (0..of.layers.len()).map(|place| of_layer(of, place)).sum::<f64>()).sum()
}

/// How many frames have pictures of a class.
pub(super) fn frames_with(series: &Series, class: Class) -> usize {
    if class == Class::Other { series.detailed.len() } else { series.positions.len() }
}

/// The pictures of a topic in the size that was tried.
pub(super) struct Probe {
    pub(super) class: Class,
    pub(super) is_map: bool,
    /// The width of the recorded images or maps.
    pub(super) width: u32,
    pub(super) tried: Size,
    /// The bytes of all frames, if they are like those that were tried.
    pub(super) bytes: f64,
}

impl Probe {
    /// How many bytes the pictures are likely to take in a size.
    pub(super) fn bytes_in(&self, size: &Size) -> f64 {
        let width = |size: &Size| f64::from(size.widest(self.class).min(self.width).max(1));
        let ratio = width(size) / width(&self.tried);
        let growth = if ratio > 1.0 { GROWTH.0 } else { GROWTH.1 };
        let steps = |size: &Size| if self.is_map && size.steps == FINE { FINE_BYTES } else { 1.0 };
        self.bytes * libm::pow(ratio, growth) * steps(size) / steps(&self.tried)
    }
}
