//! Maps of floats in fewer bytes, bit for bit.
//!
//! `depthloom.FloatMap` holds its samples row by row, either as they are (`data`) or as the differences of their
//! bits: neighbours are often equal, and more often alike in sign, exponent and first digits, while the last two
//! bytes of a computed number are noise that cannot be compressed. The bits of each sample, read as a number,
//! less those of the sample before it (of the first: less zero), modulo 2^32 and with the sign brought into the
//! lowest bit (`d << 1 ^ d >> 31`), are of one of four classes:
//!
//! | class | difference | kept of it |
//! |---|---|---|
//! | 0 | 0 | nothing |
//! | 1 | below 2^16 | its low 16 bits in `lows` |
//! | 2 | below 2^20 | these, and four bits more in `codes` |
//! | 3 | any other | these, and its high 16 bits in `codes` |
//!
//! `codes` is a zstd frame of the classes, two bits each, four a byte, the first lowest; behind them of the four bits
//! of all samples of class 2, two a byte, the first lower; and behind these of the high 16 bits of all samples of class
//! 3, first the lower bytes of all, then the upper. Each of these four sections ends with a block. `lows` are
//! little-endian.
//!
//! The standard encoding of viewers, `32FC1` in a chunk that zstd compresses, costs too much to be the default. Maps of
//! 1242x375 (8 frames of KITTI, an EPYC, the best of 9 rounds, level 1), without checksums and copies:
//!
//! | map | this format | `32FC1`, zstd |
//! |---|---|---|
//! | fused and merged depth | 0.5 to 0.9 ms, 0.6 to 0.9 MB | 3.8 to 6.9 ms, 0.6 to 1.4 MB |
//! | stereo depth | 0.6 ms, 690 kB | 5.7 ms, 480 kB |
//! | sparse ground truth | 0.7 ms, 450 kB | 3.0 ms, 360 kB |
//! | weight | 1.1 ms, 1.2 MB | 2.5 ms, 1.6 MB |
//! | ground plane | 0.1 ms, 0.8 kB | 0.3 ms, 1.3 kB |
//!
//! With the bytes of equal rank together, zstd takes 8 to 13 ms on a Xeon, for 1.1 MB of a fused map.

use std::io;

use depthloom_kernels::float_differences::Parts;

use crate::compression;

/// The samples of a map in fewer bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackedFloats {
    /// Classes, middle and high bits, compressed.
    pub codes: Vec<u8>,
    /// The low 16 bits.
    pub lows: Vec<u8>,
}

impl PackedFloats {
    /// Packs samples.
    pub fn pack(samples: &[f32]) -> io::Result<Self> {
        let Parts { classes, middles, lows, highs } = Parts::split(samples);
        let highs = highs.as_chunks::<2>().0;
        let [lower, upper] = [0, 1].map(|byte| highs.iter().map(|high| high[byte]).collect::<Vec<u8>>());
        let codes = compression::compress_sections(&[&classes, &middles, &lower, &upper])?;
        Ok(Self { codes, lows })
    }
}

/// The samples of a map that was packed.
pub fn unpacked(count: usize, codes: &[u8], lows: &[u8]) -> Result<Vec<f32>, String> {
    let malformed = || "the number of samples of a map differs from its stated size".to_owned();
    let class_bytes = count.div_ceil(4);
    let mut all = Vec::new();
    // The most that `count` samples can have: the frame's own size is not trusted.
    let most = class_bytes + 2 * count;
    let no_memory = |_| format!("there is no memory for a map of {count} samples");
    all.try_reserve_exact(most).map_err(no_memory)?;
    compression::decompress(codes, &mut all).map_err(|error| format!("a map cannot be decompressed: {error}"))?;
    let (classes, rest) = all.split_at_checked(class_bytes).ok_or_else(malformed)?;
    // Of each class its upper bit, at the place of its lower, is set in 2 and 3; both are in 3.
    let of_class_2: usize = classes.iter().map(|four| (four >> 1 & !four & 0x55).count_ones() as usize).sum();
    let (middles, highs) = rest.split_at_checked(of_class_2.div_ceil(2)).ok_or_else(malformed)?;
    let (lower, upper) = highs.split_at(highs.len() / 2);
    if lower.len() != upper.len() {
        return Err(malformed());
    }
    let highs: Vec<[u8; 2]> = lower.iter().zip(upper).map(|(lower, upper)| [*lower, *upper]).collect();
    Parts::joined(count, classes, middles, lows, highs.as_flattened()).ok_or_else(malformed)
}

#[cfg(test)]
mod tests {
    use depthloom_random::SplitMix64;

    use super::{PackedFloats, unpacked};
    use crate::compression;

    fn assert_comes_back(bits: &[u32]) -> PackedFloats {
        let samples: Vec<f32> = bits.iter().map(|bits| f32::from_bits(*bits)).collect();
        let packed = PackedFloats::pack(&samples).unwrap();
        let read = unpacked(samples.len(), &packed.codes, &packed.lows).unwrap();
        assert!(read.iter().map(|sample| sample.to_bits()).eq(bits.iter().copied()));
        packed
    }

    #[test]
    fn every_bit_is_restored() {
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
        assert_eq!(packed.lows.len(), 2);
        assert!(packed.codes.len() < 100);
        let mut random = SplitMix64::new(1);
        let noise: Vec<u32> = (0..100_000).map(|_| random.next() as u32).collect();
        let packed = assert_comes_back(&noise);
        assert!(packed.codes.len() + packed.lows.len() < 430_000);
    }

    #[test]
    fn truncated_or_too_long_input_is_refused() {
        let samples = [1.0, 1.000_001, 1.2, -5.0, 1.0, 1.0, 7.0];
        let PackedFloats { codes, lows } = PackedFloats::pack(&samples).unwrap();
        assert!(unpacked(7, &codes, &lows).is_ok());
        assert!(unpacked(7, &codes, &lows[2..]).is_err());
        assert!(unpacked(7, &codes, &[&lows[..], &[0, 0]].concat()).is_err());
        assert!(unpacked(70, &codes, &lows).is_err());
        assert!(unpacked(7, &codes[..codes.len() - 1], &lows).is_err());
        // One high number of class 3 too few, half of one, one too many.
        let mut plain = Vec::with_capacity(100);
        compression::decompress(&codes, &mut plain).unwrap();
        for changed in [&plain[..plain.len() - 2], &plain[..plain.len() - 1], &[&plain[..], &[0, 0]].concat()] {
            let mut codes = Vec::with_capacity(compression::bound(changed.len()));
            compression::compress(changed, &mut codes).unwrap();
            assert!(unpacked(7, &codes, &lows).is_err());
        }
    }
}
