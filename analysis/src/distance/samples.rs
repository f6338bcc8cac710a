//! The samples, as they come in.

use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use depthloom_scores::{ScoredPixels, Settings};

use super::{DistanceBin, in_memory, selection};
use crate::error::AnalysisError;

/// Errors read from a file at a time.
const BATCH: usize = 1 << 14;

/// An error of zero or more as an integer that sorts as it does; f32 holds it to 6e-8 of itself, 5 micrometres at 80 m.
pub(super) const fn bits_from_error(error_m: f64) -> u32 {
    (error_m as f32).to_bits()
}

/// The error of [`bits_from_error`], metres.
pub(super) const fn error_from_bits(bits: u32) -> f32 {
    f32::from_bits(bits)
}

/// Collects the samples of all estimators, with no more than a given number of them in memory.
///
/// A sample takes 4 bytes, 8 at worst while its bin grows. When more than `at_most` are held, all go to files in a folder
/// beside the results, one an estimator, and the percentiles are later found [by counting](super::selection): exact, and with
/// memory that depends on neither frames nor pixels. If all fit, [polars takes the percentiles](super::in_memory).
pub(crate) struct Samples {
    /// By estimator and metre of true distance: the errors' bits.
    held: Vec<Vec<Vec<u32>>>,
    count: usize,
    at_most: usize,
    /// Where samples go that no longer fit; made when needed.
    folder: PathBuf,
    spilled: bool,
}

/// The samples of one frame, put together on any thread: by estimator, metre and error.
#[derive(Default)]
pub(crate) struct FrameSamples(Vec<(usize, Vec<(u32, u32)>)>);

impl FrameSamples {
    /// Adds the answered pixels of an estimate.
    pub(crate) fn add(&mut self, estimator: usize, pixels: &ScoredPixels, estimate_m: &[f32], settings: &Settings) {
        let mut samples = Vec::with_capacity(pixels.len());
        let add = |truth_m: f32, error_m| samples.push((truth_m as u32, bits_from_error(error_m)));
        pixels.absolute_errors(estimate_m, settings, add);
        self.0.push((estimator, samples));
    }
}

impl Samples {
    /// Samples of so many estimators, at most `at_most` of them in memory, the rest in files under `folder`.
    pub(crate) fn new(estimators: usize, at_most: usize, folder: &Path) -> Self {
        let folder = folder.join(".error_vs_distance.spill");
        Self { held: vec![Vec::new(); estimators], count: 0, at_most, folder, spilled: false }
    }

    /// Takes the samples of a frame.
    pub(crate) fn take(&mut self, frame: FrameSamples) -> Result<(), AnalysisError> {
        for (estimator, samples) in frame.0 {
            let bins = &mut self.held[estimator];
            self.count += samples.len();
            for (metre, bits) in samples {
                let metre = metre as usize;
                if metre >= bins.len() {
                    bins.resize_with(metre + 1, Vec::new);
                }
                bins[metre].push(bits);
            }
        }
        if self.count > self.at_most { self.spill() } else { Ok(()) }
    }

    /// The percentiles, estimator by estimator, nearest bin first.
    pub(crate) fn percentiles(mut self) -> Result<Vec<DistanceBin>, AnalysisError> {
        if self.spilled {
            self.spill()?;
        }
        let mut bins = Vec::new();
        for estimator in 0..self.held.len() {
            if self.spilled {
                let path = self.file(estimator);
                let visit = |f: &mut dyn FnMut(u32, &[u32])| read(&path, f);
                bins.extend(selection::percentiles(estimator, visit).map_err(AnalysisError::read(&path))?);
            } else {
                let held = std::mem::take(&mut self.held[estimator]);
                let found = in_memory::percentiles(estimator, &held);
                bins.extend(found.map_err(AnalysisError::compute("percentiles of the error against distance"))?);
            }
        }
        Ok(bins)
    }

    fn file(&self, estimator: usize) -> PathBuf {
        self.folder.join(estimator.to_string())
    }

    /// Appends what is held to the files: stretches of one metre, each with its metre and length before it.
    fn spill(&mut self) -> Result<(), AnalysisError> {
        fs::create_dir_all(&self.folder).map_err(AnalysisError::write(&self.folder))?;
        self.spilled = true;
        self.count = 0;
        for estimator in 0..self.held.len() {
            let path = self.file(estimator);
            // What is held is freed: a bin that once was full would keep its room for ever.
            let bins = std::mem::take(&mut self.held[estimator]);
            append(&path, &bins).map_err(AnalysisError::write(&path))?;
        }
        Ok(())
    }
}

fn append(path: &Path, bins: &[Vec<u32>]) -> io::Result<()> {
    let mut file = BufWriter::new(File::options().create(true).append(true).open(path)?);
    for (metre, errors) in bins.iter().enumerate().filter(|(_, errors)| !errors.is_empty()) {
        for number in [metre as u32, errors.len() as u32].iter().chain(errors) {
            file.write_all(&number.to_le_bytes())?;
        }
    }
    file.flush()
}

/// Calls `f(metre, errors)` for all that was appended to a file, a batch at a time.
fn read(path: &Path, f: &mut dyn FnMut(u32, &[u32])) -> io::Result<()> {
    let mut file = BufReader::with_capacity(4 * BATCH, File::open(path)?);
    let (mut bytes, mut errors) = (vec![0; 4 * BATCH], Vec::with_capacity(BATCH));
    loop {
        let mut head = [0; 8];
        match file.read_exact(&mut head) {
            Err(end) if end.kind() == ErrorKind::UnexpectedEof => return Ok(()),
            other => other?,
        }
        let (metre, length) = head.split_at(4);
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte));
        let (metre, mut left) = (number(metre), number(length) as usize);
        while left > 0 {
            let batch = left.min(BATCH);
            let bytes = &mut bytes[..4 * batch];
            file.read_exact(bytes)?;
            errors.clear();
            errors.extend(bytes.chunks_exact(4).map(number));
            f(metre, &errors);
            left -= batch;
        }
    }
}

impl Drop for Samples {
    fn drop(&mut self) {
        if self.spilled {
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

    type Frames = [(Vec<f32>, Vec<f32>)];
    type Bin = (u32, u64, [f64; 5]);
    type Bins = Vec<Bin>;

    fn naive(frames: &Frames) -> Bins {
        let mut bins: std::collections::BTreeMap<u32, Vec<f64>> = std::collections::BTreeMap::new();
        for (t, y) in frames.iter().flat_map(|(truth, estimate)| truth.iter().zip(estimate)) {
            if *t > 1e-3 && *t < 80.0 && y.is_finite() {
                let error = (f64::from(*y).clamp(1e-3, 80.0) - f64::from(*t)).abs();
                bins.entry(*t as u32).or_default().push(f64::from(error as f32));
            }
        }
        let row = |(bin, mut errors): (u32, Vec<f64>)| {
            errors.sort_by(f64::total_cmp);
            (bin, errors.len() as u64, PERCENTILES.map(|p| numpy_percentile(&errors, p)))
        };
        bins.into_iter().map(row).collect()
    }

    fn collected(frames: &Frames, at_most: usize) -> Bins {
        let folder = tempfile::tempdir().unwrap();
        let settings = Settings::default();
        let mut samples = Samples::new(1, at_most, folder.path());
        for (truth, estimate) in frames {
            let pixels = ScoredPixels::new(truth, truth.len(), 1, &settings);
            let mut frame = FrameSamples::default();
            frame.add(0, &pixels, estimate, &settings);
            samples.take(frame).unwrap();
        }
        assert!(at_most == usize::MAX || samples.spilled, "the bound was not reached");
        let bins = samples.percentiles().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
        bins.iter().map(|bin| (bin.bin_m, bin.count, bin.percentiles_m)).collect()
    }

    fn same(ours: &Bins, theirs: &Bins) -> bool {
        let close = |a: &[f64; 5], b: &[f64; 5]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-12 * (1.0 + b));
        let same_bin = |(a, b): (&Bin, &Bin)| (a.0, a.1) == (b.0, b.1) && close(&a.2, &b.2);
        ours.len() == theirs.len() && ours.iter().zip(theirs).all(same_bin)
    }

    /// Few distances, so that bins are full; some errors many times over.
    fn frames() -> impl Strategy<Value = Vec<(Vec<f32>, Vec<f32>)>> {
        let metres = || {
            let metre = prop_oneof![1 => Just(f32::NAN), 1 => Just(10.0_f32), 3 => 0.0_f32..100.0, 6 => 8.0_f32..10.0];
            prop::collection::vec(metre, 60)
        };
        prop::collection::vec((metres(), metres()), 4..20)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn percentiles_are_numpys_in_memory_and_from_disk(frames in frames()) {
            let expected = naive(&frames);
            let in_memory = collected(&frames, usize::MAX);
            prop_assert!(same(&in_memory, &expected), "{in_memory:?}\n{expected:?}");
            let from_disk = collected(&frames, 50);
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

    #[test]
    fn bits_sort_as_errors_do() {
        let errors = [0.0, 1e-9, 1e-6, 0.25, 0.250_001, 3.0, 79.9];
        let bits = errors.map(bits_from_error);
        assert!(bits.is_sorted());
        assert_eq!(bits.map(error_from_bits), errors.map(|e| e as f32));
    }
}
