//! Floats as the differences of their bits, by class.
//!
//! The bits of each sample, taken as a number, less those of the sample before it (of the first: less zero), modulo
//! 2^32 and with the sign brought into the lowest bit (`d << 1 ^ d >> 31`), are of one of four classes:
//!
//! | class | difference | stored bytes |
//! |---|---|---|
//! | 0 | 0 | nothing |
//! | 1 | below 2^16 | its low 16 bits in `lows` |
//! | 2 | below 2^20 | these, and four bits more in `middles` |
//! | 3 | any other | these, and its high 16 bits in `highs` |

use crate::simd::differences_plain::{BLOCK, Progress, Room};
use crate::simd::{Level, Pass, differences_of, samples_of};

/// Samples that are worked on at a time.
const STRETCH: usize = 64 * BLOCK;

/// Samples, taken apart.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    /// Two bits a sample, four samples a byte, the first lowest.
    pub classes: Vec<u8>,
    /// Four bits each, two a byte, the first lower.
    pub middles: Vec<u8>,
    /// Little-endian numbers of 16 bits.
    pub lows: Vec<u8>,
    /// Little-endian numbers of 16 bits.
    pub highs: Vec<u8>,
}

impl Parts {
    /// Takes samples apart; any bits, of NaN too.
    #[must_use]
    pub fn split(samples: &[f32]) -> Self {
        Self::of_at(Level::best(), samples)
    }

    pub(crate) fn of_at(level: Level, samples: &[f32]) -> Self {
        let count = samples.len();
        let mut parts = Self {
            classes: Vec::with_capacity(count.next_multiple_of(BLOCK) / 4),
            lows: Vec::with_capacity(2 * count + 2),
            highs: Vec::with_capacity(2 * count),
            ..Self::default()
        };
        let mut middles = Vec::with_capacity(count);
        // Whole blocks are written, and the output advances by the bytes that count: a stretch stays in the nearest
        // cache.
        let mut room = Room {
            classes: vec![0; STRETCH / 4],
            middles: vec![0; STRETCH + BLOCK],
            lows: vec![0; 2 * (STRETCH + BLOCK)],
            highs: vec![0; 2 * (STRETCH + BLOCK)],
            progress: Progress::default(),
        };
        let (blocks, rest) = samples.as_chunks::<BLOCK>();
        // After the end, the last sample is repeated: differences of zero, which store nothing.
        let mut last = [rest.last().copied().unwrap_or_default(); BLOCK];
        last[..rest.len()].copy_from_slice(rest);
        let last = if rest.is_empty() { &[][..] } else { &[last] };
        for stretch in blocks.chunks(STRETCH / BLOCK).chain([last]) {
            room.progress = Progress { last: room.progress.last, ..Progress::default() };
            differences_of(level, stretch, &mut room);
            let Room { classes, middles: of_stretch, lows, highs, progress } = &room;
            parts.classes.extend_from_slice(&classes[..progress.blocks * BLOCK / 4]);
            middles.extend_from_slice(&of_stretch[..progress.middles]);
            parts.lows.extend_from_slice(&lows[..2 * progress.lows]);
            parts.highs.extend_from_slice(&highs[..2 * progress.highs]);
        }
        parts.classes.truncate(count.div_ceil(4));
        parts.middles = level.run(Halved(&middles));
        parts
    }

    /// The `count` samples of these parts; `None` if the parts are of another count.
    #[must_use]
    pub fn joined(count: usize, classes: &[u8], middles: &[u8], lows: &[u8], highs: &[u8]) -> Option<Vec<f32>> {
        Self::joined_at(Level::best(), count, classes, middles, lows, highs)
    }

    pub(crate) fn joined_at(
        level: Level,
        count: usize,
        classes: &[u8],
        middles: &[u8],
        lows: &[u8],
        highs: &[u8],
    ) -> Option<Vec<f32>> {
        if classes.len() != count.div_ceil(4) {
            return None;
        }
        let (low_count, high_count) = (exact_half(lows.len())?, exact_half(highs.len())?);
        let mut padded_classes = classes.to_vec();
        padded_classes.resize(count.next_multiple_of(BLOCK) / 4, 0);
        let mut room = Room {
            classes: padded_classes,
            middles: level.run(Doubled(middles)),
            lows: padded(lows),
            highs: padded(highs),
            progress: Progress::default(),
        };
        let mut samples = vec![0.0; count.next_multiple_of(BLOCK)];
        samples_of(level, &mut room, samples.as_chunks_mut::<BLOCK>().0)?;
        samples.truncate(count);
        let Progress { lows, middles: middle_count, highs, .. } = room.progress;
        ((lows, middle_count.div_ceil(2), highs) == (low_count, middles.len(), high_count)).then_some(samples)
    }
}

struct Halved<'a>(&'a [u8]);

impl Pass for Halved<'_> {
    type Output = Vec<u8>;

    #[inline(always)]
    fn run(self) -> Vec<u8> {
        let (pairs, last) = self.0.as_chunks::<2>();
        let mut bytes = vec![0; self.0.len().div_ceil(2)];
        for (byte, [first, second]) in bytes.iter_mut().zip(pairs) {
            *byte = first | second << 4;
        }
        if let ([last], Some(byte)) = (last, bytes.last_mut()) {
            *byte = *last;
        }
        bytes
    }
}

struct Doubled<'a>(&'a [u8]);

impl Pass for Doubled<'_> {
    type Output = Vec<u8>;

    #[inline(always)]
    fn run(self) -> Vec<u8> {
        let mut halves = vec![0; 2 * self.0.len() + BLOCK];
        for (pair, byte) in halves.as_chunks_mut::<2>().0.iter_mut().zip(self.0) {
            *pair = [byte & 15, byte >> 4];
        }
        halves
    }
}

fn padded(bytes: &[u8]) -> Vec<u8> {
    let mut padded = Vec::with_capacity(bytes.len() + 2 * BLOCK);
    padded.extend_from_slice(bytes);
    padded.resize(bytes.len() + 2 * BLOCK, 0);
    padded
}

fn exact_half(length: usize) -> Option<usize> {
    length.is_multiple_of(2).then_some(length / 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;

    fn random() -> impl FnMut() -> u64 {
        let mut state = 7_u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state ^ state >> 29
        }
    }

    /// All sizes of differences, each also at the bounds of its class.
    fn samples(count: usize) -> Vec<f32> {
        let (mut random, mut last) = (random(), 0_u32);
        (0..count)
            .map(|at| {
                let number = random();
                let difference = match number % 5 {
                    _ if at / 300 % 3 == 1 => 0,
                    0 => 0,
                    1 => [0x7fff, 0x8000, 0x7_ffff, 0x8_0000, 0xffff_8000, 0xffff_7fff, 0xfff8_0000, 0xfff7_ffff]
                        [(number >> 8) as usize % 8],
                    _ => ((number >> 32) as i32 >> ((number >> 8) % 32)) as u32,
                };
                last = last.wrapping_add(difference);
                f32::from_bits(last)
            })
            .collect()
    }

    #[test]
    fn every_level_takes_apart_and_puts_together_alike_at_every_length() {
        for count in (0..200).chain([4096, 10_001]) {
            let samples = samples(count);
            let parts = every_level(|level| Parts::of_at(level, &samples));
            let Parts { classes, middles, lows, highs } = &parts;
            let joined = every_level(|level| {
                let joined = Parts::joined_at(level, count, classes, middles, lows, highs);
                joined.unwrap().iter().map(|sample| sample.to_bits()).collect::<Vec<u32>>()
            });
            assert!(joined.iter().copied().eq(samples.iter().map(|sample| sample.to_bits())), "{count}");
        }
    }

    #[test]
    fn classes_match_the_table() {
        // 1.0 is 0x3f80_0000, of which the first difference is twice that; then +0, +1, -1, +0x8000, +0x8_0000.
        let bits = [0x3f80_0000_u32, 0x3f80_0000, 0x3f80_0001, 0x3f80_0000, 0x3f80_8000, 0x3f88_8000];
        let parts = Parts::split(&bits.map(f32::from_bits));
        assert_eq!(parts.classes, [0b01_01_00_11, 0b11_10]);
        assert_eq!(parts.lows, [0, 0, 2, 0, 1, 0, 0, 0, 0, 0]);
        assert_eq!(parts.middles, [1]);
        assert_eq!(parts.highs, [0, 0x7f, 0x10, 0]);
    }

    #[test]
    fn parts_of_more_or_fewer_samples_are_refused_at_every_level() {
        let samples = samples(1000);
        let Parts { classes, middles, lows, highs } = Parts::split(&samples);
        let refused = |count: usize, classes: &[u8], middles: &[u8], lows: &[u8], highs: &[u8]| {
            let joined = every_level(|level| Parts::joined_at(level, count, classes, middles, lows, highs).is_some());
            assert!(!joined);
        };
        let longer = |bytes: &[u8]| [bytes, &[0, 0]].concat();
        refused(1000, &classes, &middles, &lows[2..], &highs);
        refused(1000, &classes, &middles, &lows[1..], &highs);
        refused(1000, &classes, &middles, &[], &highs);
        refused(1000, &classes, &middles, &longer(&lows), &highs);
        refused(1000, &classes, &middles, &lows, &highs[2..]);
        refused(1000, &classes, &middles, &lows, &longer(&highs));
        refused(1000, &classes, &middles[1..], &lows, &highs);
        refused(1000, &classes, &longer(&middles), &lows, &highs);
        refused(1004, &classes, &middles, &lows, &highs);
        refused(1001, &classes[1..], &middles, &lows, &highs);
        refused(996, &classes, &middles, &lows, &highs);
    }
}
