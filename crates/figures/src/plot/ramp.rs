//! Colours for numbers.

use super::Axis;
use crate::drawing::Colour;

/// Colours from the lowest number to the highest, evenly apart, mixed between.
type Ramp = [Colour; 9];

/// Dark violet to yellow: matplotlib's *viridis*, even to the eye and for colour-blind eyes (Smith and van der Walt,
/// 2015).
#[rustfmt::skip]
pub const SEQUENTIAL: Ramp = [
    [68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141],
    [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37],
];

/// Blue over white to red: ColorBrewer's *RdBu*, which colour-blind eyes tell apart.
#[rustfmt::skip]
pub const DIVERGING: Ramp = [
    [33, 102, 172], [67, 147, 195], [146, 197, 222], [209, 229, 240], [247, 247, 247],
    [253, 219, 199], [244, 165, 130], [214, 96, 77], [178, 24, 43],
];

/// A colour bar.
#[derive(Clone, Debug)]
pub struct Bar {
    /// Its colours.
    pub ramp: Ramp,
    /// Its numbers.
    pub axis: Axis,
}

impl Bar {
    /// The colour of a number.
    pub fn colour(&self, value: f64) -> Colour {
        self.at(self.axis.place(value))
    }

    /// The colour of a share from 0 to 1 of the way.
    pub(super) fn at(&self, share: f64) -> Colour {
        let place = share.clamp(0.0, 1.0) * (self.ramp.len() - 1) as f64;
        let below = (place as usize).min(self.ramp.len() - 2);
        let (from, to, part) = (self.ramp[below], self.ramp[below + 1], place - below as f64);
        std::array::from_fn(|i| (f64::from(from[i]) + (f64::from(to[i]) - f64::from(from[i])) * part).round() as u8)
    }
}

#[cfg(test)]
mod tests;
