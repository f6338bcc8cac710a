//! Checks of numeric parameters.

use std::ops::RangeInclusive;

pub(crate) fn above_zero(name: &'static str, value: Option<f64>, unit: &str) -> Result<(), (&'static str, String)> {
    match value {
        Some(value) if value.is_nan() || value <= 0.0 => {
            Err((name, format!("{name} is {value} {unit}, which is not greater than 0")))
        }
        _ => Ok(()),
    }
}

/// `unit` follows the number: ` px`, or nothing.
pub(crate) fn within(
    name: &'static str,
    value: f64,
    unit: &str,
    range: RangeInclusive<f64>,
) -> Result<(), (&'static str, String)> {
    match range.contains(&value) {
        true => Ok(()),
        false => Err((name, format!("{name} is {value}{unit}, which is not in {}..={}", range.start(), range.end()))),
    }
}
