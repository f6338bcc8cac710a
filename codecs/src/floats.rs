//! Maps of floats in fewer bytes, bit for bit.
//!
//! `depthloom.FloatMap` holds its samples row by row, either as they are (`data`) or as the differences of their bits: neighbours are often equal, and more often
//! alike in sign, exponent and first digits, while the last two bytes of a computed number are noise that nothing makes smaller. The bits of each
//! sample, taken as a number, less those of the sample before it (of the first: less zero), modulo 2^32 and with the sign brought into the lowest
//! bit (`d << 1 ^ d >> 31`), are of one of four classes:
//!
//! | class | difference | kept of it |
//! |---|---|---|
//! | 0 | 0 | nothing |
//! | 1 | below 2^16 | its low 16 bits in `lows` |
//! | 2 | below 2^20 | these, and four bits more in `codes` |
//! | 3 | any other | these, and its high 16 bits in `highs` |
//!
//! `codes` is a zstd frame of the classes, two bits each, four a byte, the first lowest; and behind them the four bits of all samples of class 2, two a
//! byte, the first lower. `lows` and `highs` are little-endian.

use std::io;

use crate::compression;

/// The samples of a map in fewer bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackedFloats {
    /// Classes and middle bits, compressed.
    pub codes: Vec<u8>,
    /// The low 16 bits.
    pub lows: Vec<u8>,
    /// The high 16 bits.
    pub highs: Vec<u8>,
}

/// Samples are packed in blocks, whose counts stay in registers and whose buffers in the nearest cache.
const BLOCK: usize = 64;
/// The lowest of what the high 16 bits of a difference are in class 3.
const HIGH: u16 = 16;

impl PackedFloats {
    /// Packs samples.
    ///
    /// # Errors
    /// If zstd fails, which it does only without memory.
    pub fn of(samples: &[f32]) -> io::Result<Self> {
        let mut codes = Vec::with_capacity(samples.len());
        let mut middles = Vec::with_capacity(samples.len() / 2);
        let mut lows = Vec::with_capacity(2 * samples.len() + 2 * BLOCK);
        let mut highs = Vec::new();
        let mut last = 0;
        let (blocks, rest) = samples.as_chunks::<BLOCK>();
        for block in blocks {
            pack(&differences(block, &mut last), &mut codes, &mut middles, &mut lows, &mut highs);
        }
        if !rest.is_empty() {
            let mut block = [rest[rest.len() - 1]; BLOCK];
            block[..rest.len()].copy_from_slice(rest);
            pack(&differences(&block, &mut last), &mut codes, &mut middles, &mut lows, &mut highs);
            codes.truncate(samples.len().div_ceil(4));
        }
        codes.extend(middles.chunks(2).map(|pair| pair[0] | pair.get(1).map_or(0, |second| second << 4)));
        let mut compressed = Vec::with_capacity(compression::bound(codes.len()));
        compression::compress(&codes, &mut compressed)?;
        Ok(Self { codes: compressed, lows, highs })
    }
}

/// The differences of a block's bits from the sample before each.
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

/// Appends what is kept of a block's differences.
fn pack(
    differences: &[u32; BLOCK],
    codes: &mut Vec<u8>,
    middles: &mut Vec<u8>,
    lows: &mut Vec<u8>,
    highs: &mut Vec<u8>,
) {
    let (mut low, mut middle, mut high) = ([0_u16; BLOCK], [0_u8; BLOCK], [0_u16; BLOCK]);
    let (mut low_count, mut middle_count, mut high_count) = (0, 0, 0);
    let mut classes = [0; BLOCK / 4];
    for (classes, four) in classes.iter_mut().zip(differences.as_chunks::<4>().0) {
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
    codes.extend_from_slice(&classes);
    middles.extend_from_slice(&middle[..middle_count]);
    lows.extend_from_slice(&bytes(&low)[..2 * low_count]);
    highs.extend_from_slice(&bytes(&high)[..2 * high_count]);
}

fn bytes(numbers: &[u16; BLOCK]) -> [u8; 2 * BLOCK] {
    let mut bytes = [0; 2 * BLOCK];
    for (pair, number) in bytes.as_chunks_mut::<2>().0.iter_mut().zip(numbers) {
        *pair = number.to_le_bytes();
    }
    bytes
}

/// The samples of a map that was packed.
///
/// # Errors
/// If these are no `count` samples, in words.
pub fn unpacked(count: usize, codes: &[u8], lows: &[u8], highs: &[u8]) -> Result<Vec<f32>, String> {
    let malformed = || "a map's samples are not as many as it says".to_owned();
    let class_bytes = count.div_ceil(4);
    let mut all = Vec::new();
    // The most that so many samples can have: whatever the frame says of itself, no more is taken up.
    let most = class_bytes + count.div_ceil(2);
    all.try_reserve_exact(most).map_err(|_| format!("there is no memory for a map of {count} samples"))?;
    compression::decompress(codes, &mut all).map_err(|error| format!("a map cannot be decompressed: {error}"))?;
    let (classes, middles) = all.split_at_checked(class_bytes).ok_or_else(malformed)?;
    let mut samples = Vec::new();
    // The last block may go beyond the end.
    samples.try_reserve_exact(count + BLOCK).map_err(|_| format!("there is no memory for a map of {count} samples"))?;
    let (low_count, middle_bytes, high_count) = (lows.len() / 2, middles.len(), highs.len() / 2);
    let is_even = lows.len().is_multiple_of(2) && highs.len().is_multiple_of(2);
    let (lows, middles, highs) = (padded(lows), halves(middles), padded(highs));
    let (mut low_at, mut middle_at, mut high_at) = (0, 0, 0);
    let mut last = 0;
    for classes in classes.chunks(BLOCK / 4) {
        let low = window(&lows, low_at).ok_or_else(malformed)?;
        let middle = window(&middles, middle_at).ok_or_else(malformed)?;
        let high = window(&highs, high_at).ok_or_else(malformed)?;
        let (mut low_count, mut middle_count, mut high_count) = (0, 0, 0);
        let mut bits = [0; BLOCK];
        for (four, classes) in bits.as_chunks_mut::<4>().0.iter_mut().zip(classes) {
            for (place, bits) in four.iter_mut().enumerate() {
                // Without a branch, as they were packed.
                let class = classes >> (2 * place) & 3;
                let kept = |is_kept: bool, number: u32| number & u32::from(is_kept).wrapping_neg();
                let low = kept(class != 0, u32::from(low[low_count % BLOCK]));
                low_count += usize::from(class != 0);
                let middle = kept(class == 2, u32::from(middle[middle_count % BLOCK]));
                middle_count += usize::from(class == 2);
                let high = kept(class == 3, u32::from(high[high_count % BLOCK]));
                high_count += usize::from(class == 3);
                *bits = (middle | high) << 16 | low;
            }
        }
        for difference in &mut bits {
            *difference = *difference >> 1 ^ (*difference & 1).wrapping_neg();
        }
        samples.extend(bits.map(|difference| {
            last = difference.wrapping_add(last);
            f32::from_bits(last)
        }));
        (low_at, middle_at, high_at) = (low_at + low_count, middle_at + middle_count, high_at + high_count);
    }
    samples.truncate(count);
    let is_whole = is_even && (low_at, middle_at.div_ceil(2), high_at) == (low_count, middle_bytes, high_count);
    is_whole.then_some(samples).ok_or_else(malformed)
}

/// Little-endian numbers, and a block's room behind them.
fn padded(bytes: &[u8]) -> Vec<u16> {
    let mut numbers = Vec::with_capacity(bytes.len() / 2 + BLOCK);
    numbers.extend(bytes.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair)));
    numbers.resize(numbers.len() + BLOCK, 0);
    numbers
}

/// The lower and the upper half of each byte, and a block's room behind them.
fn halves(bytes: &[u8]) -> Vec<u8> {
    let mut halves = vec![0; 2 * bytes.len() + BLOCK];
    for (pair, byte) in halves.as_chunks_mut::<2>().0.iter_mut().zip(bytes) {
        *pair = [byte & 15, byte >> 4];
    }
    halves
}

/// As many numbers as a block may take.
fn window<T>(numbers: &[T], at: usize) -> Option<&[T; BLOCK]> {
    numbers.get(at..)?.first_chunk()
}

#[cfg(test)]
mod tests {
    use depthloom_random::SplitMix64;

    use super::{PackedFloats, unpacked};

    fn assert_comes_back(bits: &[u32]) -> PackedFloats {
        let samples: Vec<f32> = bits.iter().map(|bits| f32::from_bits(*bits)).collect();
        let packed = PackedFloats::of(&samples).unwrap();
        let read = unpacked(samples.len(), &packed.codes, &packed.lows, &packed.highs).unwrap();
        assert!(read.iter().map(|sample| sample.to_bits()).eq(bits.iter().copied()));
        packed
    }

    #[test]
    fn every_bit_comes_back() {
        assert_comes_back(&[]);
        let odd = [0x7fc0_dead, 0xffc0_0001, 0x7f80_0000, 0x8000_0000, 1, 0, u32::MAX, 0x7fff_ffff, 0x3f80_0000];
        for length in 1..odd.len() {
            assert_comes_back(&odd[..length]);
        }
        // All sizes of differences, each also at the bounds of its class, in all lengths about a block's.
        let mut random = SplitMix64::new(7);
        for length in (0..200).chain([4096, 10_001]) {
            let mut last = 0_u32;
            let bits: Vec<u32> = (0..length)
                .map(|_| {
                    let number = random.next();
                    let difference = match number % 5 {
                        0 => 0,
                        1 => [0x7fff, 0x8000, 0x7_ffff, 0x8_0000, 0xffff_8000, 0xffff_7fff, 0xfff8_0000, 0xfff7_ffff]
                            [(number >> 8) as usize % 8],
                        _ => ((number >> 32) as i32 >> ((number >> 8) % 32)) as u32,
                    };
                    last = last.wrapping_add(difference);
                    last
                })
                .collect();
            assert_comes_back(&bits);
        }
    }

    #[test]
    fn equal_neighbours_take_next_to_nothing_and_noise_little_more_than_itself() {
        let packed = assert_comes_back(&[0x4120_0000; 100_000]);
        assert_eq!((packed.lows.len(), packed.highs.len()), (2, 2));
        assert!(packed.codes.len() < 100);
        let mut random = SplitMix64::new(1);
        let noise: Vec<u32> = (0..100_000).map(|_| random.next() as u32).collect();
        let packed = assert_comes_back(&noise);
        assert!(packed.codes.len() + packed.lows.len() + packed.highs.len() < 401_000);
    }

    #[test]
    fn what_is_cut_or_too_long_is_refused() {
        let samples = [1.0, 1.000_001, 1.2, -5.0, 1.0, 1.0, 7.0];
        let PackedFloats { codes, lows, highs } = PackedFloats::of(&samples).unwrap();
        assert!(unpacked(7, &codes, &lows, &highs).is_ok());
        assert!(unpacked(7, &codes, &lows[2..], &highs).is_err());
        assert!(unpacked(7, &codes, &lows, &highs[2..]).is_err());
        assert!(unpacked(7, &codes, &[&lows[..], &[0, 0]].concat(), &highs).is_err());
        assert!(unpacked(70, &codes, &lows, &highs).is_err());
        assert!(unpacked(7, &codes[..codes.len() - 1], &lows, &highs).is_err());
    }
}
