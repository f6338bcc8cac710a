//! What the benchmarks of all matchers have in common: KITTI's size and images of random texture, for the work does not
//! depend on what they show.

pub(crate) const WIDTH: usize = 1242;
pub(crate) const HEIGHT: usize = 375;

/// A left image, and a right one that shows it shifted.
pub(crate) fn texture() -> (Vec<u8>, Vec<u8>) {
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let left: Vec<u8> = std::iter::repeat_with(|| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 56) as u8
    })
    .take(WIDTH * HEIGHT)
    .collect();
    let right = (0..left.len()).map(|i| left[(i + 20) % left.len()]).collect();
    (left, right)
}
