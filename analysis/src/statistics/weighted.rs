//! The value of a data set as a function of the weight of each frame.

use depthloom_scores::{Mean, Metric, Pooling, ScaleInvariant, ScoreRow, Settings};

/// A metric of all frames with weights: 0 for a frame that the jackknife omits, more than 1 for repeated frames of a
/// resample.
#[derive(Clone, Debug)]
pub(crate) struct Weighted {
    form: Form,
    /// For each frame, its weight and two summands.
    terms: Vec<[f64; 3]>,
}

/// The function of the sums.
#[derive(Clone, Copy, Debug)]
enum Form {
    Mean,
    RootMean,
    /// From the mean square and the square of the mean.
    LogVariance(ScaleInvariant),
}

impl Weighted {
    /// For frames that all have the metric. `None` if the value of a data set cannot be computed from the values of
    /// frames, as for a median over pixels.
    pub(crate) fn new<'a>(
        metric: &Metric,
        mean: Mean,
        settings: &Settings,
        rows: impl IntoIterator<Item = &'a ScoreRow>,
    ) -> Option<Self> {
        let form = match (mean, metric.pooling) {
            (Mean::Frames, _) | (Mean::Pixels, Pooling::Mean | Pooling::MeanOfValid) => Form::Mean,
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

    /// For the frames that have the metric, with their number. `None` as for [`Weighted::new`], and if no frame has it.
    pub(crate) fn of_scored_frames<'a>(
        metric: &Metric,
        mean: Mean,
        settings: &Settings,
        rows: impl IntoIterator<Item = &'a ScoreRow>,
    ) -> Option<(usize, Self)> {
        let rows: Vec<&ScoreRow> = rows.into_iter().filter(|row| row.get(metric).is_some()).collect();
        let weighted = Self::new(metric, mean, settings, rows.iter().copied())?;
        (!rows.is_empty()).then_some((rows.len(), weighted))
    }

    /// The value if frame `i` has the weight `weights[i]`.
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

    /// The same data set with groups of frames in place of frames. `groups` has the group of each frame, from 0.
    pub(crate) fn grouped(&self, groups: &[usize]) -> Self {
        let count = groups.iter().max().map_or(0, |last| last + 1);
        let mut terms = vec![[0.0; 3]; count];
        for (term, group) in self.terms.iter().zip(groups) {
            terms[*group].iter_mut().zip(term).for_each(|(sum, part)| *sum += part);
        }
        Self { form: self.form, terms }
    }

    /// The value of each frame, or group, alone.
    pub(crate) fn of_each(&self) -> Vec<f64> {
        let alone = |term: &[f64; 3]| Self { form: self.form, terms: vec![*term] }.of_all_frames();
        self.terms.iter().map(alone).collect()
    }

    /// The value over all frames with weight 1.
    pub(crate) fn of_all_frames(&self) -> f64 {
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
    fn weights_of_one_give_the_value_of_the_table_and_weights_of_two_repeat_frames() {
        for preset in [Preset::Martins2018, Preset::KittiDepth] {
            let settings = preset.settings();
            let rows = rows(&settings);
            for metric in depthloom_scores::Family::Depth.defaults() {
                let weighted = |mean| Weighted::new(metric, mean, &settings, &rows).unwrap();
                let near =
                    |a: f64, b: f64| assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()), "{metric:?}: {a}, not {b}");
                let pooled = weighted(Mean::Pixels);
                near(pooled.of_all_frames(), metric.pooled(&rows, &settings).unwrap());
                let again = [&rows[0], &rows[0], &rows[2]];
                near(pooled.value(&[2.0, 0.0, 1.0]), metric.pooled(again, &settings).unwrap());
                let values: Vec<f64> = rows.iter().map(|row| row.get(metric).unwrap()).collect();
                assert_eq!(weighted(Mean::Frames).of_all_frames(), values.iter().sum::<f64>() / 3.0, "to the bit");
                near(weighted(Mean::Frames).value(&[2.0, 0.0, 1.0]), (2.0 * values[0] + values[2]) / 3.0);
            }
        }
    }

    #[test]
    fn groups_have_the_value_of_their_frames() {
        let settings = Preset::Martins2018.settings();
        let rows = rows(&settings);
        for metric in depthloom_scores::Family::Depth.defaults() {
            for mean in [Mean::Frames, Mean::Pixels] {
                let weighted = Weighted::new(metric, mean, &settings, &rows).unwrap();
                let grouped = weighted.grouped(&[0, 1, 0]);
                let near =
                    |a: f64, b: f64| assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()), "{metric:?}: {a}, not {b}");
                near(grouped.of_all_frames(), weighted.of_all_frames());
                let each = grouped.of_each();
                near(each[0], weighted.value(&[1.0, 0.0, 1.0]));
                near(each[1], weighted.value(&[0.0, 1.0, 0.0]));
            }
        }
    }

    #[test]
    fn a_median_over_pixels_cannot_be_computed_from_frames() {
        let metric = Metric::named("median_error").unwrap();
        let row = ScoreRow { pixels: 3, ..ScoreRow::new(PixelSet::All, "") }.with(metric, 1.0);
        let weighted = |mean| Weighted::new(metric, mean, &Settings::default(), [&row]);
        assert!(weighted(Mean::Pixels).is_none());
        assert_eq!(weighted(Mean::Frames).unwrap().of_all_frames(), 1.0);
    }
}
