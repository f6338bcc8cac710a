//! What all kernels share: checks of sizes, borders, and an order of samples.

/// Demands that `len` samples are what `width` x `height` pixels of `channels` samples need.
#[track_caller]
pub(crate) fn check(what: &str, len: usize, width: usize, height: usize, channels: usize) {
    let wanted = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(channels));
    assert!(
        wanted == Some(len),
        "{what} has {len} samples, but {width} x {height} pixels of {channels} channel(s) were announced"
    );
}

#[track_caller]
pub(crate) fn check_same(what: &str, len: usize, wanted: usize) {
    assert!(len == wanted, "{what} has {len} samples where {wanted} are needed");
}

/// Border reflect-101 (`gfedcb|abcdefgh|gfedcba`): the index in `0..len` that `index` stands for.
///
/// OpenCV's `BORDER_REFLECT_101`, its default border; a single sample repeats.
#[inline(always)]
pub(crate) fn reflect101(index: isize, len: usize) -> usize {
    if len == 1 {
        return 0;
    }
    let last = len as isize - 1;
    let mut index = index;
    while index < 0 || index > last {
        index = if index < 0 { -index } else { 2 * last - index };
    }
    index as usize
}

/// Border replicate (`aaaaaa|abcdefgh|hhhhhhh`): the index in `0..len` that `index` stands for.
#[inline(always)]
pub(crate) fn replicate(index: isize, len: usize) -> usize {
    index.clamp(0, len as isize - 1) as usize
}

/// An integer that orders as the float does; its own inverse on the bits.
#[inline(always)]
pub(crate) fn key(bits: i32) -> i32 {
    bits ^ ((bits >> 31) as u32 >> 1) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflect101_mirrors_about_the_outermost_pixel_as_often_as_needed() {
        let seen: Vec<usize> = (-7..8).map(|i| reflect101(i, 3)).collect();
        assert_eq!(seen, [1, 2, 1, 0, 1, 2, 1, 0, 1, 2, 1, 0, 1, 2, 1]);
        assert_eq!(reflect101(-5, 1), 0);
    }

    #[test]
    fn replicate_repeats_the_outermost_pixel() {
        assert_eq!([replicate(-3, 4), replicate(2, 4), replicate(9, 4)], [0, 2, 3]);
    }

    #[test]
    fn keys_order_as_floats_do_and_back() {
        let ascending = [f32::NEG_INFINITY, -80.0, -1e-40, -0.0, 0.0, 1e-40, 1.0, 80.0, f32::INFINITY, f32::NAN];
        let keys = ascending.map(|sample| key(sample.to_bits() as i32));
        assert!(keys.is_sorted_by(|a, b| a < b));
        assert_eq!(keys.map(|k| key(k) as u32), ascending.map(f32::to_bits));
    }

    #[test]
    #[should_panic(expected = "grey has 5 samples")]
    fn a_raster_of_another_size_is_refused() {
        check("grey", 5, 2, 3, 1);
    }
}
