//! Bytes, times and ages as people read and write them.

use std::time::Duration;

/// Decimal units, as disks are sold and `ls --si` counts.
const UNITS: [(&str, u64); 4] = [("TB", 1_000_000_000_000), ("GB", 1_000_000_000), ("MB", 1_000_000), ("kB", 1000)];

/// `707 MB`, `1.2 GB`, `12 B`: two digits at least.
pub fn size(bytes: u64) -> String {
    // Up to the next unit by rounding: 999 960 kB are 1.0 GB.
    let unit = UNITS.iter().find(|(_, unit)| bytes >= unit - unit / 2000);
    let Some((name, unit)) = unit else { return format!("{bytes} B") };
    let value = bytes as f64 / *unit as f64;
    if value < 9.95 { format!("{value:.1} {name}") } else { format!("{value:.0} {name}") }
}

/// A size as people write one: `50GB`, `1.5 TB`, `200000`.
///
/// # Errors
/// What is expected, if it is not one.
pub fn parse_size(text: &str) -> Result<u64, String> {
    let units = UNITS.map(|(name, unit)| (name, unit as f64));
    let known = units.into_iter().chain([("B", 1.0), ("", 1.0)]);
    number_of(text, known).map(|bytes| bytes as u64).ok_or_else(|| "expected a size such as 50GB or 800MB".to_owned())
}

/// An age as people write one: `30d`, `12h`, `2w`, `90min`.
///
/// # Errors
/// What is expected, if it is not one.
pub fn parse_age(text: &str) -> Result<Duration, String> {
    let known = [("min", 60.0), ("h", 3600.0), ("d", 86_400.0), ("w", 604_800.0)];
    let seconds = number_of(text, known).and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    seconds.ok_or_else(|| "expected an age such as 30d, 12h, 2w or 90min".to_owned())
}

/// A time as people write one: `20s`, `500ms`, `10min`, `2h`.
///
/// # Errors
/// What is expected, if it is not one, or zero.
pub fn parse_duration(text: &str) -> Result<Duration, String> {
    let known = [("ms", 0.001), ("s", 1.0), ("min", 60.0), ("h", 3600.0)];
    let seconds = number_of(text, known).filter(|seconds| *seconds > 0.0);
    let duration = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    duration.ok_or_else(|| "expected a time such as 20s, 500ms, 10min or 2h".to_owned())
}

/// A number in one of these units, whose letters may be large or small.
fn number_of<'a>(text: &str, units: impl IntoIterator<Item = (&'a str, f64)>) -> Option<f64> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic() || c == ' ');
    let written = text[digits.len()..].trim();
    let (_, unit) = units.into_iter().find(|(name, _)| name.eq_ignore_ascii_case(written))?;
    let number: f64 = digits.parse().ok()?;
    (number.is_finite() && number >= 0.0).then_some(number * unit)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::{parse_age, parse_duration, parse_size, size};

    #[test]
    fn sizes_and_ages_have_units() {
        for (text, bytes) in [("50GB", 50_000_000_000), ("1.5 kb", 1500), ("12", 12), ("7 B", 7), ("0MB", 0)] {
            assert_eq!(parse_size(text), Ok(bytes), "{text}");
        }
        for wrong in ["", "GB", "5 parsecs", "-1GB", "infGB", "1e999", "5d"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_age("30d"), Ok(Duration::from_secs(30 * 86_400)));
        assert_eq!(parse_age("90 min"), Ok(Duration::from_secs(5400)));
        assert_eq!(parse_duration("500 ms"), Ok(Duration::from_millis(500)));
        assert_eq!(parse_duration("1.5min"), Ok(Duration::from_secs(90)));
        for wrong in ["", "20", "0s", "-1s", "1d", "infs"] {
            assert!(parse_duration(wrong).is_err(), "{wrong}");
        }
        for wrong in ["", "30", "d", "-1d", "1e300w", "nand"] {
            assert!(parse_age(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_have_two_digits_or_three() {
        let sizes = [0, 999, 1000, 9_949, 9_950, 707_461_516, 999_400_000, 999_500_000, 12_345_678_901_234];
        let texts = ["0 B", "999 B", "1.0 kB", "9.9 kB", "10 kB", "707 MB", "999 MB", "1.0 GB", "12 TB"];
        assert_eq!(sizes.map(size), texts);
    }
}
