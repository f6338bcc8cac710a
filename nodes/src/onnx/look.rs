//! How a network wants to see an image: channels, normalisation, size.

use depthloom_graphs::values::Image;
use depthloom_kernels::memory::TooMuch;

use super::fit::{Fitted, PadWith};
use super::input::{self, InputSize};
use super::params::{Channels, Resize};

/// How images become planes of a tensor.
#[derive(Clone, Debug)]
pub struct Look {
    /// The order of three channels.
    pub channels: Channels,
    /// Subtracted from each channel, in the network's order of channels.
    pub mean: [f64; 3],
    /// Each channel is then divided by this.
    pub std: [f64; 3],
    /// What white is before that: 1 or 255.
    pub white: f64,
    /// How images are resized, where they are.
    pub resize: Resize,
    /// Whether the resized image is rounded to 8 bits.
    pub round: bool,
    /// What is added around images, where something is.
    pub pad_with: PadWith,
}

impl Look {
    /// The planes of an image, one or three, in the network's order of channels, each of the network's size; of the mirror image, if asked.
    ///
    /// # Errors
    /// If there is not the memory for it.
    pub fn planes(
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
