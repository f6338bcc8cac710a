//! Images and maps as NumPy arrays. <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>

use depthloom_graphs::Value;
use depthloom_graphs::values::Pixels;

use super::floats::floats;
use crate::encode::put_floats;

/// An array of an image or map, in NPY format 1.0, rows first.
pub fn npy(value: &Value) -> Result<Vec<u8>, String> {
    if let Some(map) = floats(value) {
        let mut file = header("<f4", map.dimensions(), "");
        put_floats(&mut file, &map);
        return Ok(file);
    }
    match value {
        Value::Image(image) => {
            let (channels, samples): (_, &[u8]) = match image.pixels() {
                Pixels::Grey(grey) => ("", grey),
                Pixels::Rgb(rgb) => (", 3", rgb),
            };
            Ok([header("|u1", image.dimensions(), channels).as_slice(), samples].concat())
        }
        Value::Mask(mask) => {
            let mut file = header("|b1", mask.set.dimensions(), "");
            file.extend(mask.set.iter().map(|set| u8::from(*set != 0)));
            Ok(file)
        }
        _ => Err(format!("a value of type {} is not an array of pixels", value.value_type())),
    }
}

/// The header, filled up with spaces so that the data begin at a multiple of 64.
fn header(sample: &str, (width, height): (u32, u32), channels: &str) -> Vec<u8> {
    const BEFORE: usize = 10;
    let mut text = format!("{{'descr': '{sample}', 'fortran_order': False, 'shape': ({height}, {width}{channels}), }}");
    let spaces = (BEFORE + text.len() + 1).next_multiple_of(64) - (BEFORE + text.len() + 1);
    text.extend(std::iter::repeat_n(' ', spaces));
    text.push('\n');
    let length = (text.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00".as_slice(), &length, text.as_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Value;
    use depthloom_graphs::values::{Disparity, Mask, Raster};

    use super::npy;

    #[test]
    fn the_data_begin_at_a_multiple_of_64() {
        let sixteenths_px = Raster::from_raw(3, 1, vec![-16, 0, 24]).unwrap();
        let file = npy(&Value::from(Disparity { sixteenths_px, min_disparity_px: 0 })).unwrap();
        assert_eq!(file.len(), 128 + 3 * 4);
        assert_eq!(file[..10], *b"\x93NUMPY\x01\x00\x76\x00");
        assert!(file[10..].starts_with(b"{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3), }  "));
        assert_eq!(file[127], b'\n');
        assert_eq!(file[128..132], f32::NAN.to_le_bytes());
        assert_eq!(file[132..], [0.0_f32.to_le_bytes(), 1.5_f32.to_le_bytes()].concat());
    }

    #[test]
    fn masks_are_booleans() {
        let file = npy(&Value::from(Mask { set: Raster::from_raw(1, 2, vec![255, 0]).unwrap() })).unwrap();
        assert!(file[10..].starts_with(b"{'descr': '|b1', 'fortran_order': False, 'shape': (2, 1), }"));
        assert_eq!(file[128..], [1, 0]);
    }
}
