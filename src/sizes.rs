//! Bytes as people read and write them.

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

#[cfg(test)]
mod tests {
    use super::size;

    #[test]
    fn sizes_have_two_digits_or_three() {
        let sizes = [0, 999, 1000, 9_949, 9_950, 707_461_516, 999_400_000, 999_500_000, 12_345_678_901_234];
        let told = ["0 B", "999 B", "1.0 kB", "9.9 kB", "10 kB", "707 MB", "999 MB", "1.0 GB", "12 TB"];
        assert_eq!(sizes.map(size), told);
    }
}
