//! Random numbers that are the same everywhere and always.
//!
//! SplitMix64 (Steele, Lea, Flood 2014): a state of 64 bits, so that any step of a training begins its own sequence and
//! a resumed one needs no state from before; and its finaliser alone, a hash, so that each pixel of each frame has its
//! own number.
//!
//! ```
//! use depthloom_random::{SplitMix64, mix};
//!
//! assert_eq!(SplitMix64::new(7).next(), mix(7));
//! ```
#![forbid(unsafe_code)]

/// What the state grows by: 2^64 over the golden ratio.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Spreads 64 bits: the number that the generator gives from this state.
#[must_use]
pub const fn mix(state: u64) -> u64 {
    let mut z = state.wrapping_add(STEP);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A sequence of random numbers.
#[derive(Clone, Debug)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// The sequence of a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The sequence of `part`, an index, within that of a seed.
    #[must_use]
    pub const fn part(seed: u64, part: u64) -> Self {
        Self(mix(seed) ^ mix(part).rotate_left(32))
    }

    /// The next 64 bits.
    pub const fn next(&mut self) -> u64 {
        let bits = mix(self.0);
        self.0 = self.0.wrapping_add(STEP);
        bits
    }

    /// In [0, 1), 24 bits.
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1_u32 << 24) as f32
    }

    /// In [-1, 1).
    pub fn sign_unit(&mut self) -> f32 {
        self.unit() * 2.0 - 1.0
    }

    /// Below `end`, each equally likely to within 2^-32 (`end` is a count of samples).
    ///
    /// # Panics
    /// If `end` is 0.
    pub fn below(&mut self, end: usize) -> usize {
        assert!(end > 0, "nothing is below 0");
        (((self.next() >> 32) * end as u64) >> 32) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::SplitMix64;

    #[test]
    fn it_is_the_published_generator() {
        // Vigna's splitmix64.c with the state 1234567.
        let mut random = SplitMix64::new(1_234_567);
        assert_eq!(
            [random.next(), random.next(), random.next()],
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]
        );
    }

    #[test]
    fn below_reaches_every_number() {
        let mut random = SplitMix64::new(1);
        let mut seen = [0_u32; 7];
        (0..7000).for_each(|_| seen[random.below(7)] += 1);
        assert!(seen.iter().all(|&n| (800..1200).contains(&n)), "{seen:?}");
    }
}
