//! Columns of samples as plain numbers.
//!
//! Polars stores one validity bit per number. Its iterators test bit by bit; this module processes the eight rows of a
//! byte at once.

use polars::frame::DataFrame;
use polars::prelude::{DataType, PolarsResult};

/// The numbers of a column; NaN for missing values.
pub(crate) fn numbers(table: &DataFrame, column: &str) -> PolarsResult<Vec<f32>> {
    let column = table.column(column)?;
    let cast = if column.dtype() == &DataType::Float32 { column.clone() } else { column.cast(&DataType::Float32)? };
    let mut all = Vec::with_capacity(column.len());
    for chunk in cast.f32()?.downcast_iter() {
        let values = chunk.values().as_slice();
        match chunk.validity() {
            None => all.extend_from_slice(values),
            Some(validity) => {
                let (bytes, offset, _) = validity.as_slice();
                extend(&mut all, values, bytes, offset);
            }
        }
    }
    Ok(all)
}

/// Appends numbers; number `i` is valid if bit `offset + i` is set, otherwise NaN.
fn extend(all: &mut Vec<f32>, values: &[f32], bytes: &[u8], offset: usize) {
    // A number with all bits set is NaN.
    let number = |value: f32, is_set: bool| f32::from_bits(value.to_bits() | u32::from(is_set).wrapping_sub(1));
    let bit = |at: usize| bytes[at / 8] & (1 << (at % 8)) != 0;
    let lead = ((8 - offset % 8) % 8).min(values.len());
    let (first, rest) = values.split_at(lead);
    all.extend(first.iter().enumerate().map(|(at, value)| number(*value, bit(offset + at))));
    let (eights, last) = rest.as_chunks::<8>();
    for (eight, byte) in eights.iter().zip(&bytes[(offset + lead) / 8..]) {
        all.extend_from_slice(&std::array::from_fn::<f32, 8, _>(|at| number(eight[at], byte & (1 << at) != 0)));
    }
    let done = offset + values.len() - last.len();
    all.extend(last.iter().enumerate().map(|(at, value)| number(*value, bit(done + at))));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validity_bits_are_read_at_any_offset() {
        let bytes: Vec<u8> = (0..9).map(|at: u32| (at * 37 + 11) as u8).collect();
        for offset in 0..20 {
            for count in 0..40 {
                let values: Vec<f32> = (0..count).map(|at| at as f32).collect();
                let mut all = vec![-1.0];
                extend(&mut all, &values, &bytes, offset);
                assert_eq!(all.len(), 1 + values.len());
                for (at, value) in all[1..].iter().enumerate() {
                    let is_set = bytes[(offset + at) / 8] >> ((offset + at) % 8) & 1 == 1;
                    assert!(if is_set { *value == at as f32 } else { value.is_nan() }, "{offset}, {count}, {at}");
                }
            }
        }
    }
}
