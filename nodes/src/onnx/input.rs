//! An image as a network wants it: resized, normalised, in its order of axes and channels.

use depthloom_graphs::values::{Image, Pixels};
use depthloom_kernels::memory::{TooMuch, zeros};
use depthloom_kernels::resize::{area_rgb8, bilinear_f32};

use super::params::{Channels, OnnxParams, Resize, TensorLayout};

/// The size of a network's input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputSize {
    /// 1 (grey) or 3.
    pub channels: usize,
    /// Columns, px.
    pub width: usize,
    /// Rows, px.
    pub height: usize,
}

impl InputSize {
    fn pixels(self) -> usize {
        self.width * self.height
    }

    /// Numbers in the tensor of one image.
    pub const fn samples(self) -> usize {
        self.width * self.height * self.channels
    }
}

/// The tensor of an image, batch of one, in the order `layout` says.
///
/// # Errors
/// If there is not the memory for it.
pub fn tensor(image: &Image, size: InputSize, params: &OnnxParams) -> Result<Vec<f32>, TooMuch> {
    let rgb = resized(image, size, params.resize, params.round)?;
    let pixels = size.pixels();
    let mut tensor = zeros::<f32>(pixels * size.channels)?;
    for channel in 0..size.channels {
        // Mean and deviation go with the network's channels, in its own order.
        let (mean, deviation) = (params.mean[channel] as f32, params.std[channel] as f32);
        let colour = match params.channels {
            Channels::Rgb => channel,
            Channels::Bgr => size.channels - 1 - channel,
        };
        for (pixel, sample) in rgb.iter().skip(colour).step_by(size.channels).enumerate() {
            let at = match params.layout {
                TensorLayout::Nchw => channel * pixels + pixel,
                TensorLayout::Nhwc => pixel * size.channels + channel,
            };
            tensor[at] = (sample / 255.0 - mean) / deviation;
        }
    }
    Ok(tensor)
}

/// The tensor of the mirror image: every row from right to left.
pub fn mirrored(tensor: &[f32], size: InputSize, layout: TensorLayout) -> Vec<f32> {
    // What moves together: a value, or all channels of a pixel.
    let together = match layout {
        TensorLayout::Nchw => 1,
        TensorLayout::Nhwc => size.channels,
    };
    let rows = tensor.chunks_exact(size.width * together);
    rows.flat_map(|row| row.chunks_exact(together).rev().flatten()).copied().collect()
}

/// The image, grey or in colour, interleaved, 0 to 255.
pub(super) fn as_it_is(image: &Image, channels: usize) -> Vec<f32> {
    match channels {
        1 => crate::grey::grey(image).iter().map(|&value| f32::from(value)).collect(),
        _ => colour(image).iter().map(|&value| f32::from(value)).collect(),
    }
}

/// The image at the network's size, interleaved, 0 to 255.
pub(super) fn resized(image: &Image, size: InputSize, resize: Resize, round: bool) -> Result<Vec<f32>, TooMuch> {
    let (columns, rows) = image.dimensions();
    let (width, height) = (columns as usize, rows as usize);
    let interleaved = if size.channels == 1 { grey_as_rgb(image) } else { colour(image) };
    let rgb = match resize {
        Resize::Area => {
            let mut small = zeros::<u8>(size.pixels() * 3)?;
            area_rgb8(&interleaved, width, height, size.width, size.height, &mut small);
            small.into_iter().map(f32::from).collect()
        }
        Resize::Bilinear => {
            let mut rgb = zeros::<f32>(size.pixels() * 3)?;
            let mut plane = zeros::<f32>(size.pixels())?;
            for channel in 0..3 {
                let samples: Vec<f32> = interleaved.iter().skip(channel).step_by(3).map(|&v| f32::from(v)).collect();
                bilinear_f32(&samples, width, height, size.width, size.height, &mut plane);
                for (sample, &value) in rgb.iter_mut().skip(channel).step_by(3).zip(&plane) {
                    *sample = if round { value.round_ties_even() } else { value };
                }
            }
            rgb
        }
    };
    Ok(if size.channels == 1 { rgb.into_iter().step_by(3).collect() } else { rgb })
}

fn colour(image: &Image) -> std::borrow::Cow<'_, [u8]> {
    match image.pixels() {
        Pixels::Rgb(rgb) => rgb.as_raw().into(),
        Pixels::Grey(grey) => grey.iter().flat_map(|&value| [value; 3]).collect::<Vec<u8>>().into(),
    }
}

fn grey_as_rgb(image: &Image) -> std::borrow::Cow<'_, [u8]> {
    crate::grey::grey(image).iter().flat_map(|&value| [value; 3]).collect::<Vec<u8>>().into()
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::{Image, Pixels};
    use image::RgbImage;

    use super::{InputSize, mirrored, tensor};
    use crate::onnx::params::{Channels, OnnxParams, TensorLayout};

    fn image() -> Image {
        Image::new(Pixels::Rgb(RgbImage::from_raw(2, 1, vec![255, 0, 51, 102, 153, 204]).unwrap()))
    }

    const SIZE: InputSize = InputSize { channels: 3, width: 2, height: 1 };

    #[test]
    fn channels_lie_in_planes_or_interleaved_and_in_either_order() {
        let of = |layout, channels| {
            tensor(&image(), SIZE, &OnnxParams { layout, channels, ..OnnxParams::default() }).unwrap()
        };
        assert_eq!(of(TensorLayout::Nchw, Channels::Rgb), [1.0, 0.4, 0.0, 0.6, 0.2, 0.8]);
        assert_eq!(of(TensorLayout::Nhwc, Channels::Rgb), [1.0, 0.0, 0.2, 0.4, 0.6, 0.8]);
        assert_eq!(of(TensorLayout::Nchw, Channels::Bgr), [0.2, 0.8, 0.0, 0.6, 1.0, 0.4]);
    }

    #[test]
    fn mean_and_deviation_are_those_of_the_networks_channels() {
        let params = OnnxParams {
            channels: Channels::Bgr,
            mean: [0.2, 0.0, 1.0],
            std: [0.5, 2.0, 1.0],
            ..OnnxParams::default()
        };
        let expected = [0.0, 1.2, 0.0, 0.3, 0.0, -0.6];
        for (found, expected) in tensor(&image(), SIZE, &params).unwrap().iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
        }
    }

    #[test]
    fn the_mirror_image_keeps_its_colours_in_either_layout() {
        let turned = Image::new(Pixels::Rgb(RgbImage::from_raw(2, 1, vec![102, 153, 204, 255, 0, 51]).unwrap()));
        for layout in [TensorLayout::Nchw, TensorLayout::Nhwc] {
            let params = OnnxParams { layout, ..OnnxParams::default() };
            let [plain, turned] = [image(), turned.clone()].map(|image| tensor(&image, SIZE, &params).unwrap());
            assert_eq!(mirrored(&plain, SIZE, layout), turned);
        }
    }

    #[test]
    fn a_network_of_one_channel_sees_opencvs_grey() {
        let grey = tensor(&image(), InputSize { channels: 1, ..SIZE }, &OnnxParams::default()).unwrap();
        assert_eq!(grey, [82.0 / 255.0, 144.0 / 255.0]);
    }
}
