//! Images in the pixel formats of cameras, as 8-bit grey or RGB.

use depthloom_codecs::jpeg;
use depthloom_graphs::values::Pixels;
use image::{GenericImageView as _, GrayImage, RgbImage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Pixel format in which the camera sends images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PixelFormat {
    /// Uncompressed colour, 16 bits per pixel.
    #[default]
    Yuyv,
    /// JPEG, for large images on USB 2.
    Mjpg,
    /// 8-bit grey.
    Grey,
}

impl PixelFormat {
    /// Decodes one image. Rows of uncompressed formats are `stride` bytes apart.
    pub(super) fn decode(self, bytes: &[u8], (width, height): (u32, u32), stride: u32) -> Result<Pixels, String> {
        let pixels = match self {
            Self::Yuyv => Pixels::Rgb(yuyv(bytes, (width, height), stride)?),
            Self::Grey => Pixels::Grey(grey(bytes, (width, height), stride)?),
            Self::Mjpg => jpeg::decode(bytes)?.ok_or("the JPEG image is neither grey nor RGB with 8 bits")?,
        };
        let size = match &pixels {
            Pixels::Grey(grey) => grey.dimensions(),
            Pixels::Rgb(rgb) => rgb.dimensions(),
        };
        if size != (width, height) {
            return Err(format!("the image is {}x{}, expected {width}x{height}", size.0, size.1));
        }
        Ok(pixels)
    }
}

/// The rows of an image, without the bytes between them.
fn rows(bytes: &[u8], row: u32, height: u32, stride: u32) -> Result<impl Iterator<Item = &[u8]>, String> {
    let (row, height, stride) = (row as usize, height as usize, stride.max(row) as usize);
    let least = if height == 0 { 0 } else { stride * (height - 1) + row };
    if row == 0 || bytes.len() < least {
        return Err(format!("the image has {} bytes, expected {least}", bytes.len()));
    }
    Ok(bytes.chunks(stride).take(height).map(move |line| &line[..row]))
}

fn grey(bytes: &[u8], (width, height): (u32, u32), stride: u32) -> Result<GrayImage, String> {
    let pixels = rows(bytes, width, height, stride)?.flatten().copied().collect();
    GrayImage::from_raw(width, height, pixels).ok_or_else(|| "the image is incomplete".to_owned())
}

/// OpenCV's `COLOR_YUV2RGB_YUYV`, bit by bit: BT.601, limited range, in fixed point with 20 bits.
fn yuyv(bytes: &[u8], (width, height): (u32, u32), stride: u32) -> Result<RgbImage, String> {
    const LUMA: i32 = 1_220_542;
    const BLUE_U: i32 = 2_116_026;
    const GREEN_U: i32 = -409_993;
    const GREEN_V: i32 = -852_492;
    const RED_V: i32 = 1_673_527;
    const HALF: i32 = 1 << 19;
    if width % 2 == 1 {
        return Err(format!("a YUYV image of {width} columns is not possible: two pixels share their colour"));
    }
    let mut rgb = Vec::with_capacity(3 * width as usize * height as usize);
    for row in rows(bytes, 2 * width, height, stride)? {
        for [first, u, second, v] in row.as_chunks::<4>().0 {
            let [u, v] = [u, v].map(|part| i32::from(*part) - 128);
            let colour = [HALF + RED_V * v, HALF + GREEN_V * v + GREEN_U * u, HALF + BLUE_U * u];
            for luma in [first, second] {
                let luma = LUMA * (i32::from(*luma) - 16).max(0);
                rgb.extend(colour.map(|part| ((luma + part) >> 20).clamp(0, 255) as u8));
            }
        }
    }
    RgbImage::from_raw(width, height, rgb).ok_or_else(|| "the image is incomplete".to_owned())
}

/// The left and the right half.
pub(super) fn halves(pixels: &Pixels) -> Result<[Pixels; 2], String> {
    let (width, height) = match pixels {
        Pixels::Grey(grey) => grey.dimensions(),
        Pixels::Rgb(rgb) => rgb.dimensions(),
    };
    if width % 2 == 1 {
        return Err(format!("an image of {width} columns cannot be split into two of the same size"));
    }
    let half = width / 2;
    Ok([0, half].map(|x| match pixels {
        Pixels::Grey(grey) => Pixels::Grey(grey.view(x, 0, half, height).to_image()),
        Pixels::Rgb(rgb) => Pixels::Rgb(rgb.view(x, 0, half, height).to_image()),
    }))
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::Pixels;
    use image::{GrayImage, RgbImage};

    use super::{PixelFormat, halves};

    /// OpenCV 5.0.0, `cv2.cvtColor(..., cv2.COLOR_YUV2RGB_YUYV)`: limits, saturation, colours.
    const YUYV: [u8; 24] =
        [16, 128, 235, 128, 81, 90, 145, 240, 41, 240, 210, 110, 0, 0, 255, 255, 128, 60, 17, 200, 99, 1, 3, 254];
    const RGB: [u8; 36] = [
        0, 0, 0, 255, 255, 255, 254, 0, 0, 255, 74, 73, 0, 0, 255, 197, 197, 255, 203, 0, 0, 255, 225, 20, 245, 98, 0,
        116, 0, 0, 255, 44, 0, 201, 0, 0,
    ];

    fn rgb(pixels: Result<Pixels, String>) -> Result<RgbImage, String> {
        match pixels? {
            Pixels::Rgb(rgb) => Ok(rgb),
            Pixels::Grey(_) => Err("it is grey".to_owned()),
        }
    }

    #[test]
    fn yuyv_is_converted_as_opencv_does() {
        assert_eq!(rgb(PixelFormat::Yuyv.decode(&YUYV, (12, 1), 24)).unwrap().as_raw(), &RGB);
        // Two rows of six pixels, with four bytes after each.
        let mut padded = Vec::new();
        for row in YUYV.chunks(12) {
            padded.extend_from_slice(row);
            padded.extend([9; 4]);
        }
        assert_eq!(rgb(PixelFormat::Yuyv.decode(&padded, (6, 2), 16)).unwrap().as_raw(), &RGB);
        assert_eq!(rgb(PixelFormat::Yuyv.decode(&padded[..28], (6, 2), 16)).unwrap().as_raw(), &RGB, "no last padding");
        let what = rgb(PixelFormat::Yuyv.decode(&padded[..27], (6, 2), 16)).unwrap_err();
        assert_eq!(what, "the image has 27 bytes, expected 28");
        assert!(rgb(PixelFormat::Yuyv.decode(&YUYV, (3, 2), 6)).unwrap_err().contains("3 columns"));
    }

    #[test]
    fn grey_rows_lose_their_padding() {
        let Pixels::Grey(grey) = PixelFormat::Grey.decode(&[1, 2, 0, 3, 4, 0], (2, 2), 3).unwrap() else { panic!() };
        assert_eq!(grey.as_raw(), &[1, 2, 3, 4]);
        assert!(PixelFormat::Grey.decode(&[1, 2], (2, 2), 0).is_err());
    }

    #[test]
    fn jpeg_images_have_the_expected_size() {
        let image = GrayImage::from_pixel(16, 8, image::Luma([77]));
        let mut file = Vec::new();
        image::codecs::jpeg::JpegEncoder::new(&mut file).encode_image(&image).unwrap();
        let Pixels::Grey(decoded) = PixelFormat::Mjpg.decode(&file, (16, 8), 0).unwrap() else { panic!() };
        assert!(decoded.iter().all(|pixel| pixel.abs_diff(77) < 3));
        let what = PixelFormat::Mjpg.decode(&file, (8, 8), 0).unwrap_err();
        assert_eq!(what, "the image is 16x8, expected 8x8");
        assert!(PixelFormat::Mjpg.decode(&file[..file.len() / 2], (16, 8), 0).is_err());
    }

    #[test]
    fn an_image_is_split_into_left_and_right() {
        let image = GrayImage::from_raw(4, 2, vec![1, 2, 3, 4, 5, 6, 7, 8]).unwrap();
        let [left, right] = halves(&Pixels::Grey(image)).unwrap();
        assert_eq!(left, Pixels::Grey(GrayImage::from_raw(2, 2, vec![1, 2, 5, 6]).unwrap()));
        assert_eq!(right, Pixels::Grey(GrayImage::from_raw(2, 2, vec![3, 4, 7, 8]).unwrap()));
        let [_, right] = halves(&Pixels::Rgb(RgbImage::from_raw(2, 1, vec![1, 2, 3, 4, 5, 6]).unwrap())).unwrap();
        assert_eq!(right, Pixels::Rgb(RgbImage::from_raw(1, 1, vec![4, 5, 6]).unwrap()));
        assert!(halves(&Pixels::Grey(GrayImage::new(3, 2))).is_err());
    }
}
