//! Checks that the parameters of several matchers share, and their error.

use std::fmt;
use std::ops::RangeInclusive;

/// A parameter that is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParamError {
    /// The field of the matcher's parameters.
    pub name: &'static str,
    what: String,
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)
    }
}

impl std::error::Error for ParamError {}

impl ParamError {
    pub(crate) const fn new(name: &'static str, what: String) -> Self {
        Self { name, what }
    }
}

/// That disparities are a positive multiple of 16, and at most `most`; and that all of them fit 16 bits of 1/16 px,
/// with one more below for invalid pixels.
pub(crate) fn check_disparities(min_disparity: i32, disparities: i32, most: Option<i32>) -> Result<(), ParamError> {
    if disparities <= 0 || disparities % 16 != 0 || most.is_some_and(|most| disparities > most) {
        let form = most
            .map_or_else(|| "a positive multiple of 16".to_owned(), |most| format!("a multiple of 16 in 16..={most}"));
        return Err(ParamError::new("disparities", format!("disparities is {disparities}, which is not {form}")));
    }
    let end = min_disparity.saturating_add(disparities);
    if min_disparity < -2047 || end > 2047 {
        let what =
            format!("disparities {min_disparity}..{end} do not fit 16 bits of 1/16 px: they must be in -2047..=2047");
        return Err(ParamError::new("min_disparity", what));
    }
    Ok(())
}

/// The value of invalid pixels: one pixel below the smallest disparity, in 1/16 px.
pub(crate) const fn invalid_value(min_disparity: i32) -> i16 {
    ((min_disparity - 1) * 16) as i16
}

/// That the side of a window has a middle, and is not out of its range; one that ends with the type has no end.
pub(crate) fn check_side(name: &'static str, side: i32, range: &RangeInclusive<i32>) -> Result<(), ParamError> {
    if range.contains(&side) && side % 2 == 1 {
        return Ok(());
    }
    let within = match *range.end() {
        i32::MAX => format!("at least {}", range.start()),
        _ => format!("in {range:?}"),
    };
    Err(ParamError::new(name, format!("{name} is {side}, which is not odd and {within}")))
}

/// That a margin is a share of a hundred below all of it.
pub(crate) fn check_percentage(name: &'static str, value: i32) -> Result<(), ParamError> {
    let what = || format!("{name} is {value}, which is not a percentage in 0..=99");
    if (0..=99).contains(&value) { Ok(()) } else { Err(ParamError::new(name, what())) }
}

pub(crate) fn check_not_negative(name: &'static str, value: i32) -> Result<(), ParamError> {
    let what = || format!("{name} is {value}, which must not be negative");
    if value >= 0 { Ok(()) } else { Err(ParamError::new(name, what())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(result: Result<(), ParamError>) -> Option<(&'static str, String)> {
        result.err().map(|error| (error.name, error.to_string()))
    }

    #[test]
    fn disparities_are_multiples_of_16_that_fit_16_bits() {
        let not = |name, what: &str| Some((name, what.to_owned()));
        assert_eq!(refusal(check_disparities(0, 64, None)), None);
        assert_eq!(refusal(check_disparities(-2047, 4080, None)), None);
        assert_eq!(refusal(check_disparities(0, 256, Some(256))), None);
        for wrong in [0, 24, -16] {
            let what = format!("disparities is {wrong}, which is not a positive multiple of 16");
            assert_eq!(refusal(check_disparities(0, wrong, None)), not("disparities", &what));
        }
        for wrong in [0, 40, 272] {
            let what = format!("disparities is {wrong}, which is not a multiple of 16 in 16..=256");
            assert_eq!(refusal(check_disparities(0, wrong, Some(256))), not("disparities", &what));
        }
        for (low, high) in [(1984, 2048), (-2048, -1984), (i32::MAX, i32::MAX), (i32::MIN, i32::MIN + 64)] {
            let what = format!("disparities {low}..{high} do not fit 16 bits of 1/16 px: they must be in -2047..=2047");
            assert_eq!(refusal(check_disparities(low, 64, None)), not("min_disparity", &what));
        }
    }

    #[test]
    fn refusals_state_name_value_and_valid_values() {
        let not = |name, what: &str| Some((name, what.to_owned()));
        assert_eq!(refusal(check_side("block", 5, &(5..=255))), None);
        for wrong in [3, 8, 257] {
            let what = format!("block is {wrong}, which is not odd and in 5..=255");
            assert_eq!(refusal(check_side("block", wrong, &(5..=255))), not("block", &what));
        }
        for wrong in [4, 0, -1] {
            let what = format!("block is {wrong}, which is not odd and at least 1");
            assert_eq!(refusal(check_side("block", wrong, &(1..=i32::MAX))), not("block", &what));
        }
        assert_eq!(
            (refusal(check_percentage("uniqueness", 0)), refusal(check_percentage("uniqueness", 99))),
            (None, None)
        );
        for wrong in [-1, 100] {
            let what = format!("uniqueness is {wrong}, which is not a percentage in 0..=99");
            assert_eq!(refusal(check_percentage("uniqueness", wrong)), not("uniqueness", &what));
        }
        assert_eq!(refusal(check_not_negative("speckle_range", 0)), None);
        let what = "speckle_range is -1, which must not be negative";
        assert_eq!(refusal(check_not_negative("speckle_range", -1)), not("speckle_range", what));
    }
}
