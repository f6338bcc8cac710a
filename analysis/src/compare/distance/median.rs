//! The median of the errors of a bin, for any weights of its frames.

/// The number of errors between two checkpoints. At each checkpoint the number of earlier errors of each frame is
/// known.
const STEP: usize = 64;

/// Sorted errors with their frames.
#[derive(Clone, Debug)]
pub(super) struct Median {
    /// Sorted, each with its frame.
    errors: Vec<(f32, u32)>,
    /// At every [`STEP`]th error and at the end, the number of earlier errors of each frame.
    before: Vec<u32>,
    frames: usize,
}

impl Median {
    /// Sorts errors, given with their frames.
    pub(super) fn new(mut errors: Vec<(f32, u32)>, frames: usize) -> Self {
        errors.sort_by(|one, two| one.0.total_cmp(&two.0).then(one.1.cmp(&two.1)));
        let mut before = Vec::with_capacity((errors.len() / STEP + 2) * frames);
        let mut counts = vec![0; frames];
        for (at, (_, frame)) in errors.iter().enumerate() {
            if at % STEP == 0 {
                before.extend_from_slice(&counts);
            }
            counts[*frame as usize] += 1;
        }
        before.extend_from_slice(&counts);
        Self { errors, before, frames }
    }

    /// The median for these weights of frames: NumPy's median of all errors, each repeated as often as its frame. NaN
    /// without errors.
    pub(super) fn value(&self, times: &[f64]) -> f64 {
        let places = self.before.len() / self.frames.max(1);
        let all = self.up_to(places - 1, times);
        if all < 1.0 {
            return f64::NAN;
        }
        // Weights are integers, and so are their sums.
        let (below, above) = (((all - 1.0) / 2.0).floor(), (all / 2.0).floor());
        let low = self.at(below, times);
        let high = if above == below { low } else { self.at(above, times) };
        0.5 * (f64::from(low) + f64::from(high))
    }

    /// The number of errors before a checkpoint.
    fn up_to(&self, place: usize, times: &[f64]) -> f64 {
        let counts = &self.before[place * self.frames..][..self.frames];
        counts.iter().zip(times).map(|(count, times)| f64::from(*count) * times).sum()
    }

    /// The error with this rank.
    fn at(&self, rank: f64, times: &[f64]) -> f32 {
        let (mut low, mut high) = (0, self.errors.len().div_ceil(STEP) - 1);
        while low < high {
            let middle = (low + high).div_ceil(2);
            if self.up_to(middle, times) <= rank { low = middle } else { high = middle - 1 }
        }
        let mut before = self.up_to(low, times);
        let rest = &self.errors[low * STEP..];
        for (error, frame) in rest {
            before += times[*frame as usize];
            if before > rank {
                return *error;
            }
        }
        rest.last().map_or(f32::NAN, |(error, _)| *error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_equals_that_of_all_repeated_errors() {
        let errors: Vec<(f32, u32)> = (0..997_u32).map(|i| ((i * 7919 % 613) as f32 * 0.1, i % 5)).collect();
        let median = Median::new(errors.clone(), 5);
        for times in [[1.0; 5], [0.0, 3.0, 1.0, 0.0, 1.0], [5.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 2.0, 1.0]] {
            let mut all: Vec<f64> = Vec::new();
            for (error, frame) in &errors {
                all.extend(std::iter::repeat_n(f64::from(*error), times[*frame as usize] as usize));
            }
            all.sort_by(f64::total_cmp);
            let middle = 0.5 * (all[(all.len() - 1) / 2] + all[all.len() / 2]);
            assert_eq!(median.value(&times), middle, "{times:?}");
        }
        assert!(median.value(&[0.0; 5]).is_nan());
        assert_eq!(Median::new(vec![(3.0, 0)], 1).value(&[1.0]), 3.0);
    }
}
