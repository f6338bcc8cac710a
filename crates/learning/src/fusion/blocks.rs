//! Blocks of a window in which stereo is hidden, wrong, or right without confirmation.

use depthloom_kernels::learned::Cell;
use depthloom_random::SplitMix64;

use super::params::FusionParams;
use crate::networks::Size;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    /// No stereo.
    Hidden,
    /// Stereo of the pixel this many columns and rows on.
    Moved(usize, usize),
    /// The same disparity everywhere, as a share of the width.
    Constant(f32),
    /// Every disparity times this.
    Scaled(f32),
    /// Stereo as it is; the right view does not agree.
    Unconfirmed,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Block {
    columns: (usize, usize),
    rows: (usize, usize),
    change: Change,
    /// Whether wrong stereo has the confirmation of the place that it replaces or comes from.
    confirmed: bool,
}

/// Changes stereo in random blocks of a window.
pub(super) fn apply(params: &FusionParams, size: Size, random: &mut SplitMix64, cells: &mut [Cell]) {
    let before = cells.to_vec();
    for _ in 0..=random.below(params.blocks as usize) {
        let block = Block::draw(params, size, random);
        for row in block.rows.0..block.rows.1 {
            for column in block.columns.0..block.columns.1 {
                let cell = &mut cells[row * size.width + column];
                block.change(cell, |columns, rows| {
                    before[(row + rows) % size.height * size.width + (column + columns) % size.width]
                });
            }
        }
    }
}

impl Block {
    fn draw(params: &FusionParams, size: Size, random: &mut SplitMix64) -> Self {
        // Every number is drawn whether it is used or not: the sequence never shifts.
        let [shape, kind, wrong, value, confirmed] = [(); 5].map(|()| random.unit());
        let sides = [(); 2].map(|()| random.unit());
        let places = [(); 2].map(|()| random.unit());
        let (dx, dy) = (random.below(size.width), random.below(size.height));
        // Sides are log-uniform from 1/32 to 2/3; some blocks are bands across the window, and few are all of it.
        let side = |unit: f32| libm::expf(unit * libm::logf(64.0 / 3.0)) / 32.0;
        let (wide, high) = match shape {
            ..0.15 => (1.0, side(sides[1])),
            ..0.3 => (side(sides[0]), 1.0),
            ..0.32 => (1.0, 1.0),
            _ => (side(sides[0]), side(sides[1])),
        };
        let span = |share: f32, place: f32, side: usize| {
            let length = ((share * side as f32) as usize).clamp(1, side);
            let first = (place * (side - length + 1) as f32) as usize;
            (first, first + length)
        };
        let (kind, hidden) = (f64::from(kind), params.hidden);
        let change = if kind < hidden {
            Change::Hidden
        } else if kind < hidden + params.wrong {
            match wrong {
                ..0.5 => Change::Moved(dx, dy),
                ..0.75 => Change::Constant(libm::expf(-6.0 + 4.0 * value)),
                _ if value < 0.5 => Change::Scaled(libm::expf(0.2 + 2.0 * value)),
                _ => Change::Scaled(libm::expf(-0.2 - 2.0 * (value - 0.5))),
            }
        } else {
            Change::Unconfirmed
        };
        let (columns, rows) = (span(wide, places[0], size.width), span(high, places[1], size.height));
        Self { columns, rows, change, confirmed: confirmed < 0.3 }
    }

    fn change(&self, cell: &mut Cell, moved: impl Fn(usize, usize) -> Cell) {
        match self.change {
            Change::Hidden => (cell.stereo, cell.covered) = (0.0, 0.0),
            Change::Moved(columns, rows) => {
                let other = moved(columns, rows);
                (cell.stereo, cell.covered, cell.consistent) = (other.stereo, other.covered, other.consistent);
            }
            Change::Constant(share) if cell.covered > 0.0 => cell.stereo = share,
            Change::Scaled(factor) => cell.stereo *= factor,
            Change::Constant(_) | Change::Unconfirmed => {}
        }
        let is_right = matches!(self.change, Change::Hidden | Change::Unconfirmed);
        if is_right || !self.confirmed {
            cell.consistent = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Cell, FusionParams, Size, SplitMix64, apply};

    #[test]
    fn blocks_hide_and_falsify_stereo_and_leave_the_rest() {
        let size = Size { width: 64, height: 32 };
        let cells: Vec<Cell> = (0..64 * 32)
            .map(|at| Cell { stereo: 0.01 + at as f32 * 1e-5, covered: 1.0, consistent: 1.0, mono: 0.02, weight: 0.5 })
            .collect();
        let changed = |hidden: f64, wrong: f64, seed: u64| {
            let params = FusionParams { hidden, wrong, ..FusionParams::default() };
            let mut changed = cells.clone();
            apply(&params, size, &mut SplitMix64::new(seed), &mut changed);
            changed
        };
        let (mut hidden, mut wrong, mut confirmed, mut unconfirmed) = (0, 0, 0, 0);
        for seed in 0..40 {
            for (before, after) in cells.iter().zip(changed(0.5, 0.3, seed)) {
                assert_eq!((after.mono, after.weight), (before.mono, before.weight));
                match (after.covered > 0.0, after.stereo == before.stereo) {
                    (false, _) => hidden += 1,
                    (true, false) => {
                        wrong += 1;
                        confirmed += usize::from(after.consistent > 0.0);
                    }
                    (true, true) => unconfirmed += usize::from(after.consistent == 0.0),
                }
            }
        }
        let all = 40 * cells.len();
        for (what, count) in [("hidden", hidden), ("wrong", wrong), ("unconfirmed", unconfirmed)] {
            assert!((all / 50..all / 2).contains(&count), "{what}: {count} of {all}");
        }
        assert!((wrong / 10..wrong / 2).contains(&confirmed), "{confirmed} of {wrong}");
        assert_eq!(changed(0.5, 0.3, 7), changed(0.5, 0.3, 7));
        assert!(changed(0.0, 0.0, 3).iter().zip(&cells).all(|(after, before)| after.stereo == before.stereo));
    }
}
