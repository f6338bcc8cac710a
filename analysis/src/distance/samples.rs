//! Collects samples.

use std::ops::Range;
use std::sync::Mutex;

use depthloom_threads::locked;

use super::metres::Metres;
use super::sample::sample;
use super::spill::Spill;
use super::{DistanceBin, FARTHEST_M, Spread};
use super::{selection, sorting};
use crate::error::AnalysisError;
use crate::files::Output;
use crate::query::{scan, threads};

/// The samples that each core reads back at a time, if that many are allowed in memory at all.
const BY_CORE: usize = 1 << 18;

/// Collects the samples of all estimates, with at most a given number of them in memory.
///
/// A sample takes 4 bytes, or up to 8 while its bin grows. Once there are more than `at_most`, all are moved to a
/// [temporary file](Spill), from which each core reads back some metres at a time, together `at_most` samples or
/// [`BY_CORE`] each. A metre with more samples is [counted](super::selection): exactly, and with memory that depends on
/// neither frames nor pixels. All ways give the same bits.
pub(super) struct Samples<'a> {
    output: Output<'a>,
    /// By estimate and metre of ground-truth distance.
    in_memory: Vec<Vec<Vec<u32>>>,
    /// For each estimate, the number of samples that were too far.
    beyond: Vec<u64>,
    count: usize,
    at_most: usize,
    spill: Option<Spill>,
}

/// The samples of one frame, collected on any thread.
#[derive(Default)]
pub(super) struct FrameSamples(Vec<EstimateSamples>);

/// The samples of an estimate on one frame.
struct EstimateSamples {
    estimate: usize,
    samples: Vec<u32>,
    /// Metres, nearest first, each with the places of its samples.
    metres: Vec<(u32, Range<usize>)>,
    /// The number of samples that were too far.
    beyond: u64,
}

impl FrameSamples {
    /// Adds the valid pixels of an estimate, given their
    /// [errors](depthloom_scores::ScoredPixels::absolute_errors). `shared` states for each scored pixel whether it is
    /// valid in all compared estimates.
    pub(super) fn add(&mut self, estimate: usize, metres: &Metres, errors_m: &[f32], shared: &[bool]) {
        let samples: Vec<u32> =
            errors_m.iter().zip(shared).map(|(error_m, shared)| sample(*error_m, *shared)).collect();
        let (samples, mut metres) = metres.sorted(&samples);
        let too_far = metres.pop_if(|(metre, _)| *metre >= FARTHEST_M);
        let beyond = too_far.map_or(0, |(_, places)| places.len() as u64);
        self.0.push(EstimateSamples { estimate, samples, metres, beyond });
    }
}

impl<'a> Samples<'a> {
    /// Without samples, for this number of estimates; at most `at_most` samples stay in memory.
    pub(super) fn new(estimates: usize, at_most: usize, output: Output<'a>) -> Self {
        Self {
            output,
            in_memory: vec![Vec::new(); estimates],
            beyond: vec![0; estimates],
            count: 0,
            at_most,
            spill: None,
        }
    }

    /// Adds the samples of a frame.
    pub(super) fn take(&mut self, frame: FrameSamples) -> Result<(), AnalysisError> {
        for EstimateSamples { estimate, samples, metres, beyond } in frame.0 {
            let bins = &mut self.in_memory[estimate];
            self.beyond[estimate] += beyond;
            for (metre, places) in metres {
                let metre = metre as usize;
                if metre >= bins.len() {
                    bins.resize_with(metre + 1, Vec::new);
                }
                self.count += places.len();
                bins[metre].extend_from_slice(&samples[places]);
            }
        }
        if self.count > self.at_most { self.spill() } else { Ok(()) }
    }

    /// For each estimate, the number of samples that were excluded because their ground-truth distance is too far.
    pub(super) fn beyond(&self) -> &[u64] {
        &self.beyond
    }

    /// The percentiles, in no order.
    pub(super) fn percentiles(mut self) -> Result<Vec<DistanceBin>, AnalysisError> {
        if self.spill.is_some() {
            self.spill()?;
        }
        let bins = match &self.spill {
            Some(spill) => self.spilled_bins(spill)?,
            None => self.bins_in_memory()?,
        };
        Ok(bins.concat())
    }

    /// The bins of samples in memory, in no order.
    fn bins_in_memory(&mut self) -> Result<Vec<Vec<DistanceBin>>, AnalysisError> {
        let mut metres = Vec::new();
        for (estimate, bins) in self.in_memory.iter_mut().enumerate() {
            metres.extend((0..).zip(std::mem::take(bins)).map(|(metre, bin)| (estimate, metre, Mutex::new(bin))));
        }
        scan(metres.len(), self.output.stop, Vec::new, |bins, metre| {
            let (estimate, bin_m, samples) = &metres[metre];
            bins.extend(bin(*estimate, *bin_m, sorting::spreads(std::mem::take(&mut locked(samples)))));
            Ok(())
        })
    }

    /// The bins of samples in the file, in no order.
    fn spilled_bins(&self, spill: &Spill) -> Result<Vec<Vec<DistanceBin>>, AnalysisError> {
        let fits = (self.at_most / threads()).max(self.at_most.min(BY_CORE)) as u64;
        let parts: Vec<(usize, Range<usize>)> = (0..self.in_memory.len())
            .flat_map(|estimate| together(spill.counts(estimate), fits).map(move |metres| (estimate, metres)))
            .collect();
        scan(parts.len(), self.output.stop, Vec::new, |bins, part| {
            let (estimate, metres) = &parts[part];
            let counts = &spill.counts(*estimate)[metres.clone()];
            if counts.iter().sum::<u64>() > fits {
                let visit = |f: &mut dyn FnMut(&[u32])| {
                    spill.visit(*estimate, metres.clone(), &mut |_, samples| {
                        self.output.check_stop()?;
                        f(samples);
                        Ok(())
                    })
                };
                bins.extend(bin(*estimate, metres.start, selection::spreads(visit)?));
                return Ok(());
            }
            let mut samples: Vec<Vec<u32>> = counts.iter().map(|count| Vec::with_capacity(*count as usize)).collect();
            spill.visit(*estimate, metres.clone(), &mut |metre, read| {
                samples[metre - metres.start].extend_from_slice(read);
                Ok(())
            })?;
            bins.extend(
                metres
                    .clone()
                    .zip(samples)
                    .filter_map(|(metre, samples)| bin(*estimate, metre, sorting::spreads(samples))),
            );
            Ok(())
        })
    }

    /// Appends the samples in memory to the file.
    fn spill(&mut self) -> Result<(), AnalysisError> {
        self.count = 0;
        if self.spill.is_none() {
            self.spill = Some(Spill::new(self.output.folder, self.in_memory.len())?);
        }
        let Some(spill) = &mut self.spill else { return Ok(()) };
        for estimate in 0..self.in_memory.len() {
            // Frees the memory: a bin that was full once would keep its capacity.
            let bins = std::mem::take(&mut self.in_memory[estimate]);
            spill.append(estimate, &bins)?;
        }
        Ok(())
    }
}

/// The bin of these spreads; `None` without samples.
fn bin(estimate: usize, metre: usize, [valid, shared]: [Option<Spread>; 2]) -> Option<DistanceBin> {
    valid.map(|valid| DistanceBin { estimate, bin_m: metre as u32, valid, shared })
}

/// Neighbouring metres of which the samples fit in memory together; a metre that does not fit is alone. Given the
/// number of samples of each metre.
fn together(counts: &[u64], fits: u64) -> impl Iterator<Item = Range<usize>> {
    let mut start = 0;
    std::iter::from_fn(move || {
        let mut sum = 0;
        let more = counts[start..].iter().take_while(|count| {
            sum += **count;
            sum <= fits
        });
        let metres = start..start + more.count().max(1);
        start = metres.end;
        (metres.end <= counts.len()).then_some(metres)
    })
}

#[cfg(test)]
mod tests {
    use depthloom_scores::{ScoredPixels, Settings};
    use proptest::prelude::*;

    use super::*;
    use crate::distance::PERCENTILES;

    /// numpy's `percentile` with its default method.
    fn numpy_percentile(sorted: &[f64], percentile: u32) -> f64 {
        let position = f64::from(percentile) / 100.0 * (sorted.len() - 1) as f64;
        let (below, above) = (position.floor() as usize, position.ceil() as usize);
        sorted[below] + (sorted[above] - sorted[below]) * (position - position.floor())
    }

    /// Frames: ground truth and two estimates.
    type Frames = [(Vec<f32>, [Vec<f32>; 2])];

    fn naive(frames: &Frames, estimate: usize) -> Vec<(u32, Spread, Option<Spread>)> {
        let mut bins: std::collections::BTreeMap<u32, [Vec<f64>; 2]> = std::collections::BTreeMap::new();
        for (truth, estimates) in frames {
            for (pixel, t) in truth.iter().enumerate() {
                let y = estimates[estimate][pixel];
                if *t > 1e-3 && *t < 80.0 && y.is_finite() {
                    let error = (f64::from(y).clamp(1e-3, 80.0) - f64::from(*t)).abs();
                    let [valid, shared] = bins.entry(*t as u32).or_default();
                    valid.push(f64::from(error as f32));
                    if estimates.iter().all(|estimate| estimate[pixel].is_finite()) {
                        shared.push(f64::from(error as f32));
                    }
                }
            }
        }
        let spread = |mut errors: Vec<f64>| {
            errors.sort_by(f64::total_cmp);
            let percentiles_m = || PERCENTILES.map(|p| numpy_percentile(&errors, p));
            (!errors.is_empty()).then(|| Spread { count: errors.len() as u64, percentiles_m: percentiles_m() })
        };
        bins.into_iter().map(|(bin, [valid, shared])| (bin, spread(valid).unwrap(), spread(shared))).collect()
    }

    fn collected(frames: &Frames, at_most: usize) -> Vec<DistanceBin> {
        let folder = tempfile::tempdir().unwrap();
        let settings = Settings::default();
        let mut samples = Samples::new(2, at_most, Output { folder: folder.path(), stop: &|| false });
        for (truth, estimates) in frames {
            let pixels = ScoredPixels::new(truth, truth.len(), 1, &settings);
            let errors = estimates.each_ref().map(|estimate| pixels.absolute_errors(estimate, &settings));
            let shared: Vec<bool> = errors[0].iter().zip(&errors[1]).map(|(a, b)| !a.is_nan() && !b.is_nan()).collect();
            let mut frame = FrameSamples::default();
            for (estimate, errors) in errors.iter().enumerate() {
                frame.add(estimate, &Metres::new(pixels.ground_truth_m()), errors, &shared);
            }
            samples.take(frame).unwrap();
        }
        assert!(at_most == usize::MAX || samples.spill.is_some(), "the bound was not reached");
        let mut bins = samples.percentiles().unwrap();
        bins.sort_unstable_by_key(|bin| (bin.estimate, bin.bin_m));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
        bins
    }

    fn same(ours: &[DistanceBin], frames: &Frames) -> bool {
        let close = |a: &Spread, b: &Spread| {
            let percentiles = a.percentiles_m.iter().zip(&b.percentiles_m);
            a.count == b.count && percentiles.into_iter().all(|(a, b)| (a - b).abs() <= 1e-12 * (1.0 + b))
        };
        (0..2).all(|estimate| {
            let ours: Vec<_> = ours.iter().filter(|bin| bin.estimate == estimate).collect();
            let theirs = naive(frames, estimate);
            ours.len() == theirs.len()
                && ours.iter().zip(&theirs).all(|(bin, (bin_m, valid, shared))| {
                    let same_shared = match (&bin.shared, shared) {
                        (Some(a), Some(b)) => close(a, b),
                        (a, b) => a.is_none() && b.is_none(),
                    };
                    bin.bin_m == *bin_m && close(&bin.valid, valid) && same_shared
                })
        })
    }

    /// Few distances, so that bins are full; some errors are repeated.
    fn frames() -> impl Strategy<Value = Vec<(Vec<f32>, [Vec<f32>; 2])>> {
        let metres = || {
            let metre = prop_oneof![1 => Just(f32::NAN), 1 => Just(10.0_f32), 3 => 0.0_f32..100.0, 6 => 8.0_f32..10.0];
            prop::collection::vec(metre, 60)
        };
        prop::collection::vec((metres(), [metres(), metres()]), 4..20)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn percentiles_equal_numpy_in_memory_and_from_disk(frames in frames()) {
            let in_memory = collected(&frames, usize::MAX);
            prop_assert!(same(&in_memory, &frames), "{in_memory:?}");
            prop_assert_eq!(&collected(&frames, 50), &in_memory, "to the bit");
            prop_assert_eq!(&collected(&frames, 0), &in_memory, "to the bit, all by counting");
        }
    }

    #[test]
    fn percentiles_of_a_few_numbers_equal_numpy() {
        // np.percentile([0.5, 1, 2, 4, 8, 16], [5, 25, 50, 75, 95]), and of the three that are valid in the other
        // estimate
        let valid = Spread { count: 6, percentiles_m: [0.625, 1.25, 3.0, 7.0, 14.0] };
        let shared = Spread { count: 3, percentiles_m: [1.3, 2.5, 4.0, 10.0, 14.799_999_999_999_999] };
        let estimate = [4.0, 0.5, 16.0, 1.0, 8.0, 2.0].map(|error| 30.5 + error).to_vec();
        let other = [1.0, f32::NAN, 1.0, 1.0, f32::INFINITY, f32::NAN].to_vec();
        let frame = (vec![30.5; 6], [estimate, other]);
        for at_most in [usize::MAX, 0] {
            let bins = collected(std::slice::from_ref(&frame), at_most);
            assert_eq!(bins[0], DistanceBin { estimate: 0, bin_m: 30, valid, shared: Some(shared) });
            assert_eq!(bins[1].shared, Some(bins[1].valid), "all its valid pixels are shared");
        }
    }

    #[test]
    fn pixels_that_are_too_far_are_excluded_and_counted() {
        let settings = Settings { max_m: 1e30, ..Settings::default() };
        let truth = [5.0, 1e9, 4095.5, 4096.0];
        let pixels = ScoredPixels::new(&truth, 4, 1, &settings);
        let mut frame = FrameSamples::default();
        frame.add(0, &Metres::new(pixels.ground_truth_m()), &pixels.absolute_errors(&[6.0; 4], &settings), &[true; 4]);
        let mut samples = Samples::new(1, 10, Output { folder: std::path::Path::new("."), stop: &|| false });
        samples.take(frame).unwrap();
        assert_eq!(samples.beyond(), [2]);
        let mut metres: Vec<u32> = samples.percentiles().unwrap().into_iter().map(|bin| bin.bin_m).collect();
        metres.sort_unstable();
        assert_eq!(metres, [5, 4095]);
    }
}
