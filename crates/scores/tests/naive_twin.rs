//! The scores against a twin that follows the oracle line by line: whole vectors, divisions, the system's logarithm,
//! two passes.

use depthloom_scores::{
    Align, Crop, Family, PixelSet, Preset, ScaleInvariant, ScoreRow, Settings, SquaredRelative, score,
};
use proptest::prelude::*;

fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.into_iter().collect();
    values.iter().sum::<f64>() / values.len() as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    f64::midpoint(values[(values.len() - 1) / 2], values[values.len() / 2])
}

fn naive(estimate: &[f32], truth: &[f32], width: usize, set: PixelSet, settings: &Settings) -> ScoreRow {
    let window = settings.crop.window(width, truth.len() / width);
    let scored = |i: usize| {
        let t = truth[i];
        let inside = window.rows.contains(&(i / width)) && window.columns.contains(&(i % width));
        inside && t > settings.min_m as f32 && t < settings.max_m as f32
    };
    let valid = |i: &usize| estimate[*i].is_finite();
    let all: Vec<usize> = (0..truth.len()).filter(|&i| scored(i)).collect();
    let valid_pixels: Vec<usize> = all.iter().copied().filter(valid).collect();
    let mut factor = 1.0;
    if settings.align == Align::Median && !valid_pixels.is_empty() {
        let median_of = |map: &[f32]| median(valid_pixels.iter().map(|&i| f64::from(map[i])).collect());
        factor = median_of(truth) / median_of(estimate);
    }
    let pixels = if set == PixelSet::All { &all } else { &valid_pixels };
    let t: Vec<f64> = pixels.iter().map(|&i| f64::from(truth[i])).collect();
    let clamped = |i: usize| (f64::from(estimate[i]) * factor).clamp(settings.min_m, settings.max_m);
    let y: Vec<f64> = pixels.iter().map(|i| if valid(i) { clamped(*i) } else { settings.missing_m }).collect();
    let pairs = || y.iter().copied().zip(t.iter().copied());
    let within = |limit: f64| mean(pairs().map(|(y, t)| f64::from(u8::from((y / t).max(t / y) < limit))));
    let logs: Vec<f64> = pairs().map(|(y, t)| y.ln() - t.ln()).collect();
    let log_mean = mean(logs.iter().copied());
    let variance = mean(logs.iter().map(|e| (e - log_mean).powi(2)));
    let scores = [
        within(1.25),
        within(1.25_f64.powi(2)),
        within(1.25_f64.powi(3)),
        mean(pairs().map(|(y, t)| (y - t).abs() / t)),
        match settings.sq_rel {
            SquaredRelative::ByTruth => mean(pairs().map(|(y, t)| (y - t).powi(2) / t)),
            SquaredRelative::ByTruthSquared => mean(pairs().map(|(y, t)| (y - t).powi(2) / (t * t))),
        },
        mean(pairs().map(|(y, t)| (y - t).powi(2))).sqrt(),
        mean(logs.iter().map(|e| e * e)).sqrt(),
        match settings.silog {
            ScaleInvariant::HalfVariance => variance / 2.0,
            ScaleInvariant::HundredDeviation => 100.0 * variance.sqrt(),
        },
    ];
    let row = ScoreRow {
        pixels: pixels.len() as u64,
        truth: all.len() as u64,
        valid: valid_pixels.len() as u64,
        log_mean: Some(log_mean).filter(|mean| !mean.is_nan()),
        ..ScoreRow::new(set, "")
    };
    Family::Depth.defaults().into_iter().zip(scores).fold(row, |row, (metric, score)| row.with(metric, score))
}

fn values(row: &ScoreRow) -> Vec<f64> {
    row.scores.iter().map(|(_, value)| *value).collect()
}

/// Metres with holes; a few values sit exactly on the thresholds' ratios.
fn metres(of: usize) -> impl Strategy<Value = Vec<f32>> {
    let metre = prop_oneof![
        2 => Just(f32::NAN),
        1 => prop_oneof![Just(0.0_f32), Just(1e-3), Just(80.0), Just(10.0), Just(12.5), Just(15.625), Just(19.531_25), Just(-3.0)],
        4 => 0.01_f32..300.0,
    ];
    prop::collection::vec(metre, of)
}

fn frames() -> impl Strategy<Value = (usize, Vec<f32>, Vec<f32>)> {
    (1_usize..40, 1_usize..40)
        .prop_flat_map(|(width, height)| (Just(width), metres(width * height), metres(width * height)))
}

fn settings() -> impl Strategy<Value = Settings> {
    (
        prop::sample::select(Preset::ALL.to_vec()),
        prop::sample::select(vec![Crop::None, Crop::Garg, Crop::Eigen]),
        prop::sample::select(vec![Align::None, Align::Median]),
    )
        .prop_map(|(preset, crop, align)| Settings { crop, align, ..preset.settings() })
}

fn close(ours: f64, theirs: f64) -> bool {
    (ours - theirs).abs() <= 1e-11 * (1.0 + theirs.abs())
}

/// A deviation is a root: where the variance is a rounding error, its root is not small.
fn all_close(ours: &ScoreRow, theirs: &ScoreRow, settings: &Settings) -> bool {
    let mut pairs = values(ours).into_iter().zip(values(theirs)).collect::<Vec<_>>();
    if settings.silog == ScaleInvariant::HundredDeviation
        && let Some((a, b)) = pairs.pop()
    {
        pairs.push(((a / 100.0).powi(2), (b / 100.0).powi(2)));
    }
    pairs.extend(ours.log_mean.zip(theirs.log_mean));
    let counts = |row: &ScoreRow| (row.pixels, row.truth, row.valid, row.scores.len(), row.log_mean.is_some());
    counts(ours) == counts(theirs) && pairs.into_iter().all(|(a, b)| close(a, b))
}

proptest! {
    #[test]
    fn scores_are_those_of_the_naive_twin((width, estimate, truth) in frames(), settings in settings()) {
        // Both skip scaling by a median that is not positive; the twin does not model it.
        let unscaled = Settings { align: Align::None, ..settings };
        let settings = if estimate.iter().any(|y| *y <= 0.0) { unscaled } else { settings };
        let sets = [PixelSet::Valid, PixelSet::All];
        let rows = score(&estimate, &truth, width, truth.len() / width, &sets, &settings);
        for (row, set) in rows.iter().zip(sets) {
            let twin = naive(&estimate, &truth, width, set, &settings);
            prop_assert!(row.set == set && all_close(row, &twin, &settings), "{row:?}\n{twin:?}");
        }
    }

    #[test]
    fn a_perfect_estimate_scores_perfectly((width, truth, _) in frames(), settings in settings()) {
        let row = score(&truth, &truth, width, truth.len() / width, &[PixelSet::All], &settings).remove(0);
        if row.pixels > 0 {
            prop_assert_eq!(values(&row), [1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        }
    }

    #[test]
    fn a_constant_factor_leaves_the_scale_invariant_error_at_zero((width, truth, _) in frames(), factor in 0.5_f32..2.0) {
        let settings = Settings { min_m: 1e-6, max_m: 1e4, ..Settings::default() };
        let estimate: Vec<f32> = truth.iter().map(|t| t * factor).collect();
        let row = score(&estimate, &truth, width, truth.len() / width, &[PixelSet::Valid], &settings).remove(0);
        // f32 products are rounded: the logs differ by 6e-8 at most.
        prop_assert!(row.pixels == 0 || row.score("silog").unwrap() < 1e-13, "{row:?}");
    }

    #[test]
    fn median_scaling_makes_scores_independent_of_a_power_of_two((width, truth, estimate) in frames(), power in -3_i32..4) {
        let settings = Preset::Monodepth2.settings();
        // Without a positive median nothing is aligned, and values below the minimum are clamped.
        let estimate: Vec<f32> = estimate.iter().map(|y| if *y == 0.0 { f32::NAN } else { y.abs() }).collect();
        let scaled: Vec<f32> = estimate.iter().map(|y| y * 2.0_f32.powi(power)).collect();
        let score_of = |y: &[f32]| score(y, &truth, width, truth.len() / width, &[PixelSet::All], &settings).remove(0);
        prop_assert!(all_close(&score_of(&estimate), &score_of(&scaled), &settings));
    }
}
