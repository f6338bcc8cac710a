//! Samples that no longer fit in memory: a temporary file without a name.
//!
//! It belongs to this process alone and goes with it, however that ends: nobody else's samples get in, and nothing is
//! left. What was written where is remembered here, so that a file that gives back less than was put into it is an
//! error.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::ops::Range;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use crate::error::AnalysisError;

/// What is called with a metre of true distance and samples there.
pub(super) type Visitor<'a> = dyn FnMut(usize, &[u32]) -> Result<(), AnalysisError> + 'a;

/// Samples read at a time.
const BATCH: usize = 1 << 14;

/// The file, and what stands where in it.
pub(super) struct Spill {
    file: File,
    /// The folder it has no name in: for messages.
    folder: PathBuf,
    end: u64,
    by_estimate: Vec<OfEstimate>,
}

/// What the file holds of an estimate.
#[derive(Clone, Default)]
struct OfEstimate {
    stretches: Vec<Stretch>,
    /// By metre: how many samples in all stretches.
    counts: Vec<u64>,
}

/// What was appended at one time: how many samples there are of each metre, then the samples, metre by metre.
#[derive(Clone, Copy)]
struct Stretch {
    start: u64,
    metres: usize,
}

impl Spill {
    /// An empty file on the file system of `folder`.
    pub(super) fn new(folder: &Path, estimates: usize) -> Result<Self, AnalysisError> {
        let file = tempfile::tempfile_in(folder).map_err(AnalysisError::write(&temporary(folder)))?;
        Ok(Self { file, folder: folder.to_owned(), end: 0, by_estimate: vec![OfEstimate::default(); estimates] })
    }

    /// How many samples of an estimate there are, by metre.
    pub(super) fn counts(&self, estimate: usize) -> &[u64] {
        &self.by_estimate[estimate].counts
    }

    /// Appends the samples of an estimate, by metre.
    pub(super) fn append(&mut self, estimate: usize, bins: &[Vec<u32>]) -> Result<(), AnalysisError> {
        let of = &mut self.by_estimate[estimate];
        of.stretches.push(Stretch { start: self.end, metres: bins.len() });
        of.counts.resize(of.counts.len().max(bins.len()), 0);
        of.counts.iter_mut().zip(bins).for_each(|(count, bin)| *count += bin.len() as u64);
        let mut file = BufWriter::with_capacity(4 * BATCH, &self.file);
        let counts: Vec<u32> = bins.iter().map(|bin| bin.len() as u32).collect();
        for numbers in std::iter::once(&counts).chain(bins) {
            let written = file.write_all(bytemuck::cast_slice(numbers));
            written.map_err(AnalysisError::write(&temporary(&self.folder)))?;
            self.end += 4 * numbers.len() as u64;
        }
        file.flush().map_err(AnalysisError::write(&temporary(&self.folder)))
    }

    /// Calls `f(metre, samples)` for all samples of an estimate in some metres, a batch at a time.
    pub(super) fn visit(
        &self,
        estimate: usize,
        metres: Range<usize>,
        f: &mut Visitor<'_>,
    ) -> Result<(), AnalysisError> {
        let failed = |source: io::Error| AnalysisError::read(&temporary(&self.folder))(source);
        let (mut counts, mut samples) = (Vec::new(), vec![0_u32; BATCH]);
        let mut seen = vec![0; metres.len()];
        for stretch in &self.by_estimate[estimate].stretches {
            counts.resize(stretch.metres, 0_u32);
            self.file.read_exact_at(bytemuck::cast_slice_mut(&mut counts), stretch.start).map_err(failed)?;
            let before: u64 = counts.iter().take(metres.start).map(|count| u64::from(*count)).sum();
            let mut at = stretch.start + 4 * (stretch.metres as u64 + before);
            for (metre, &count) in counts.iter().enumerate().take(metres.end).skip(metres.start) {
                seen[metre - metres.start] += u64::from(count);
                let mut left = count as usize;
                while left > 0 {
                    let batch = &mut samples[..left.min(BATCH)];
                    self.file.read_exact_at(bytemuck::cast_slice_mut(batch), at).map_err(failed)?;
                    f(metre, batch)?;
                    left -= batch.len();
                    at += 4 * batch.len() as u64;
                }
            }
        }
        if metres.zip(seen).any(|(metre, seen)| self.counts(estimate).get(metre).is_some_and(|count| *count != seen)) {
            return Err(failed(io::Error::other("it does not hold what was written to it")));
        }
        Ok(())
    }
}

/// What messages call the file.
fn temporary(folder: &Path) -> PathBuf {
    folder.join("(a temporary file for the error against distance)")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_01_a_spill_that_lost_its_end_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let mut spill = Spill::new(folder.path(), 2).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "it has no name");
        spill.append(0, &[vec![7, 8], vec![], vec![9]]).unwrap();
        spill.append(1, &[vec![1]]).unwrap();
        spill.append(0, &[vec![], vec![], vec![10], vec![11]]).unwrap();
        assert_eq!(spill.counts(0), [2, 0, 2, 1]);
        let all = |estimate, metres| {
            let mut all = Vec::new();
            let visited = spill.visit(estimate, metres, &mut |metre, samples| {
                all.extend(samples.iter().map(|&sample| (metre, sample)));
                Ok(())
            });
            visited.map(|()| all)
        };
        assert_eq!(all(0, 0..4).unwrap(), [(0, 7), (0, 8), (2, 9), (2, 10), (3, 11)]);
        assert_eq!(all(0, 1..3).unwrap(), [(2, 9), (2, 10)]);
        assert_eq!(all(1, 0..1).unwrap(), [(0, 1)]);
        spill.file.set_len(spill.end - 2).unwrap();
        let error = all(0, 0..4).unwrap_err();
        assert!(matches!(error, AnalysisError::Read { .. }), "{error}");
        assert_eq!(all(0, 0..3).unwrap().len(), 4, "what is whole can be read");
        // A disk that gives back other bytes.
        spill.file.write_all_at(&[1], 0).unwrap();
        let error = all(0, 0..3).unwrap_err();
        assert!(error.to_string().starts_with("failed to read"), "{error}");
    }
}
