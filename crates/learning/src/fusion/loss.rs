//! The negative log likelihood of a Laplace distribution in log depth, and its gradient.

use depthloom_kernels::learned::{BLOCK, LOG_SPREADS, MAPS, MOST_RESIDUAL, Opinion, RESIDUAL, block_means};

/// What is known of a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Stereo's log share, as the network sees it.
    pub(super) stereo: Option<f32>,
    /// The monocular estimate's log share.
    pub(super) mono: f32,
    /// The log share of trusted stereo; NaN without one.
    pub(super) target: f32,
    pub(super) weight: f32,
    /// Whether stereo shows the target: the network has nothing to judge.
    pub(super) is_shown: bool,
}

/// Sums over pixels with a target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    pub(super) weight: f64,
    /// Sum of the losses and number of the pixels that stereo does not show: where the network must judge.
    pub(super) measured: (f64, u64),
}

/// `|e| / b + ln b` of every pixel, where `e` is the error of the log share. The
/// residual is averaged over blocks. `maps` and `slopes` have [`MAPS`] planes;
/// a slope is weight times derivative.
pub(super) fn add(maps: &[f32], seen: &[Seen], width: usize, slopes: &mut [f32]) -> Sums {
    let (area, mut sums) = (seen.len(), Sums::default());
    assert_eq!((maps.len(), slopes.len()), (MAPS * area, MAPS * area), "the maps have the window's size");
    let (residuals, wide, high) = block_means(&maps[RESIDUAL * area..][..area], width, area / width);
    let block = |at: usize| at / width / BLOCK * wide + at % width / BLOCK;
    let mut by_block = vec![0.0; wide * high];
    for (at, seen) in seen.iter().enumerate() {
        if seen.target.is_nan() {
            continue;
        }
        let opinion = Opinion::new([maps[at], residuals[block(at)], maps[2 * area + at]]);
        let error = opinion.log_share(seen.stereo, seen.mono) - seen.target;
        let inverse = libm::expf(-opinion.log_spread);
        let loss = error.abs() * inverse + opinion.log_spread;
        sums.weight += f64::from(seen.weight);
        if !seen.is_shown {
            sums.measured.0 += f64::from(loss);
            sums.measured.1 += 1;
        }
        let by_share = if error == 0.0 { 0.0 } else { error.signum() * inverse };
        let by_spread = 1.0 - error.abs() * inverse;
        let (by_gate, by_residual) = match seen.stereo {
            Some(stereo) => (stereo - seen.mono - opinion.residual, 1.0 - opinion.gate),
            None => (0.0, 1.0),
        };
        slopes[at] = seen.weight * by_share * by_gate;
        by_block[block(at)] += seen.weight * by_share * by_residual * 2.0 * MOST_RESIDUAL;
        slopes[2 * area + at] = seen.weight * by_spread * (LOG_SPREADS.1 - LOG_SPREADS.0);
    }
    // Sides that are not a multiple of a block make blocks of other sizes, which training does not have.
    let pixels = area as f32 / by_block.len() as f32;
    for (at, slope) in slopes[RESIDUAL * area..][..area].iter_mut().enumerate() {
        *slope = by_block[block(at)] / pixels;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::{BLOCK, MAPS, Seen, add};

    fn seen() -> [Seen; 4] {
        let one = Seen { stereo: Some(-3.2), mono: -3.9, target: -3.3, weight: 1.0, is_shown: false };
        let shown = Seen { target: -3.21, weight: 0.2, is_shown: true, ..one };
        [one, Seen { stereo: None, ..one }, shown, Seen { target: f32::NAN, ..one }]
    }

    /// The sum of weight times loss by its formula, in `f64`.
    fn loss(maps: &[f64], seen: &[Seen], columns: usize) -> f64 {
        let pixels = seen.iter().enumerate().filter(|(_, seen)| !seen.target.is_nan());
        let of_pixel = |(at, seen): (usize, &Seen)| {
            let (row, column) = (at / columns / BLOCK * BLOCK, at % columns / BLOCK * BLOCK);
            let block = (0..BLOCK * BLOCK).map(|at| (row + at / BLOCK) * columns + column + at % BLOCK);
            let mean = block.map(|at| maps[maps.len() / MAPS + at]).sum::<f64>() / (BLOCK * BLOCK) as f64;
            let corrected = f64::from(seen.mono) + 2.0 * mean - 1.0;
            let stereo = seen.stereo.map_or(corrected, f64::from);
            let error = maps[at] * stereo + (1.0 - maps[at]) * corrected - f64::from(seen.target);
            let log_spread = 0.01_f64.ln() * (1.0 - maps[maps.len() / MAPS * 2 + at]);
            f64::from(seen.weight) * (error.abs() / log_spread.exp() + log_spread)
        };
        pixels.map(of_pixel).sum()
    }

    /// Blocks of pixels that are alike in nothing.
    fn scene(columns: usize, rows: usize) -> (Vec<f32>, Vec<Seen>) {
        let maps = (0..MAPS * columns * rows).map(|at| 0.3 + 0.4 * ((at * 7919) % 101) as f32 / 101.0).collect();
        (maps, (0..columns * rows).map(|at| seen()[at * 7 % 4]).collect())
    }

    #[test]
    fn the_slope_is_the_derivative() {
        let (columns, rows) = (2 * BLOCK, BLOCK);
        let (maps, seen) = scene(columns, rows);
        let area = seen.len();
        let mut slopes = vec![0.0; MAPS * area];
        add(&maps, &seen, columns, &mut slopes);
        let maps: Vec<f64> = maps.into_iter().map(f64::from).collect();
        let changed = |map: usize, change: f64| {
            let mut maps = maps.clone();
            maps[map] += change;
            loss(&maps, &seen, columns)
        };
        // In `f64` and with a small step: near the best spread the derivative vanishes and the curvature does not.
        let step = 1e-6;
        for (map, &slope) in slopes.iter().enumerate() {
            let expected = (changed(map, step) - changed(map, -step)) / (2.0 * step);
            let tolerance = 1e-4 * expected.abs().max(0.1);
            assert!((f64::from(slope) - expected).abs() < tolerance, "{map}: {slope} for {expected}");
        }
        for (at, seen) in seen.iter().enumerate() {
            assert!(seen.stereo.is_some() || slopes[at] == 0.0, "there is nothing to choose without stereo");
            assert!(!seen.target.is_nan() || [slopes[at], slopes[2 * area + at]] == [0.0; 2], "no target, no gradient");
        }
        assert!(slopes[area..2 * area].iter().all(|&slope| slope == slopes[area] || slope == slopes[area + BLOCK]));
    }

    #[test]
    fn the_loss_is_that_of_a_laplace_distribution() {
        // Gate 1/2, no residual, a spread of 0.1: the fused log share is -3.55 and the error 0.25.
        let measured = |spread: f32| {
            let sums = add(&[0.5, 0.5, spread], &seen()[..1], 1, &mut [0.0; MAPS]);
            assert_eq!((sums.weight, sums.measured.1), (1.0, 1));
            sums.measured.0
        };
        let (b, error) = (0.01_f64.sqrt(), 0.25);
        assert!((measured(0.5) - (error / b + b.ln())).abs() < 1e-5, "{}", measured(0.5));
        // It is least where the spread is the error.
        let best = ((0.25_f64.ln() - 0.01_f64.ln()) / -0.01_f64.ln()) as f32;
        assert!(measured(best) < measured(best + 0.05).min(measured(best - 0.05)));
        let shown = add(&[0.5; MAPS], &seen()[2..3], 1, &mut [0.0; MAPS]);
        assert_eq!((shown.weight as f32, shown.measured), (0.2, (0.0, 0)));
    }
}
