//! A grey image of means, and comparison of its blocks with those of another.

use depthloom_graphs::values::Image;

use depthloom_nodes::grey::grey;

/// Half of a block's side, in pixels of the reduced image.
pub(super) const HALF: usize = 4;
const SIDE: usize = 2 * HALF + 1;

pub(super) type Block = [u8; SIDE * SIDE];

pub(super) fn texture(block: &Block) -> u32 {
    let rows = block.chunks_exact(SIDE);
    rows.flat_map(|row| row.windows(2)).map(|of| u32::from(of[0].abs_diff(of[1]))).sum()
}

/// The sum of differences from the block's own mean.
pub(super) fn contrast(block: &Block) -> u32 {
    let mean = mean(block);
    block.iter().map(|of| i32::from(*of).abs_diff(mean)).sum()
}

fn mean(block: &Block) -> i32 {
    let sum: i32 = block.iter().map(|of| i32::from(*of)).sum();
    sum / block.len() as i32
}

pub(super) struct Reduced {
    pub(super) width: usize,
    pub(super) height: usize,
    grey: Vec<u8>,
}

impl Reduced {
    pub(super) fn new(image: &Image, factor: usize) -> Self {
        let grey = grey(image);
        let (width, height) = (grey.width() as usize / factor, grey.height() as usize / factor);
        let stride = grey.width() as usize;
        let mut reduced = vec![0; width * height];
        for row in 0..height {
            for column in 0..width {
                let rows = (row * factor..(row + 1) * factor)
                    .map(|y| &grey.as_raw()[y * stride + column * factor..][..factor]);
                let sum: u32 = rows.flatten().map(|of| u32::from(*of)).sum();
                reduced[row * width + column] = (sum / (factor * factor) as u32) as u8;
            }
        }
        Self { width, height, grey: reduced }
    }

    pub(super) fn block(&self, column: usize, row: usize) -> Block {
        let mut block = [0; SIDE * SIDE];
        for (line, out) in block.chunks_exact_mut(SIDE).enumerate() {
            out.copy_from_slice(&self.grey[(row + line - HALF) * self.width + column - HALF..][..SIDE]);
        }
        block
    }

    pub(super) fn apart(&self, block: &Block, column: usize, row: usize) -> u32 {
        let lines = block.chunks_exact(SIDE).enumerate();
        lines
            .map(|(line, of)| {
                let other = &self.grey[(row + line - HALF) * self.width + column - HALF..][..SIDE];
                of.iter().zip(other).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>()
            })
            .sum()
    }

    /// As `apart`, without each block's mean, because cameras differ in exposure.
    pub(super) fn apart_but_for_means(&self, block: &Block, column: usize, row: usize) -> u32 {
        let other = self.block(column, row);
        let between = mean(block) - mean(&other);
        block.iter().zip(&other).map(|(a, b)| (i32::from(*a) - i32::from(*b)).abs_diff(between)).sum()
    }
}
