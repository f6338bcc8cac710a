//! Floats as the differences of their bits, by class.
//!
//! The bits of each sample, taken as a number, less those of the sample before it (of the first: less zero), modulo 2^32 and with the sign brought into
//! the lowest bit (`d << 1 ^ d >> 31`), are of one of four classes:
//!
//! | class | difference | kept of it |
//! |---|---|---|
//! | 0 | 0 | nothing |
//! | 1 | below 2^16 | its low 16 bits in `lows` |
//! | 2 | below 2^20 | these, and four bits more in `middles` |
//! | 3 | any other | these, and its high 16 bits in `highs` |

use crate::simd::{Level, Pass};

/// Samples are taken in blocks, whose counts stay in registers and whose buffers in the nearest cache.
pub(crate) const BLOCK: usize = 64;
/// And blocks in stretches of so many samples.
const STRETCH: usize = 64 * BLOCK;
/// The lowest of what the high 16 bits of a difference are in class 3.
const HIGH: u16 = 16;

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
    pub fn of(samples: &[f32]) -> Self {
        Self::of_at(Level::best(), samples)
    }

    pub(crate) fn of_at(level: Level, samples: &[f32]) -> Self {
        let count = samples.len();
        let mut parts = Self {
            classes: Vec::with_capacity(count.next_multiple_of(BLOCK) / 4),
            lows: Vec::with_capacity(2 * count + 2),
            ..Self::default()
        };
        let mut middles = Vec::new();
        // Whole blocks are written, and move on by what is kept of them: in a stretch that stays in the nearest cache.
        let mut room = Room {
            classes: vec![0; STRETCH / 4],
            middles: vec![0; STRETCH + BLOCK],
            lows: vec![0; 2 * (STRETCH + BLOCK)],
            highs: vec![0; 2 * (STRETCH + BLOCK)],
            kept: Kept::default(),
        };
        let (blocks, rest) = samples.as_chunks::<BLOCK>();
        // Behind the end stands the last sample again and again: differences of zero, of which nothing is kept.
        let mut last = [rest.last().copied().unwrap_or_default(); BLOCK];
        last[..rest.len()].copy_from_slice(rest);
        let last = if rest.is_empty() { &[][..] } else { &[last] };
        for stretch in blocks.chunks(STRETCH / BLOCK).chain([last]) {
            room.kept = Kept { last: room.kept.last, ..Kept::default() };
            level.differences_of(stretch, &mut room);
            let Room { classes, middles: of_stretch, lows, highs, kept } = &room;
            parts.classes.extend_from_slice(&classes[..kept.blocks * BLOCK / 4]);
            middles.extend_from_slice(&of_stretch[..kept.middles]);
            parts.lows.extend_from_slice(&lows[..2 * kept.lows]);
            parts.highs.extend_from_slice(&highs[..2 * kept.highs]);
        }
        parts.classes.truncate(count.div_ceil(4));
        parts.middles = level.run(Halved(&middles));
        parts
    }

    /// Puts so many samples together again; `None` if the parts are not those of as many.
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
            kept: Kept::default(),
        };
        let mut samples = vec![0.0; count.next_multiple_of(BLOCK)];
        level.samples_of(&mut room, samples.as_chunks_mut::<BLOCK>().0)?;
        samples.truncate(count);
        let Kept { lows, middles: middle_count, highs, .. } = room.kept;
        ((lows, middle_count.div_ceil(2), highs) == (low_count, middles.len(), high_count)).then_some(samples)
    }
}

/// The parts of whole blocks, with room for one more behind them.
pub(crate) struct Room {
    pub(crate) classes: Vec<u8>,
    /// One a byte.
    pub(crate) middles: Vec<u8>,
    pub(crate) lows: Vec<u8>,
    pub(crate) highs: Vec<u8>,
    pub(crate) kept: Kept,
}

/// How far the blocks have come.
#[derive(Clone, Copy, Default)]
pub(crate) struct Kept {
    pub(crate) blocks: usize,
    pub(crate) middles: usize,
    pub(crate) lows: usize,
    pub(crate) highs: usize,
    /// The bits of the last sample.
    pub(crate) last: u32,
}

/// Blocks of samples into their parts, in plain Rust.
pub(crate) struct Apart<'a>(pub(crate) &'a [[f32; BLOCK]], pub(crate) &'a mut Room);

impl Pass for Apart<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(blocks, Room { classes, middles, lows, highs, kept }) = self;
        for block in blocks {
            let differences = differences(block, &mut kept.last);
            let (mut low, mut middle, mut high) = ([0_u16; BLOCK], [0_u8; BLOCK], [0_u16; BLOCK]);
            let (mut low_count, mut middle_count, mut high_count) = (0, 0, 0);
            let into = &mut classes.as_chunks_mut::<{ BLOCK / 4 }>().0[kept.blocks];
            for (classes, four) in into.iter_mut().zip(differences.as_chunks::<4>().0) {
                *classes = 0;
                for (place, &difference) in four.iter().enumerate() {
                    // Without a branch, since none could be foreseen: each is written where the next is to stand, which moves on if it is kept.
                    let above = (difference >> 16) as u16;
                    let (is_some, is_long, is_high) =
                        (u8::from(difference != 0), u8::from(above != 0), u8::from(above >= HIGH));
                    low[low_count % BLOCK] = difference as u16;
                    low_count += usize::from(is_some);
                    middle[middle_count % BLOCK] = above as u8;
                    middle_count += usize::from(is_long - is_high);
                    high[high_count % BLOCK] = above;
                    high_count += usize::from(is_high);
                    *classes |= (is_some + is_long + is_high) << (2 * place);
                }
            }
            middles[kept.middles..kept.middles + BLOCK].copy_from_slice(&middle);
            put(&mut lows[2 * kept.lows..], &low);
            put(&mut highs[2 * kept.highs..], &high);
            kept.blocks += 1;
            kept.middles += middle_count;
            kept.lows += low_count;
            kept.highs += high_count;
        }
    }
}

/// The differences of a block's bits from the sample before each.
#[inline(always)]
fn differences(block: &[f32; BLOCK], last: &mut u32) -> [u32; BLOCK] {
    let mut before = [*last; BLOCK];
    for (before, sample) in before[1..].iter_mut().zip(block) {
        *before = sample.to_bits();
    }
    *last = block[BLOCK - 1].to_bits();
    let mut differences = [0; BLOCK];
    for ((difference, sample), before) in differences.iter_mut().zip(block).zip(before) {
        let of_bits = sample.to_bits().wrapping_sub(before);
        *difference = of_bits << 1 ^ ((of_bits as i32) >> 31) as u32;
    }
    differences
}

#[inline(always)]
fn put(into: &mut [u8], numbers: &[u16; BLOCK]) {
    for (pair, number) in into.as_chunks_mut::<2>().0.iter_mut().zip(numbers) {
        *pair = number.to_le_bytes();
    }
}

/// The parts of blocks into their samples, in plain Rust; `None` if the parts end before.
pub(crate) struct Together<'a>(pub(crate) &'a mut Room, pub(crate) &'a mut [[f32; BLOCK]]);

impl Pass for Together<'_> {
    type Output = Option<()>;

    #[inline(always)]
    fn run(self) -> Option<()> {
        let Self(Room { classes, middles, lows, highs, kept }, blocks) = self;
        for (block, classes) in blocks.iter_mut().zip(classes.as_chunks::<{ BLOCK / 4 }>().0) {
            let low: &[[u8; 2]; BLOCK] = lows.as_chunks().0.get(kept.lows..)?.first_chunk()?;
            let middle: &[u8; BLOCK] = middles.get(kept.middles..)?.first_chunk()?;
            let high: &[[u8; 2]; BLOCK] = highs.as_chunks().0.get(kept.highs..)?.first_chunk()?;
            let (mut low_count, mut middle_count, mut high_count) = (0, 0, 0);
            let mut differences = [0; BLOCK];
            for (four, classes) in differences.as_chunks_mut::<4>().0.iter_mut().zip(classes) {
                for (place, difference) in four.iter_mut().enumerate() {
                    // Without a branch, as they were taken apart.
                    let class = classes >> (2 * place) & 3;
                    let kept = |is_kept: bool, number: u32| number & u32::from(is_kept).wrapping_neg();
                    let word = |pair: [u8; 2]| u32::from(u16::from_le_bytes(pair));
                    let low = kept(class != 0, word(low[low_count % BLOCK]));
                    low_count += usize::from(class != 0);
                    let middle = kept(class == 2, u32::from(middle[middle_count % BLOCK]));
                    middle_count += usize::from(class == 2);
                    let high = kept(class == 3, word(high[high_count % BLOCK]));
                    high_count += usize::from(class == 3);
                    *difference = (middle | high) << 16 | low;
                }
            }
            for difference in &mut differences {
                *difference = *difference >> 1 ^ (*difference & 1).wrapping_neg();
            }
            for (sample, difference) in block.iter_mut().zip(differences) {
                kept.last = difference.wrapping_add(kept.last);
                *sample = f32::from_bits(kept.last);
            }
            kept.middles += middle_count;
            kept.lows += low_count;
            kept.highs += high_count;
        }
        Some(())
    }
}

/// Numbers of four bits, two a byte.
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

/// The lower and the upper half of each byte, and a block's room behind them.
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

/// The bytes, and a block's room behind them.
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

    /// Numbers without a pattern.
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
    fn the_parts_are_those_the_table_says() {
        // 1.0 is 0x3f80_0000, of which the first difference is twice that; then +0, +1, -1, +0x8000, +0x8_0000.
        let bits = [0x3f80_0000_u32, 0x3f80_0000, 0x3f80_0001, 0x3f80_0000, 0x3f80_8000, 0x3f88_8000];
        let parts = Parts::of(&bits.map(f32::from_bits));
        assert_eq!(parts.classes, [0b01_01_00_11, 0b11_10]);
        assert_eq!(parts.lows, [0, 0, 2, 0, 1, 0, 0, 0, 0, 0]);
        assert_eq!(parts.middles, [1]);
        assert_eq!(parts.highs, [0, 0x7f, 0x10, 0]);
    }

    #[test]
    fn parts_of_more_or_fewer_samples_are_refused_at_every_level() {
        let samples = samples(1000);
        let Parts { classes, middles, lows, highs } = Parts::of(&samples);
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
