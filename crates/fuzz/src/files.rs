//! Small valid files.

use std::io::Cursor;

use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb, RgbImage};

pub(crate) const SIZE: (u32, u32) = (16, 8);

pub(crate) fn image(format: ImageFormat) -> Vec<u8> {
    encoded(&colours(), format)
}

pub(crate) fn grey(format: ImageFormat) -> Vec<u8> {
    encoded(&DynamicImage::ImageLuma8(colours().into_luma8()), format)
}

pub(crate) fn map(format: ImageFormat) -> Vec<u8> {
    let map = ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| Luma([if x < 4 { 0 } else { (256 * x + y) as u16 }]));
    encoded(&DynamicImage::ImageLuma16(map), format)
}

fn colours() -> DynamicImage {
    DynamicImage::ImageRgb8(RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| Rgb([x as u8 * 9, y as u8 * 17, 77])))
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).expect("memory takes an image");
    bytes.into_inner()
}
