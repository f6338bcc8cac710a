//! Maps in colours, for looking at.

mod tables;

use depthloom_graphs::Value;
use image::{Rgb, RgbImage};

use super::floats::floats;
use super::png::encoded;

/// A colour map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colours {
    /// Blue over green to red: most distinguishable steps.
    Turbo,
    /// Violet over green to yellow: as bright as the number is large.
    Viridis,
    /// Black over red to pale yellow.
    Magma,
    /// Black to white.
    Grey,
}

impl Colours {
    /// The colour of a share in [0, 1] of the range: red, green, blue.
    pub(crate) fn rgb(self, share: f64) -> [u8; 3] {
        let step = (share * 255.0 + 0.5) as u8;
        let table = match self {
            Self::Turbo => &tables::TURBO,
            Self::Viridis => &tables::VIRIDIS,
            Self::Magma => &tables::MAGMA,
            Self::Grey => return [step; 3],
        };
        let [_, red, green, blue] = table[usize::from(step)].to_be_bytes();
        [red, green, blue]
    }
}

/// A map as an 8-bit RGB PNG: `range.0` has the first colour and `range.1` the last, whichever is larger; what is
/// beyond has the nearer of the two, and invalid pixels are black.
pub fn coloured_png(value: &Value, colours: Colours, range: (f64, f64)) -> Result<Vec<u8>, String> {
    let map = floats(value).ok_or_else(|| format!("a value of type {} is not a map of numbers", value.value_type()))?;
    let (from, to) = range;
    let colour = |column, row| {
        let sample = map[(column, row)].0[0];
        if sample.is_nan() {
            Rgb([0; 3])
        } else {
            Rgb(colours.rgb(((f64::from(sample) - from) / (to - from)).clamp(0.0, 1.0)))
        }
    };
    let image = RgbImage::from_fn(map.width(), map.height(), colour);
    encoded(|out| image.write_to(out, image::ImageFormat::Png))
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Value;
    use depthloom_graphs::values::{Depth, Raster};

    use super::{Colours, coloured_png};

    #[test]
    fn values_beyond_the_range_have_its_end_colour_and_invalid_pixels_are_black() {
        let metres = Raster::from_raw(5, 1, vec![f32::NAN, -3.0, 5.0, 10.0, f32::INFINITY]).unwrap();
        let depth = Value::from(Depth { metres });
        let pixels = |colours, range| {
            image::load_from_memory(&coloured_png(&depth, colours, range).unwrap()).unwrap().into_rgb8().into_raw()
        };
        let grey = |steps: [u8; 5]| steps.map(|step| [step; 3]).concat();
        assert_eq!(pixels(Colours::Grey, (0.0, 10.0)), grey([0, 0, 128, 255, 255]));
        assert_eq!(pixels(Colours::Grey, (10.0, 0.0)), grey([0, 255, 128, 0, 0]));
        let turbo = [[0, 0, 0], [0x30, 0x12, 0x3b], [0xa4, 0xfc, 0x3c], [0x7a, 0x04, 0x03], [0x7a, 0x04, 0x03]];
        assert_eq!(pixels(Colours::Turbo, (0.0, 10.0)), turbo.concat());
    }
}
