//! Camera images, with the data set's own compressed bytes kept beside the pixels.

use std::sync::{Arc, OnceLock};

use image::{GrayImage, RgbImage};

/// The pixels of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// 8-bit grey.
    Grey(GrayImage),
    /// 8-bit RGB.
    Rgb(RgbImage),
}

/// A compressed format that recordings keep as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageFormat {
    /// Portable Network Graphics.
    Png,
    /// JPEG.
    Jpeg,
}

impl ImageFormat {
    /// The name `foxglove.CompressedImage` uses.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg => "jpeg",
        }
    }
}

/// An image file's own bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// How they are compressed.
    pub format: ImageFormat,
    /// The file's content.
    pub bytes: Arc<[u8]>,
}

/// An 8-bit image, grey or RGB.
#[derive(Clone, Debug)]
pub struct Image {
    pixels: Pixels,
    encoded: Option<Encoded>,
    grey: OnceLock<GrayImage>,
}

impl Image {
    /// An image made in memory.
    pub const fn new(pixels: Pixels) -> Self {
        Self { pixels, encoded: None, grey: OnceLock::new() }
    }

    /// An image with the bytes of its file, which a recording keeps unchanged.
    pub const fn with_encoded(pixels: Pixels, encoded: Encoded) -> Self {
        Self { pixels, encoded: Some(encoded), grey: OnceLock::new() }
    }

    /// The pixels.
    pub const fn pixels(&self) -> &Pixels {
        &self.pixels
    }

    /// The file's bytes, if it came from one.
    pub const fn encoded(&self) -> Option<&Encoded> {
        self.encoded.as_ref()
    }

    /// Columns and rows.
    pub fn dimensions(&self) -> (u32, u32) {
        match &self.pixels {
            Pixels::Grey(grey) => grey.dimensions(),
            Pixels::Rgb(rgb) => rgb.dimensions(),
        }
    }

    /// The grey image: the pixels, or `convert` of them, computed once. All nodes pass the same conversion; this
    /// crate has no pixel arithmetic.
    pub fn grey_with(&self, convert: impl FnOnce(&RgbImage) -> GrayImage) -> &GrayImage {
        match &self.pixels {
            Pixels::Grey(grey) => grey,
            Pixels::Rgb(rgb) => self.grey.get_or_init(|| convert(rgb)),
        }
    }
}
