//! Band-limited patterns: noise that fades where a pixel covers more than its cells, and pulse trains integrated
//! exactly over a pixel's footprint.
//!
//! Lattices wrap after [`WRAP_METRES`], the length after which the scene's coordinates wrap, so that a
//! texture sits still on its wall however far along the street the car is. Frequencies are therefore powers of two.

use crate::hash::unit;

/// Scene coordinates along the street stay below this (plus the range of sight).
pub(crate) const WRAP_METRES: f32 = 1024.0;

/// Largest integer not above `value` (`f32::floor` is a library call on baseline x86-64).
pub(crate) fn floor(value: f32) -> i32 {
    let truncated = value as i32;
    truncated - i32::from(value < truncated as f32)
}

/// What is left above [`floor`], in [0, 1).
pub(crate) fn fraction(value: f32) -> f32 {
    value - floor(value) as f32
}

/// The smooth step of Perlin's first noise.
fn ease(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

/// How much of a pattern with cells this large survives a pixel that covers `footprint`.
pub(crate) fn surviving(cell: f32, footprint: f32) -> f32 {
    (1.5 - footprint / cell).clamp(0.0, 1.0)
}

/// A pattern weakened by [`surviving`], and not even computed where nothing of it is left.
pub(crate) fn faded(cell: f32, footprint: f32, pattern: impl FnOnce() -> f32) -> f32 {
    let share = surviving(cell, footprint);
    if share > 0.0 { share * pattern() } else { 0.0 }
}

/// A lattice coordinate's share of a hash; one odd factor for each direction.
fn along(cell: i32) -> u32 {
    cell.cast_unsigned().wrapping_mul(0x9e37_79b1)
}

fn across(cell: i32) -> u32 {
    cell.cast_unsigned().wrapping_mul(0x85eb_ca6b)
}

fn upwards(cell: i32) -> u32 {
    cell.cast_unsigned().wrapping_mul(0xc2b2_ae35)
}

/// Most of a full hash, good in its upper bits: enough for what is only looked at.
fn scramble(h: u32) -> u32 {
    let h = (h ^ (h >> 16)).wrapping_mul(0x21f0_aaad);
    (h ^ (h >> 15)).wrapping_mul(0x735a_2d97)
}

fn wrap(cells_per_metre: f32) -> i32 {
    (WRAP_METRES * cells_per_metre) as i32 - 1
}

/// Value noise in [-1, 1] at `cells_per_metre` (a power of two, at least 1/64); `along` is the coordinate that wraps.
pub(crate) fn noise2(seed: u32, along: f32, across: f32, cells_per_metre: f32) -> f32 {
    let mask = wrap(cells_per_metre);
    noise_cells(seed, along * cells_per_metre, across * cells_per_metre, mask)
}

fn noise_cells(seed: u32, x: f32, y: f32, mask: i32) -> f32 {
    let (ix, iy) = (floor(x), floor(y));
    let (fx, fy) = (ease(x - ix as f32), ease(y - iy as f32));
    let (x0, x1) = (along(ix & mask), along((ix + 1) & mask));
    let (y0, y1) = (seed.wrapping_add(across(iy)), seed.wrapping_add(across(iy + 1)));
    let (a, b) = (unit(scramble(x0 ^ y0)), unit(scramble(x1 ^ y0)));
    let (c, d) = (unit(scramble(x0 ^ y1)), unit(scramble(x1 ^ y1)));
    let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
    2.0 * (top + (bottom - top) * fy) - 1.0
}

/// Noise whose cells are stretched along z by a power of two until they cover `footprint_along`, and weakened as an
/// average over that many cells would be: the road seen at a grazing angle keeps its detail across the lane and loses
/// it along.
pub(crate) fn noise_grazing(seed: u32, along: f32, across: f32, cells_per_metre: f32, footprint_along: f32) -> f32 {
    let mut stretch = 1.0_f32;
    let mut strength = 1.0_f32;
    while footprint_along * cells_per_metre > 1.5 * stretch && stretch < 64.0 {
        stretch *= 2.0;
        strength *= std::f32::consts::FRAC_1_SQRT_2;
    }
    let mask = wrap(cells_per_metre / stretch);
    strength * noise_cells(seed, along * (cells_per_metre / stretch), across * cells_per_metre, mask)
}

/// Value noise in space, for what has no flat surface; `z` wraps.
pub(crate) fn noise3(seed: u32, x: f32, y: f32, z: f32, cells_per_metre: f32) -> f32 {
    let mask = wrap(cells_per_metre);
    let (x, y, z) = (x * cells_per_metre, y * cells_per_metre, z * cells_per_metre);
    let (ix, iy, iz) = (floor(x), floor(y), floor(z));
    let (fx, fy, fz) = (ease(x - ix as f32), ease(y - iy as f32), ease(z - iz as f32));
    let (x0, x1) = (across(ix), across(ix + 1));
    let (y0, y1) = (upwards(iy), upwards(iy + 1));
    let layer = |k: i32| {
        let z = seed.wrapping_add(along((iz + k) & mask));
        let mixed = |x: u32, y: u32| unit(scramble(z ^ x.wrapping_add(y)));
        let (a, b, c, d) = (mixed(x0, y0), mixed(x1, y0), mixed(x0, y1), mixed(x1, y1));
        let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
        top + (bottom - top) * fy
    };
    let (near, far) = (layer(0), layer(1));
    2.0 * (near + (far - near) * fz) - 1.0
}

/// A train of pulses of `width` every `period`, the first starting at 0, averaged over `footprint` around `at`: an
/// exact box filter.
pub(crate) fn pulses(at: f32, period: f32, width: f32, footprint: f32) -> f32 {
    let footprint = footprint.max(1e-4);
    let cycles_per_metre = 1.0 / period;
    let covered = |x: f32| {
        let cycles = x * cycles_per_metre;
        let whole = floor(cycles) as f32;
        whole * width + ((cycles - whole) * period).min(width)
    };
    ((covered(at + 0.5 * footprint) - covered(at - 0.5 * footprint)) / footprint).clamp(0.0, 1.0)
}

/// One pulse from `low` to `high`, averaged over `footprint` around `at`.
pub(crate) fn slab(at: f32, low: f32, high: f32, footprint: f32) -> f32 {
    let footprint = footprint.max(1e-4);
    let (start, end) = (at - 0.5 * footprint, at + 0.5 * footprint);
    ((end.min(high) - start.max(low)) / footprint).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_average_to_their_share() {
        let (period, width) = (2.5, 1.0);
        let wide = pulses(17.3, period, width, 250.0);
        assert!((wide - width / period).abs() < 0.01, "{wide}");
        assert!(pulses(0.5, period, width, 0.01) > 0.9999);
        assert!(pulses(1.75, period, width, 0.01) < 1e-4);
        assert!((pulses(0.0, period, width, 0.2) - 0.5).abs() < 1e-4);
        assert!((pulses(-2.0, period, width, 0.01) - 1.0).abs() < 1e-4, "negative coordinates are in phase");
    }

    #[test]
    fn noise_is_continuous_over_the_wrap() {
        for cells in [0.25, 1.0, 8.0, 32.0] {
            let (before, after) = (noise2(7, WRAP_METRES - 1e-3, 0.4, cells), noise2(7, 0.0, 0.4, cells));
            assert!((before - after).abs() < 0.02, "{cells}: {before} {after}");
            assert_eq!(noise2(7, 3.25, 0.4, cells), noise2(7, 3.25 + WRAP_METRES, 0.4, cells));
        }
    }

    #[test]
    fn floor_is_floor() {
        for value in [-2.0, -1.5, -0.0, 0.0, 0.99, 1.0, 123.4] {
            assert_eq!(floor(value) as f32, f32::floor(value));
        }
    }
}
