//! A map as a few coloured pixels, for a terminal.

use depthloom_graphs::Value;
use image::RgbImage;

/// A map reduced to the size of a terminal: each pixel is the nearest one of the map's picture.
pub(super) struct Picture {
    image: RgbImage,
    pub(super) width: u32,
    pub(super) height: u32,
}

impl Picture {
    /// At most so large, with the sides in proportion. `None` if the value is not a map, or there is no room.
    pub(super) fn new(map: &Value, most_width: u32, most_height: u32) -> Option<Self> {
        let image = image::load_from_memory(&depthloom_codecs::picture::picture(map)?).ok()?.into_rgb8();
        let scale =
            (f64::from(most_width) / f64::from(image.width())).min(f64::from(most_height) / f64::from(image.height()));
        let side = |pixels: u32| (f64::from(pixels) * scale) as u32;
        let (width, height) = (side(image.width()), side(image.height()));
        (width > 0 && height > 0).then_some(Self { image, width, height })
    }

    pub(super) fn colour(&self, x: u32, y: u32) -> [u8; 3] {
        self.image.get_pixel(x * self.image.width() / self.width, y * self.image.height() / self.height).0
    }
}
