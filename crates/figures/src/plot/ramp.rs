//! Colours for numbers.

use crate::drawing::Colour;

/// Colours from the lowest number to the highest, evenly apart, mixed between.
pub type Ramp = &'static [Colour];

/// Dark violet to yellow: matplotlib's *viridis*, even to the eye and for colour-blind eyes (Smith and van der Walt, 2015).
pub const SEQUENTIAL: Ramp = &[
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// Blue over white to red: ColorBrewer's *RdBu*, which colour-blind eyes tell apart.
pub const DIVERGING: Ramp = &[
    [33, 102, 172],
    [67, 147, 195],
    [146, 197, 222],
    [209, 229, 240],
    [247, 247, 247],
    [253, 219, 199],
    [244, 165, 130],
    [214, 96, 77],
    [178, 24, 43],
];

/// The colour of a share from 0 to 1 of the way.
pub fn colour(ramp: Ramp, share: f64) -> Colour {
    let place = share.clamp(0.0, 1.0) * (ramp.len() - 1) as f64;
    let below = (place.floor() as usize).min(ramp.len() - 2);
    let (from, to, part) = (ramp[below], ramp[below + 1], place - below as f64);
    std::array::from_fn(|of| (f64::from(from[of]) + (f64::from(to[of]) - f64::from(from[of])) * part).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_the_ends_and_what_lies_between_is_mixed() {
        assert_eq!(colour(SEQUENTIAL, -1.0), SEQUENTIAL[0]);
        assert_eq!(colour(SEQUENTIAL, 2.0), SEQUENTIAL[8]);
        assert_eq!(colour(DIVERGING, 0.5), [247; 3]);
        assert_eq!(colour(DIVERGING, 1.0 / 16.0), [50, 125, 184]);
    }
}
