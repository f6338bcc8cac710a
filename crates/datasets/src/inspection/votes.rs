//! Places of a left image that are found in the right one, and where.

use super::FEWEST;
use super::reduced::{Block, HALF, Reduced, texture};

/// Columns of the reduced images.
pub(super) const ACROSS: usize = 400;
/// Distance of blocks, pixels of the reduced image.
pub(super) const STEP: usize = 5;
/// The largest disparity searched is the reduced width divided by this.
pub(super) const LARGEST: usize = 5;

pub(super) fn has_texture(block: &Block) -> bool {
    texture(block) >= 6 * block.len() as u32
}

pub(super) struct Votes {
    factor: usize,
    /// Column, row and disparity of places found to the left, pixels of the reduced image.
    pub(super) right: Vec<(usize, usize, usize)>,
    pub(super) wrong: usize,
}

impl Votes {
    pub(super) fn collect(left: &Reduced, right: &Reduced, factor: usize) -> Self {
        let mut votes = Self { factor, right: Vec::new(), wrong: 0 };
        let most = left.width / LARGEST;
        let rows = (HALF..left.height.saturating_sub(HALF)).step_by(STEP);
        let columns = (HALF + most..left.width.saturating_sub(HALF + most)).step_by(STEP);
        for row in rows {
            for column in columns.clone() {
                let block = left.block(column, row);
                if !has_texture(&block) {
                    continue;
                }
                let apart = |at: usize| right.apart(&block, at, row);
                let best = |places: &mut dyn Iterator<Item = usize>| {
                    places.enumerate().map(|(d, at)| (apart(at), d + 1)).min().unwrap_or((u32::MAX, 0))
                };
                let (here, to_left) = (apart(column), best(&mut (1..=most).map(|d| column - d)));
                let to_right = best(&mut (1..=most).map(|d| column + d));
                let is_clear = |one: u32, other: u32| 10 * one < 6 * other && 10 * one < 9 * here;
                // A disparity of about one pixel may be none.
                if to_left.1 >= 2 && is_clear(to_left.0, to_right.0) {
                    votes.right.push((column, row, to_left.1));
                } else if to_right.1 >= 2 && is_clear(to_right.0, to_left.0) {
                    votes.wrong += 1;
                }
            }
        }
        votes
    }

    pub(super) fn are_for_exchange(&self) -> bool {
        self.wrong >= FEWEST && self.wrong > 4 * self.right.len()
    }

    /// For each place: the pixels of its block in the full image, and its disparity, px.
    pub(super) fn places(&self, (width, height): (u32, u32)) -> impl Iterator<Item = (Pixels, f64)> {
        let factor = self.factor;
        self.right.iter().map(move |&(column, row, disparity)| {
            let place = |at: usize, count: u32| {
                let from = (at * factor) as u32;
                from..(from + factor as u32).min(count)
            };
            (Pixels::new(place(column, width), place(row, height)), (disparity * factor) as f64)
        })
    }
}

pub(super) struct Pixels {
    columns: std::ops::Range<u32>,
    rows: std::ops::Range<u32>,
}

impl Pixels {
    const fn new(columns: std::ops::Range<u32>, rows: std::ops::Range<u32>) -> Self {
        Self { columns, rows }
    }

    pub(super) fn map<T>(&self, value: impl Fn((u32, u32)) -> T) -> impl Iterator<Item = T> {
        self.rows.clone().flat_map(move |y| self.columns.clone().map(move |x| (x, y))).map(value)
    }
}
