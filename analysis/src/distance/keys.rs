//! A sample as one integer that sorts as the sample does.

/// `floor(t)` in the upper half, the bits of the error as f32 in the lower: floats that are not negative sort as their bits do.
///
/// f32 holds an error to 6e-8 of itself: 5 micrometres at 80 m.
#[inline]
pub(super) fn key(truth_m: f32, error_m: f64) -> u64 {
    (truth_m as u64) << 32 | u64::from((error_m as f32).to_bits())
}

/// The metre of a key.
#[inline]
pub(super) const fn bin_m(key: u64) -> u32 {
    (key >> 32) as u32
}

/// The error of a key, metres.
#[inline]
pub(super) const fn error_m(key: u64) -> f32 {
    f32::from_bits(key as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_hold_metre_and_error_and_sort_by_them() {
        let samples = [(3.99, 0.0), (4.0, 0.0), (4.5, 1e-6), (4.1, 0.25), (4.1, 79.0), (79.9, 0.5)];
        let keys = samples.map(|(t, e)| key(t, e));
        assert!(keys.is_sorted());
        assert_eq!(keys.map(bin_m), [3, 4, 4, 4, 4, 79]);
        assert_eq!(keys.map(error_m), samples.map(|(_, e)| e as f32));
    }
}
