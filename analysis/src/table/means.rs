//! The means of a table's columns, over frames or over pixels.

use std::collections::HashMap;

use depthloom_scores::{Mean, Metric, PixelSet, ScoreRow};

use crate::estimators::Estimator;
use crate::scores::FrameScore;

/// The means of an estimator on a pixel set.
#[derive(Clone)]
pub(super) struct Means {
    /// How many frames had a pixel to score.
    pub(super) frames: u64,
    pub(super) density: Option<f64>,
    pub(super) means: Vec<Option<f64>>,
}

impl Means {
    /// Where no frame was scored.
    pub(super) fn none(metrics: usize) -> Self {
        Self { frames: 0, density: None, means: vec![None; metrics] }
    }
}

/// The means by estimator and pixel set.
pub(super) fn means(
    rows: &[&FrameScore],
    metrics: &[&'static Metric],
    estimators: &[Estimator],
) -> HashMap<(usize, PixelSet), Means> {
    let mut means = means_over_frames(rows, metrics);
    let mut pooled: HashMap<(usize, PixelSet), Vec<&FrameScore>> = HashMap::new();
    for score in rows.iter().filter(|score| estimators[score.estimator].mean == Mean::Pixels) {
        pooled.entry((score.estimator, score.row.set)).or_default().push(score);
    }
    for (key, of) in &mut means {
        if let Some(own) = pooled.get(key) {
            let settings = estimators[key.0].settings.unwrap_or_default();
            let own = || own.iter();
            let pooled = |metric: &&'static Metric| metric.pooled(own().map(|score| &score.row), &settings);
            of.means = metrics.iter().map(pooled).collect();
            let counts = |count: fn(&ScoreRow) -> u64| own().map(|score| count(&score.row)).sum::<u64>();
            let (answered, truth) = (counts(|row| row.answered), counts(|row| row.truth));
            of.density = (truth > 0).then(|| answered as f64 / truth as f64);
        }
    }
    means
}

/// The unweighted means of the frames' scores.
fn means_over_frames(rows: &[&FrameScore], metrics: &[&'static Metric]) -> HashMap<(usize, PixelSet), Means> {
    /// How many frames had a pixel, and by metric how many had a value, and their sum.
    type Sums = (u64, Vec<(u64, f64)>);
    let mut sums: HashMap<(usize, PixelSet), Sums> = HashMap::new();
    for score in rows {
        let empty = || (0, vec![(0, 0.0); metrics.len() + 1]);
        let (frames, sums) = sums.entry((score.estimator, score.row.set)).or_insert_with(empty);
        *frames += u64::from(score.row.pixels > 0);
        let values = metrics.iter().map(|metric| score.row.get(metric)).chain([score.row.density()]);
        for ((count, sum), value) in sums.iter_mut().zip(values) {
            if let Some(value) = value {
                *count += 1;
                *sum += value;
            }
        }
    }
    let mean = |(count, sum): (u64, f64)| (count > 0).then(|| sum / count as f64);
    let means = |(frames, sums): Sums| {
        let mut means: Vec<Option<f64>> = sums.into_iter().map(mean).collect();
        let density = means.pop().flatten();
        Means { frames, density, means }
    };
    sums.into_iter().map(|(key, sums)| (key, means(sums))).collect()
}
