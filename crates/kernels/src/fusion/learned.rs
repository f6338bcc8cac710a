//! Learned fusion: what its network sees of stereo and of a monocular estimate, and what its maps mean.
//!
//! Depth is handled as the logarithm of the disparity's share of the image's width, `ln(f B / (Z width))`. It grows
//! towards the camera, and equal steps are equal ratios of depth.

use crate::raster::{check, check_same};
use crate::resize::{bilinear_f32, shrink_f32};

/// Planes of the network's input: red, green, blue in [0, 1], and those of [`Cell::planes`].
pub const PLANES: usize = 8;
/// Maps of the network's output, each in [0, 1]: see [`Opinion::new`].
pub const MAPS: usize = 3;
/// The map of the residual.
pub const RESIDUAL: usize = 1;
/// Columns and rows of the blocks over which the residual is averaged, px of the network's image. A residual of single
/// pixels would copy stereo, of which the network sees less detail than the gate lets through.
pub const BLOCK: usize = 8;
/// The largest change of the monocular estimate, in log depth.
pub const MOST_RESIDUAL: f32 = 1.0;
/// The smallest and the largest logarithm of the spread: 1 % and 100 % of depth.
pub const LOG_SPREADS: (f32, f32) = (-4.605_170_2, 0.0);
/// Stereo and monocular depth differ at most by this in the network's input, in log depth.
const MOST_DIFFERENCE: f32 = 2.0;

/// The maps of a frame, all of one size: disparities as shares of the image's width.
#[derive(Clone, Copy, Debug)]
pub struct FrameMaps<'a> {
    /// Stereo; NaN = invalid.
    pub stereo: &'a [f32],
    /// Stereo where the right view agrees; NaN elsewhere.
    pub consistent: &'a [f32],
    /// The monocular estimate; NaN = invalid.
    pub mono: &'a [f32],
    /// Confidence in stereo, in [0, 1].
    pub weight: &'a [f32],
}

/// A pixel of the network's image, which covers several pixels of the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cell {
    /// Mean of stereo over its valid pixels; not used if `covered` is 0.
    pub stereo: f32,
    /// Share of the cell where stereo is valid.
    pub covered: f32,
    /// Share of the cell where the right view agrees with stereo.
    pub consistent: f32,
    /// Mean of the monocular estimate over its valid pixels; 0 = invalid.
    pub mono: f32,
    /// Mean confidence in stereo.
    pub weight: f32,
}

impl Cell {
    /// The network's planes after the colours: stereo less monocular estimate (0 where one is invalid), `covered`, the
    /// monocular estimate, `consistent`, `weight`.
    #[must_use]
    pub fn planes(&self) -> [f32; PLANES - 3] {
        let mono = if self.mono > 0.0 { ln(self.mono) } else { 0.0 };
        let both = self.covered > 0.0 && self.mono > 0.0;
        let apart = if both { (ln(self.stereo) - mono).clamp(-MOST_DIFFERENCE, MOST_DIFFERENCE) } else { 0.0 };
        // Depths of KITTI lie between ln share = -5.5 (80 m) and -2.3 (3 m).
        let mono = if self.mono > 0.0 { (mono + 4.0) * 0.5 } else { 0.0 };
        [apart, self.covered, mono, self.consistent, self.weight]
    }
}

/// The outputs of the network for a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Opinion {
    /// Weight of stereo, in [0, 1].
    pub gate: f32,
    /// Added to the monocular estimate's log share.
    pub residual: f32,
    /// Logarithm of the spread `b` of log depth, whose error is Laplace distributed.
    pub log_spread: f32,
}

impl Opinion {
    /// From the three maps, each in [0, 1]: the gate itself; the residual, from `-MOST_RESIDUAL` to `MOST_RESIDUAL`;
    /// the logarithm of the spread, over [`LOG_SPREADS`].
    #[must_use]
    pub const fn new([gate, residual, spread]: [f32; MAPS]) -> Self {
        let (least, most) = LOG_SPREADS;
        let residual = (2.0 * residual - 1.0) * MOST_RESIDUAL;
        Self { gate, residual, log_spread: least + (most - least) * spread }
    }

    /// The fused log share: `g s + (1 - g)(m + r)`, or `m + r` without stereo.
    #[must_use]
    pub fn log_share(&self, stereo: Option<f32>, mono: f32) -> f32 {
        let corrected = mono + self.residual;
        stereo.map_or(corrected, |stereo| self.gate * stereo + (1.0 - self.gate) * corrected)
    }
}

/// The means of a map over blocks of [`BLOCK`] pixels, with their columns and rows.
///
/// # Panics
/// If the map is empty or does not have the announced size.
#[must_use]
pub fn block_means(map: &[f32], columns: usize, rows: usize) -> (Vec<f32>, usize, usize) {
    let (wide, high) = (columns.div_ceil(BLOCK), rows.div_ceil(BLOCK));
    let mut means = vec![0.0; wide * high];
    shrink_f32(map, columns, rows, wide, high, &mut means);
    (means, wide, high)
}

/// The natural logarithm, equal on every machine.
#[must_use]
pub fn ln(x: f32) -> f32 {
    libm::logf(x)
}

/// The frame at the network's size, by area.
///
/// # Panics
/// If maps have other sizes, or the network's image is larger than the frame.
#[must_use]
pub fn cells(maps: &FrameMaps<'_>, (width, height): (usize, usize), (columns, rows): (usize, usize)) -> Vec<Cell> {
    let shrunk = |value: &dyn Fn(usize) -> f32| {
        let map: Vec<f32> = (0..width * height).map(value).collect();
        let mut small = vec![0.0; columns * rows];
        shrink_f32(&map, width, height, columns, rows, &mut small);
        small
    };
    for (what, map) in
        [("stereo", maps.stereo), ("consistent", maps.consistent), ("mono", maps.mono), ("weight", maps.weight)]
    {
        check(what, map.len(), width, height, 1);
    }
    let is_valid = |share: f32| share.is_finite() && share > 0.0;
    let sum = |map: &[f32]| shrunk(&|pixel| if is_valid(map[pixel]) { map[pixel] } else { 0.0 });
    let cover = |map: &[f32]| shrunk(&|pixel| f32::from(u8::from(is_valid(map[pixel]))));
    let (stereo, covered) = (sum(maps.stereo), cover(maps.stereo));
    let (mono, mono_covered) = (sum(maps.mono), cover(maps.mono));
    let (consistent, weight) = (cover(maps.consistent), shrunk(&|pixel| maps.weight[pixel]));
    let mean = |sum: f32, covered: f32| if covered > 0.0 { sum / covered } else { 0.0 };
    (0..columns * rows)
        .map(|cell| Cell {
            stereo: mean(stereo[cell], covered[cell]),
            covered: covered[cell],
            consistent: consistent[cell],
            mono: mean(mono[cell], mono_covered[cell]),
            weight: weight[cell],
        })
        .collect()
}

/// Depth and its standard deviation, metres, from stereo, the monocular estimate (metres, NaN = invalid) and the
/// network's maps, which are enlarged to the frame's size (bilinear). The residual is averaged over blocks before.
///
/// Where monocular depth is invalid, the result is stereo; where both are, it is NaN. The standard deviation of a
/// Laplace distribution is `sqrt(2) b`; in metres, to first order, that times depth.
///
/// # Panics
/// If a slice does not have the announced size.
pub fn apply(
    (stereo, mono): (&[f32], &[f32]),
    (width, height): (usize, usize),
    (maps, columns, rows): (&[f32], usize, usize),
    cap_metres: f32,
    (depth, deviation): (&mut [f32], &mut [f32]),
) {
    check("mono", mono.len(), width, height, 1);
    check("maps", maps.len(), columns, rows, MAPS);
    check_same("stereo", stereo.len(), mono.len());
    check_same("depth", depth.len(), mono.len());
    check_same("deviation", deviation.len(), mono.len());
    let mut large = vec![0.0; MAPS * width * height];
    let planes = maps.chunks_exact(columns * rows).zip(large.chunks_exact_mut(width * height));
    for (plane, (small, large)) in planes.enumerate() {
        if plane == RESIDUAL {
            let (means, wide, high) = block_means(small, columns, rows);
            bilinear_f32(&means, wide, high, width, height, large);
        } else {
            bilinear_f32(small, columns, rows, width, height, large);
        }
    }
    let is_valid = |metres: f32| metres.is_finite() && metres > 0.0;
    let area = width * height;
    for (pixel, (depth, deviation)) in depth.iter_mut().zip(deviation).enumerate() {
        let (stereo, mono) = (stereo[pixel], mono[pixel]);
        let opinion = Opinion::new([large[pixel], large[area + pixel], large[2 * area + pixel]]);
        // Shares in units of f B / (width m): their logarithm is that of depth, negated.
        let metres = match (is_valid(stereo), is_valid(mono)) {
            (has_stereo, true) => libm::expf(-opinion.log_share(has_stereo.then(|| -ln(stereo)), -ln(mono))),
            (true, false) => stereo,
            (false, false) => f32::NAN,
        };
        *depth = if metres > cap_metres { cap_metres } else { metres };
        *deviation = std::f32::consts::SQRT_2 * libm::expf(opinion.log_spread) * *depth;
    }
}

#[cfg(test)]
mod tests {
    use super::{Cell, FrameMaps, Opinion, apply, cells, ln};

    #[test]
    fn a_cell_is_the_mean_of_its_valid_pixels() {
        let none = f32::NAN;
        let maps = FrameMaps {
            stereo: &[0.02, 0.04, none, none, none, none, 0.06, none],
            consistent: &[none, 0.04, none, none, none, none, none, none],
            mono: &[0.03, 0.03, 0.01, 0.01, 0.05, 0.05, none, none],
            weight: &[0.0, 1.0, 0.5, 0.5, 1.0, 0.0, 0.5, 0.5],
        };
        let found = cells(&maps, (4, 2), (2, 1));
        let expected = [
            Cell { stereo: 0.03, covered: 0.5, consistent: 0.25, mono: 0.04, weight: 0.5 },
            Cell { stereo: 0.06, covered: 0.25, consistent: 0.0, mono: 0.01, weight: 0.5 },
        ];
        for (found, expected) in found.iter().zip(&expected) {
            let values = |cell: &Cell| [cell.stereo, cell.covered, cell.consistent, cell.mono, cell.weight];
            let near = values(found).into_iter().zip(values(expected)).all(|(a, b)| (a - b).abs() < 1e-6);
            assert!(near, "{found:?} is not {expected:?}");
        }
    }

    #[test]
    fn planes_have_no_number_that_is_not_finite() {
        let cell = Cell { stereo: 0.02, covered: 1.0, consistent: 0.5, mono: 0.04, weight: 0.7 };
        let planes = cell.planes();
        assert!((planes[0] + std::f32::consts::LN_2).abs() < 1e-5, "{planes:?}");
        assert_eq!((planes[1], planes[3], planes[4]), (1.0, 0.5, 0.7));
        assert_eq!(Cell::default().planes(), [0.0; 5]);
        assert_eq!(Cell { covered: 0.0, ..cell }.planes()[0], 0.0);
        assert_eq!(Cell { stereo: 1.0, mono: 1e-4, ..cell }.planes()[0], 2.0);
    }

    /// The formulas, a pixel at a time in `f64`.
    #[test]
    fn the_result_follows_its_formulas() {
        let stereo = [10.0, f32::NAN, 10.0, f32::NAN, 200.0];
        let mono = [20.0, 20.0, f32::NAN, f32::NAN, 20.0];
        // Gate 0.25, residual 0.2 towards the camera, spread e^-2.3.
        let maps = [vec![0.25; 5], vec![0.6; 5], vec![0.5; 5]].concat();
        let (mut depth, mut deviation) = ([0.0; 5], [0.0; 5]);
        apply((&stereo, &mono), (5, 1), (&maps, 5, 1), 80.0, (&mut depth, &mut deviation));
        let corrected = 20.0_f64.ln() - 0.2;
        let expected = [
            (0.25 * 10.0_f64.ln() + 0.75 * corrected).exp(),
            corrected.exp(),
            10.0,
            f64::NAN,
            (0.25 * 200.0_f64.ln() + 0.75 * corrected).exp(),
        ];
        let spread = std::f64::consts::SQRT_2 * 0.01_f64.sqrt();
        for ((depth, deviation), expected) in depth.into_iter().zip(deviation).zip(expected) {
            let (depth, deviation) = (f64::from(depth), f64::from(deviation));
            assert!(depth.is_nan() && expected.is_nan() || (depth / expected - 1.0).abs() < 1e-5, "{depth} {expected}");
            assert!(depth.is_nan() || (deviation / (spread * expected) - 1.0).abs() < 1e-4, "{deviation}");
        }
        apply((&stereo, &mono), (5, 1), (&maps, 5, 1), 12.0, (&mut depth, &mut deviation));
        assert_eq!(depth[1], 12.0, "it is capped");
    }

    #[test]
    fn the_gate_chooses() {
        let opinion = |gate| Opinion::new([gate, 0.5, 0.5]);
        let (stereo, mono) = (ln(0.02), ln(0.04));
        assert_eq!(opinion(1.0).log_share(Some(stereo), mono), stereo);
        assert_eq!(opinion(0.0).log_share(Some(stereo), mono), mono);
        assert_eq!(opinion(1.0).log_share(None, mono), mono);
    }
}
