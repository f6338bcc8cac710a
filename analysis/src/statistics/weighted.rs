//! A data set's value as a function of how often each of its frames counts.

use depthloom_scores::{Mean, Metric, Pooling, ScaleInvariant, ScoreRow, Settings};

/// A score of all frames, of which each may count any number of times: none, as the jackknife leaves one out, or
/// several, as a resample has it.
#[derive(Clone, Debug)]
pub(crate) struct Weighted {
    form: Form,
    /// By frame: what it weighs, and what is summed.
    terms: Vec<[f64; 3]>,
}

/// What becomes of the sums.
#[derive(Clone, Copy, Debug)]
enum Form {
    Mean,
    RootMean,
    /// From the mean square and the square of the mean.
    LogVariance(ScaleInvariant),
}

impl Weighted {
    /// Of frames that all have the score; `None` where a data set's value does not follow from theirs, as a median over
    /// pixels does not.
    pub(crate) fn of<'a>(
        metric: &Metric,
        mean: Mean,
        settings: &Settings,
        rows: impl IntoIterator<Item = &'a ScoreRow>,
    ) -> Option<Self> {
        let form = match (mean, metric.pooling) {
            (Mean::Frames, _) | (Mean::Pixels, Pooling::Mean | Pooling::MeanOfAnswers) => Form::Mean,
            (Mean::Pixels, Pooling::RootMeanSquare) => Form::RootMean,
            (Mean::Pixels, Pooling::LogVariance) => Form::LogVariance(settings.silog),
            (Mean::Pixels, Pooling::None) => return None,
        };
        let term = |row: &ScoreRow| {
            let value = row.get(metric)?;
            let n = metric.pixels(row) as f64;
            Some(match (mean, form) {
                (Mean::Frames, _) => [1.0, value, 0.0],
                (Mean::Pixels, Form::Mean) => [n, n * value, 0.0],
                (Mean::Pixels, Form::RootMean) => [n, n * value * value, 0.0],
                (Mean::Pixels, Form::LogVariance(silog)) => {
                    let variance = match silog {
                        ScaleInvariant::HalfVariance => 2.0 * value,
                        ScaleInvariant::HundredDeviation => (value / 100.0).powi(2),
                    };
                    let mean = row.log_mean?;
                    [n, n * mean, n * (variance + mean * mean)]
                }
            })
        };
        let terms = rows.into_iter().map(term).collect::<Option<Vec<_>>>()?;
        Some(Self { form, terms })
    }

    /// Of those frames that have the score, and how many these are; `None` as of [`Weighted::of`], and where none has
    /// it.
    pub(crate) fn of_those_that_have_it<'a>(
        metric: &Metric,
        mean: Mean,
        settings: &Settings,
        rows: impl IntoIterator<Item = &'a ScoreRow>,
    ) -> Option<(usize, Self)> {
        let rows: Vec<&ScoreRow> = rows.into_iter().filter(|row| row.get(metric).is_some()).collect();
        let weighted = Self::of(metric, mean, settings, rows.iter().copied())?;
        (!rows.is_empty()).then_some((rows.len(), weighted))
    }

    /// The value where frame `i` counts `weights[i]` times.
    pub(crate) fn value(&self, weights: &[f64]) -> f64 {
        let (mut weight, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for ([own, first, second], times) in self.terms.iter().zip(weights) {
            weight += own * times;
            sum += first * times;
            squares += second * times;
        }
        match self.form {
            Form::Mean => sum / weight,
            Form::RootMean => (sum / weight).sqrt(),
            Form::LogVariance(silog) => {
                let mean = sum / weight;
                let variance = (squares / weight - mean * mean).max(0.0);
                match silog {
                    ScaleInvariant::HalfVariance => 0.5 * variance,
                    ScaleInvariant::HundredDeviation => 100.0 * variance.sqrt(),
                }
            }
        }
    }

    /// The value of all frames, each once.
    pub(crate) fn whole(&self) -> f64 {
        self.value(&vec![1.0; self.terms.len()])
    }
}

#[cfg(test)]
mod tests {
    use depthloom_scores::{PixelSet, Preset};

    use super::*;

    /// Frames of 3, 1 and 2 pixels.
    fn rows(settings: &Settings) -> Vec<ScoreRow> {
        let frames: [(&[f32], &[f32]); 3] =
            [(&[11.0, 9.0, 31.0], &[10.0, 10.0, 25.0]), (&[4.0], &[5.0]), (&[70.0, 21.0], &[60.0, 20.0])];
        let score =
            |(y, t): (&[f32], &[f32])| depthloom_scores::score(y, t, t.len(), 1, &[PixelSet::All], settings).remove(0);
        frames.into_iter().map(score).collect()
    }

    #[test]
    fn frames_that_count_once_give_the_tables_value_and_those_that_count_twice_stand_there_twice() {
        for preset in [Preset::Paper, Preset::KittiDepth] {
            let settings = preset.settings();
            let rows = rows(&settings);
            for metric in depthloom_scores::Family::Depth.defaults() {
                let of = |mean| Weighted::of(metric, mean, &settings, &rows).unwrap();
                let near =
                    |a: f64, b: f64| assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()), "{metric:?}: {a}, not {b}");
                let pooled = of(Mean::Pixels);
                near(pooled.whole(), metric.pooled(&rows, &settings).unwrap());
                let again = [&rows[0], &rows[0], &rows[2]];
                near(pooled.value(&[2.0, 0.0, 1.0]), metric.pooled(again, &settings).unwrap());
                let values: Vec<f64> = rows.iter().map(|row| row.get(metric).unwrap()).collect();
                assert_eq!(of(Mean::Frames).whole(), values.iter().sum::<f64>() / 3.0, "to the bit");
                near(of(Mean::Frames).value(&[2.0, 0.0, 1.0]), (2.0 * values[0] + values[2]) / 3.0);
            }
        }
    }

    #[test]
    fn a_median_over_pixels_does_not_follow() {
        let metric = Metric::named("median_error").unwrap();
        let row = ScoreRow { pixels: 3, ..ScoreRow::new(PixelSet::All, "") }.with(metric, 1.0);
        let of = |mean| Weighted::of(metric, mean, &Settings::default(), [&row]);
        assert!(of(Mean::Pixels).is_none());
        assert_eq!(of(Mean::Frames).unwrap().whole(), 1.0);
    }
}
