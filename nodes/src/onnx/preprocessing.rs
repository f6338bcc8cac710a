//! How a network wants to see an image: channels, normalisation, size.

use depthloom_graphs::values::Image;
use depthloom_kernels::memory::TooMuch;

use super::fit::{Fitted, PadWith};
use super::input::{self, InputSize};
use super::params::{Channels, Resize};

#[derive(Clone, Debug)]
pub(crate) struct Preprocessing {
    pub channels: Channels,
    /// Subtracted from each channel, in the network's channel order.
    pub mean: [f64; 3],
    pub std: [f64; 3],
    /// Value of white before `mean` and `std`: 1 or 255.
    pub white: f64,
    pub resize: Resize,
    pub round: bool,
    pub pad_with: PadWith,
}

impl Preprocessing {
    /// Returns one or three planes in the network's channel order and size.
    pub(crate) fn planes(
        &self,
        image: &Image,
        count: usize,
        fitted: &Fitted,
        mirrored: bool,
    ) -> Result<Vec<Vec<f32>>, TooMuch> {
        let (width, height) = if fitted.resizes() { fitted.to } else { fitted.from };
        let samples = if fitted.resizes() {
            input::resized(image, InputSize { channels: count, width, height }, self.resize, self.round)?
        } else {
            input::as_it_is(image, count)
        };
        let plane = |channel: usize| {
            let (mean, deviation) = (self.mean[channel] as f32, self.std[channel] as f32);
            let colour = match self.channels {
                Channels::Rgb => channel,
                Channels::Bgr => count - 1 - channel,
            };
            let white = self.white as f32;
            let of_colour = samples.iter().skip(colour).step_by(count);
            let mut plane: Vec<f32> = of_colour.map(|sample| (sample / 255.0 * white - mean) / deviation).collect();
            if mirrored {
                plane.chunks_exact_mut(width).for_each(<[f32]>::reverse);
            }
            if fitted.resizes() { Ok(plane) } else { fitted.padded(&plane, self.pad_with) }
        };
        (0..count).map(plane).collect()
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::{Image, Pixels};
    use image::RgbImage;

    use super::Preprocessing;
    use crate::onnx::params::{Channels, Resize};
    use crate::onnx::{Fit, Fitted, PadAt, PadWith, Sizes};

    const PLAIN: Preprocessing = Preprocessing {
        channels: Channels::Rgb,
        mean: [0.0; 3],
        std: [1.0; 3],
        white: 1.0,
        resize: Resize::Area,
        round: true,
        pad_with: PadWith::Edge,
    };

    fn seen(preprocessing: &Preprocessing, rgb: [u8; 6], count: usize, mirrored: bool) -> Vec<f32> {
        let image = Image::new(Pixels::Rgb(RgbImage::from_raw(2, 1, rgb.to_vec()).expect("two pixels")));
        let sizes = Sizes { width: Some(2), height: Some(1), multiple: 1, side: None };
        let fitted = Fitted::new((2, 1), sizes, Fit::Resize, PadAt::BottomRight).expect("it fits");
        preprocessing.planes(&image, count, &fitted, mirrored).expect("memory").concat()
    }

    const RGB: [u8; 6] = [255, 0, 51, 102, 153, 204];

    #[test]
    fn channels_come_in_either_order() {
        assert_eq!(seen(&PLAIN, RGB, 3, false), [1.0, 0.4, 0.0, 0.6, 0.2, 0.8]);
        let bgr = Preprocessing { channels: Channels::Bgr, ..PLAIN };
        assert_eq!(seen(&bgr, RGB, 3, false), [0.2, 0.8, 0.0, 0.6, 1.0, 0.4]);
    }

    #[test]
    fn mean_and_deviation_are_those_of_the_networks_channels_after_white() {
        let other = Preprocessing { channels: Channels::Bgr, mean: [0.2, 0.0, 1.0], std: [0.5, 2.0, 1.0], ..PLAIN };
        for (found, expected) in seen(&other, RGB, 3, false).iter().zip([0.0, 1.2, 0.0, 0.3, 0.0, -0.6]) {
            assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
        }
        assert_eq!(seen(&Preprocessing { white: 255.0, ..PLAIN }, RGB, 3, false)[0], 255.0);
    }

    #[test]
    fn the_mirror_image_keeps_its_colours() {
        let turned = [102, 153, 204, 255, 0, 51];
        assert_eq!(seen(&PLAIN, RGB, 3, true), seen(&PLAIN, turned, 3, false));
    }

    #[test]
    fn a_network_of_one_channel_sees_opencvs_grey() {
        assert_eq!(seen(&PLAIN, RGB, 1, false), [82.0 / 255.0, 144.0 / 255.0]);
    }
}
