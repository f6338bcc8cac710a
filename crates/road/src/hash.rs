//! Randomness without state: every number is a hash of what it belongs to, so that any pixel of any frame can be asked
//! for alone.

use depthloom_random::mix;

/// Mixes two coordinates under a seed into 32 well-spread bits (a multiply-xorshift finaliser).
pub(crate) fn hash2(seed: u32, x: i32, y: i32) -> u32 {
    let mut h = seed
        ^ x.cast_unsigned().wrapping_mul(0x9e37_79b1)
        ^ y.cast_unsigned().wrapping_mul(0x85eb_ca77).rotate_left(13);
    h = (h ^ (h >> 16)).wrapping_mul(0x21f0_aaad);
    h = (h ^ (h >> 15)).wrapping_mul(0x735a_2d97);
    h ^ (h >> 15)
}

/// The upper 24 bits as a number in [0, 1).
pub(crate) fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A short sequence of draws for one thing on the street: counter-based, keyed by the street's seed, what kind of
/// thing it is, and which one.
#[derive(Clone, Debug)]
pub(crate) struct Draws {
    key: u64,
    count: u64,
}

impl Draws {
    pub(crate) fn new(seed: u64, kind: u64, index: i64) -> Self {
        Self { key: mix(mix(mix(seed) ^ kind) ^ index.cast_unsigned()), count: 0 }
    }

    pub(crate) fn bits(&mut self) -> u32 {
        self.count += 1;
        (mix(self.key ^ self.count) >> 32) as u32
    }

    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * unit(self.bits())
    }

    pub(crate) fn chance(&mut self, share: f32) -> bool {
        unit(self.bits()) < share
    }

    pub(crate) fn pick<T: Copy>(&mut self, among: &[T]) -> T {
        among[self.bits() as usize % among.len()]
    }
}
