//! An image as a network wants it: resized, normalised, in its order of axes and channels.

use depthloom_graphs::values::{Image, Pixels};
use depthloom_kernels::memory::{TooMuch, zeros};
use depthloom_kernels::resize::{area_rgb8, bicubic_f32, bilinear_f32};

use super::params::Resize;

/// The largest sample of 8 bits.
const WHITE: f32 = 255.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct InputSize {
    /// 1 (grey) or 3.
    pub channels: usize,
    pub width: usize,
    pub height: usize,
}

impl InputSize {
    fn pixels(self) -> usize {
        self.width * self.height
    }
}

/// Interleaved samples, 0 to 255.
pub(super) fn as_it_is(image: &Image, channels: usize) -> Vec<f32> {
    match channels {
        1 => crate::grey::grey(image).iter().map(|&value| f32::from(value)).collect(),
        _ => colour(image).iter().map(|&value| f32::from(value)).collect(),
    }
}

/// Interleaved samples at the network's size, 0 to 255.
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
        Resize::Bilinear | Resize::Bicubic => {
            let kernel = if resize == Resize::Bicubic { bicubic_f32 } else { bilinear_f32 };
            let mut rgb = zeros::<f32>(size.pixels() * 3)?;
            let mut plane = zeros::<f32>(size.pixels())?;
            for channel in 0..3 {
                let samples: Vec<f32> = interleaved.iter().skip(channel).step_by(3).map(|&v| f32::from(v)).collect();
                kernel(&samples, width, height, size.width, size.height, &mut plane);
                for (sample, &value) in rgb.iter_mut().skip(channel).step_by(3).zip(&plane) {
                    *sample = if round { value.round_ties_even().clamp(0.0, WHITE) } else { value };
                }
            }
            rgb
        }
    };
    Ok(if size.channels == 1 { rgb.into_iter().step_by(3).collect() } else { rgb })
}

pub(crate) fn colour(image: &Image) -> std::borrow::Cow<'_, [u8]> {
    match image.pixels() {
        Pixels::Rgb(rgb) => rgb.as_raw().into(),
        Pixels::Grey(grey) => grey.iter().flat_map(|&value| [value; 3]).collect::<Vec<u8>>().into(),
    }
}

fn grey_as_rgb(image: &Image) -> std::borrow::Cow<'_, [u8]> {
    crate::grey::grey(image).iter().flat_map(|&value| [value; 3]).collect::<Vec<u8>>().into()
}
