//! The samples, as they come in.

use std::fs;
use std::path::{Path, PathBuf};

use depthloom_scores::{ScoredPixels, Settings};
use polars::frame::DataFrame;
use polars::prelude::{Column, NamedFrom, ParquetCompression, ParquetWriter, Series};

use super::keys::key;
use super::{DistanceBin, in_memory, spilled};
use crate::error::AnalysisError;

/// Collects the samples of all estimators, in no more than a given number of them in memory.
///
/// A sample takes 8 bytes. When `at_most` of them are held they are written to Parquet files in a folder beside the results,
/// one a estimator, and the percentiles are later found [by counting over the files](super::spilled): exact, and with memory
/// that depends on neither frames nor pixels. If all fit, polars takes the percentiles of one estimator after the other, in 24
/// bytes a sample of that estimator.
pub(crate) struct Samples {
    held: Vec<Vec<u64>>,
    at_most: usize,
    /// Where samples go that no longer fit; made when needed.
    folder: PathBuf,
    files: Vec<Vec<PathBuf>>,
}

/// The samples of one frame, put together on any thread.
#[derive(Default)]
pub(crate) struct FrameSamples(Vec<(usize, Vec<u64>)>);

impl FrameSamples {
    /// Adds the answered pixels of an estimate.
    pub(crate) fn add(&mut self, estimator: usize, pixels: &ScoredPixels, estimate_m: &[f32], settings: &Settings) {
        let mut keys = Vec::with_capacity(pixels.len());
        pixels.absolute_errors(estimate_m, settings, |truth_m, error_m| keys.push(key(truth_m, error_m)));
        self.0.push((estimator, keys));
    }
}

impl Samples {
    /// Samples of so many estimators, at most `at_most` of them in memory, the rest in files under `folder`.
    pub(crate) fn new(estimators: usize, at_most: usize, folder: &Path) -> Self {
        let folder = folder.join(".error_vs_distance.spill");
        Self { held: vec![Vec::new(); estimators], at_most, folder, files: vec![Vec::new(); estimators] }
    }

    /// Takes the samples of a frame.
    pub(crate) fn take(&mut self, frame: FrameSamples) -> Result<(), AnalysisError> {
        for (estimator, keys) in frame.0 {
            self.held[estimator].extend_from_slice(&keys);
        }
        if self.held.iter().map(Vec::len).sum::<usize>() > self.at_most { self.spill() } else { Ok(()) }
    }

    /// The percentiles, estimator by estimator, nearest bin first.
    pub(crate) fn percentiles(mut self) -> Result<Vec<DistanceBin>, AnalysisError> {
        let spilled = self.files.iter().any(|files| !files.is_empty());
        if spilled {
            self.spill()?;
        }
        let mut bins = Vec::new();
        for estimator in 0..self.held.len() {
            let keys = std::mem::take(&mut self.held[estimator]);
            let files = &self.files[estimator];
            let found = match (files.is_empty(), keys.is_empty()) {
                (false, _) => spilled::percentiles(estimator, files),
                (true, false) => in_memory::percentiles(estimator, &keys),
                (true, true) => continue,
            };
            bins.extend(found.map_err(AnalysisError::compute("percentiles of the error against distance"))?);
        }
        Ok(bins)
    }

    /// Writes what is held to files.
    fn spill(&mut self) -> Result<(), AnalysisError> {
        fs::create_dir_all(&self.folder).map_err(AnalysisError::write(&self.folder))?;
        for (estimator, (keys, files)) in self.held.iter_mut().zip(&mut self.files).enumerate() {
            if keys.is_empty() {
                continue;
            }
            let path = self.folder.join(format!("{estimator}-{}.parquet", files.len()));
            let file = fs::File::create(&path).map_err(AnalysisError::write(&path))?;
            let column = Column::from(Series::new("key".into(), std::mem::take(keys)));
            let written = DataFrame::new(column.len(), vec![column]).and_then(|mut table| {
                ParquetWriter::new(file).with_compression(ParquetCompression::Lz4Raw).finish(&mut table)
            });
            written.map_err(AnalysisError::compute(format!("{}", path.display())))?;
            files.push(path);
        }
        Ok(())
    }
}

impl Drop for Samples {
    fn drop(&mut self) {
        if self.files.iter().any(|files| !files.is_empty()) {
            // Nothing can be done about a folder that stays; its name says what it is.
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::distance::PERCENTILES;

    /// numpy's `percentile` with its default method.
    fn numpy_percentile(sorted: &[f64], percentile: u32) -> f64 {
        let position = f64::from(percentile) / 100.0 * (sorted.len() - 1) as f64;
        let (below, above) = (position.floor() as usize, position.ceil() as usize);
        sorted[below] + (sorted[above] - sorted[below]) * (position - position.floor())
    }

    fn naive(frames: &[(Vec<f32>, Vec<f32>)]) -> Vec<(u32, usize, [f64; 5])> {
        let mut bins: std::collections::BTreeMap<u32, Vec<f64>> = std::collections::BTreeMap::new();
        for (t, y) in frames.iter().flat_map(|(truth, estimate)| truth.iter().zip(estimate)) {
            if *t > 1e-3 && *t < 80.0 && y.is_finite() {
                let error = (f64::from(*y).clamp(1e-3, 80.0) - f64::from(*t)).abs();
                bins.entry(*t as u32).or_default().push(f64::from(error as f32));
            }
        }
        let row = |(bin, mut errors): (u32, Vec<f64>)| {
            errors.sort_by(f64::total_cmp);
            (bin, errors.len(), PERCENTILES.map(|p| numpy_percentile(&errors, p)))
        };
        bins.into_iter().map(row).collect()
    }

    fn collected(frames: &[(Vec<f32>, Vec<f32>)], at_most: usize) -> Vec<(u32, usize, [f64; 5])> {
        let folder = tempfile::tempdir().unwrap();
        let settings = Settings::default();
        let mut samples = Samples::new(1, at_most, folder.path());
        for (truth, estimate) in frames {
            let pixels = ScoredPixels::new(truth, truth.len(), 1, &settings);
            let mut frame = FrameSamples::default();
            frame.add(0, &pixels, estimate, &settings);
            samples.take(frame).unwrap();
        }
        let bins = samples.percentiles().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
        bins.iter().map(|bin| (bin.bin_m, bin.count as usize, bin.percentiles_m)).collect()
    }

    fn same(ours: &[(u32, usize, [f64; 5])], theirs: &[(u32, usize, [f64; 5])]) -> bool {
        let close = |a: &[f64; 5], b: &[f64; 5]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-12 * (1.0 + b));
        ours.len() == theirs.len()
            && ours.iter().zip(theirs).all(|(a, b)| (a.0, a.1) == (b.0, b.1) && close(&a.2, &b.2))
    }

    fn frames() -> impl Strategy<Value = Vec<(Vec<f32>, Vec<f32>)>> {
        let metres = || {
            let metre = prop_oneof![1 => Just(f32::NAN), 1 => Just(10.0_f32), 6 => 0.0_f32..100.0, 3 => 8.0_f32..9.0];
            prop::collection::vec(metre, 60)
        };
        prop::collection::vec((metres(), metres()), 1..12)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn percentiles_are_numpys_in_memory_and_from_disk(frames in frames()) {
            let expected = naive(&frames);
            let in_memory = collected(&frames, usize::MAX);
            prop_assert!(same(&in_memory, &expected), "{in_memory:?}\n{expected:?}");
            let from_disk = collected(&frames, 100);
            prop_assert!(same(&from_disk, &expected), "{from_disk:?}\n{expected:?}");
        }
    }

    #[test]
    fn percentiles_of_a_few_numbers_are_those_numpy_prints() {
        // np.percentile([0.5, 1, 2, 4, 8, 16], [5, 25, 50, 75, 95])
        let expected = [0.625, 1.25, 3.0, 7.0, 14.0];
        let errors = [4.0, 0.5, 16.0, 1.0, 8.0, 2.0];
        let frame = (vec![30.5; 6], errors.iter().map(|e| 30.5 + e).collect());
        for at_most in [usize::MAX, 0] {
            assert_eq!(collected(std::slice::from_ref(&frame), at_most), [(30, 6, expected)]);
        }
    }
}
