//! Compared with SciPy; `tests/fixtures/statistics.py` computed the numbers.

use depthloom_scores::{Mean, Metric, PixelSet, ScoreRow, Settings};
use serde::Deserialize;

use super::*;

#[derive(Deserialize)]
struct Golden {
    cases: Vec<Case>,
    holm: Corrected,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    form: String,
    pixels: Option<Vec<u64>>,
    one: Vec<f64>,
    two: Vec<f64>,
    confidence: Option<f64>,
    resamples: Option<u32>,
    seed: Option<u64>,
    bca: [f64; 2],
    percentile: [f64; 2],
    wilcoxon: f64,
}

#[derive(Deserialize)]
struct Corrected {
    p: Vec<f64>,
    corrected: Vec<f64>,
}

fn golden() -> Golden {
    let path = depthloom_test_needs::workspace().join("tests/fixtures/golden/statistics.json");
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

impl Case {
    /// The scores of frames, with the metric that has the form of the case.
    fn weighted(&self, values: &[f64]) -> Weighted {
        let row = |(frame, &value): (usize, &f64)| {
            let pixels = self.pixels.as_ref().map_or(1, |pixels| pixels[frame]);
            let row = ScoreRow { pixels, ..ScoreRow::new(PixelSet::All, "") };
            match self.form.as_str() {
                "mean" => row.with(Metric::named("abs_rel").unwrap(), value),
                "root mean" => row.with(Metric::named("rmse").unwrap(), value),
                // Half of the variance in each frame, 0.25; frames differ in the mean.
                _ => ScoreRow { log_mean: Some(value), ..row.with(Metric::named("silog").unwrap(), 0.125) },
            }
        };
        let rows: Vec<ScoreRow> = values.iter().enumerate().map(row).collect();
        let mean = if self.pixels.is_some() { Mean::Pixels } else { Mean::Frames };
        Weighted::new(rows[0].scores[0].0, mean, &Settings::default(), &rows).unwrap()
    }
}

fn near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= 1e-9 * expected.abs() + 1e-12, "{what}: {found} is not {expected}");
}

#[test]
fn intervals_equal_scipy_on_the_same_resamples() {
    for case in golden().cases {
        let (one, two) = (case.weighted(&case.one), case.weighted(&case.two));
        let number = |times: &[f64]| two.value(times) - one.value(times);
        for (method, expected) in [(IntervalMethod::Bca, case.bca), (IntervalMethod::Percentile, case.percentile)] {
            let all = Resampling::default();
            let resampling = Resampling {
                resamples: case.resamples.unwrap_or(10_000),
                seed: case.seed.unwrap_or(all.seed),
                confidence: case.confidence.unwrap_or(all.confidence),
                method,
            };
            let found = resampling.intervals(case.one.len(), &[&number], &|| false).unwrap();
            let found = found[0].unwrap_or_else(|| panic!("{} has an interval", case.name));
            let what = format!("{} of {}", method.name(), case.name);
            near(found.low, expected[0], &what);
            near(found.high, expected[1], &what);
        }
    }
}

/// SciPy 1.17, of eleven skewed frames with three seeds: `bootstrap((x,), np.mean, n_resamples=1_000_000,
/// method="BCa")` is 0.10173 to 0.19255. Of 10,000 resamples its upper end is from 0.1900 to 0.1946 with five seeds.
#[test]
fn seeds_do_not_move_the_ends_of_an_interval() {
    let frames = [0.081, 0.093, 0.102, 0.117, 0.095, 0.21, 0.088, 0.31, 0.104, 0.099, 0.126];
    let mean = |times: &[f64]| frames.iter().zip(times).map(|(frame, times)| frame * times).sum::<f64>() / 11.0;
    for seed in 1..=5 {
        let resampling = Resampling { seed, ..Resampling::default() };
        let Some(Interval { low, high }) = resampling.intervals(11, &[&mean], &|| false).unwrap()[0] else { panic!() };
        assert!((low - 0.10173).abs() < 2e-4 && (high - 0.19255).abs() < 1.5e-3, "{seed}: {low} {high}");
    }
}

#[test]
fn tests_equal_scipy() {
    for case in golden().cases {
        let differences: Vec<f64> = case.one.iter().zip(&case.two).map(|(one, two)| two - one).collect();
        near(SignedRank::test(&differences).unwrap().p, case.wilcoxon, &case.name);
    }
    let Corrected { p, corrected } = golden().holm;
    holm(&p).into_iter().zip(corrected).for_each(|(found, expected)| near(found, expected, "holm"));
}

#[test]
fn constants_have_intervals_of_zero_width_and_single_frames_have_none() {
    let same = |_: &[f64]| 0.25;
    let interval = |frames| Resampling::default().intervals(frames, &[&same], &|| false).unwrap()[0];
    assert_eq!((interval(5), interval(1)), (Some(Interval { low: 0.25, high: 0.25 }), None));
    let stopped = Resampling::default().intervals(5, &[&same], &|| true);
    assert!(matches!(stopped, Err(crate::AnalysisError::Stopped)));
}
