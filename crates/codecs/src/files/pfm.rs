//! Maps as portable float maps, as the Middlebury benchmark keeps its disparities.
//! <https://vision.middlebury.edu/stereo/code/>

use depthloom_graphs::Value;

use super::floats::floats;
use crate::encode::put_floats;

/// A map in its own unit; infinity = invalid, as in Middlebury's files. Rows are stored bottom to top, floats
/// little-endian.
pub fn pfm(value: &Value) -> Result<Vec<u8>, String> {
    let map = floats(value).ok_or_else(|| format!("a value of type {} is not a map of numbers", value.value_type()))?;
    let (width, height) = map.dimensions();
    let mut file = format!("Pf\n{width} {height}\n-1.0\n").into_bytes();
    file.reserve(4 * map.len());
    let known = |sample: &f32| if sample.is_nan() { f32::INFINITY } else { *sample };
    for row in map.as_raw().rchunks_exact(width.max(1) as usize) {
        put_floats(&mut file, &row.iter().map(known).collect::<Vec<f32>>());
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Value;
    use depthloom_graphs::values::{Depth, Raster};

    use super::pfm;

    #[test]
    fn the_lowest_row_is_first_and_infinity_is_invalid() {
        let metres = Raster::from_raw(2, 2, vec![1.0, f32::NAN, 3.0, 4.0]).unwrap();
        let floats = [3.0, 4.0, 1.0, f32::INFINITY].map(f32::to_le_bytes).concat();
        assert_eq!(pfm(&Value::from(Depth { metres })).unwrap(), [b"Pf\n2 2\n-1.0\n".as_slice(), &floats].concat());
    }
}
