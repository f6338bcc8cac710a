//! Differences of bits by class (see [`crate::float_differences`]), in plain Rust.

use super::Pass;

/// Samples are taken in blocks, whose counts stay in registers and whose buffers in the nearest cache.
pub(crate) const BLOCK: usize = 64;
/// The lowest of what the high 16 bits of a difference are in class 3.
const HIGH: u16 = 16;

/// The parts of whole blocks, with room for one more behind them.
pub(crate) struct Room {
    pub(crate) classes: Vec<u8>,
    pub(crate) middles: Vec<u8>,
    pub(crate) lows: Vec<u8>,
    pub(crate) highs: Vec<u8>,
    pub(crate) progress: Progress,
}

/// How far the blocks have come.
#[derive(Clone, Copy, Default)]
pub(crate) struct Progress {
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
        let Self(blocks, Room { classes, middles, lows, highs, progress }) = self;
        for block in blocks {
            let differences = differences(block, &mut progress.last);
            let (mut low, mut middle, mut high) = ([0_u16; BLOCK], [0_u8; BLOCK], [0_u16; BLOCK]);
            let (mut low_count, mut middle_count, mut high_count) = (0, 0, 0);
            let into = &mut classes.as_chunks_mut::<{ BLOCK / 4 }>().0[progress.blocks];
            for (classes, four) in into.iter_mut().zip(differences.as_chunks::<4>().0) {
                *classes = 0;
                for (place, &difference) in four.iter().enumerate() {
                    // Without a branch, since none could be foreseen: each is written where the next is to stand, which
                    // advances if it is stored.
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
            middles[progress.middles..progress.middles + BLOCK].copy_from_slice(&middle);
            put(&mut lows[2 * progress.lows..], &low);
            put(&mut highs[2 * progress.highs..], &high);
            progress.blocks += 1;
            progress.middles += middle_count;
            progress.lows += low_count;
            progress.highs += high_count;
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
        let Self(Room { classes, middles, lows, highs, progress }, blocks) = self;
        for (block, classes) in blocks.iter_mut().zip(classes.as_chunks::<{ BLOCK / 4 }>().0) {
            let low: &[[u8; 2]; BLOCK] = lows.as_chunks().0.get(progress.lows..)?.first_chunk()?;
            let middle: &[u8; BLOCK] = middles.get(progress.middles..)?.first_chunk()?;
            let high: &[[u8; 2]; BLOCK] = highs.as_chunks().0.get(progress.highs..)?.first_chunk()?;
            let (mut low_count, mut middle_count, mut high_count) = (0, 0, 0);
            let mut differences = [0; BLOCK];
            for (four, classes) in differences.as_chunks_mut::<4>().0.iter_mut().zip(classes) {
                for (place, difference) in four.iter_mut().enumerate() {
                    // Without a branch, as they were taken apart.
                    let class = classes >> (2 * place) & 3;
                    let masked = |is_kept: bool, number: u32| number & u32::from(is_kept).wrapping_neg();
                    let word = |pair: [u8; 2]| u32::from(u16::from_le_bytes(pair));
                    let low = masked(class != 0, word(low[low_count % BLOCK]));
                    low_count += usize::from(class != 0);
                    let middle = masked(class == 2, u32::from(middle[middle_count % BLOCK]));
                    middle_count += usize::from(class == 2);
                    let high = masked(class == 3, word(high[high_count % BLOCK]));
                    high_count += usize::from(class == 3);
                    *difference = (middle | high) << 16 | low;
                }
            }
            for difference in &mut differences {
                *difference = *difference >> 1 ^ (*difference & 1).wrapping_neg();
            }
            for (sample, difference) in block.iter_mut().zip(differences) {
                progress.last = difference.wrapping_add(progress.last);
                *sample = f32::from_bits(progress.last);
            }
            progress.middles += middle_count;
            progress.lows += low_count;
            progress.highs += high_count;
        }
        Some(())
    }
}
