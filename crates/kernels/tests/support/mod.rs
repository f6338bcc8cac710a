//! What the tests of all matchers' paths need.

use depthloom_kernels::tiles::Tiles;

/// Tiles in reverse order: what depends on order shows.
pub(crate) struct Backwards;

impl Tiles for Backwards {
    fn run(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).rev().for_each(f);
    }

    fn width(&self) -> usize {
        3
    }
}

/// The right image is the left one, shifted and disturbed: costs have a clear minimum at some places and none at
/// others.
pub(crate) fn images(len: usize, shift: usize, grain: u32, seed: u64) -> (Vec<u8>, Vec<u8>) {
    let mut state = seed | 1;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state >> 32
    };
    let left: Vec<u8> = (0..len).map(|_| (random() as u8) >> grain << grain).collect();
    let right = (0..len).map(|i| if random() % 8 == 0 { random() as u8 } else { left[(i + shift) % len] }).collect();
    (left, right)
}
