//! Samples that do not fit in memory: an unnamed temporary file.
//!
//! The file belongs to this process only, and the system removes it when the process ends for any reason. The positions
//! of all writes are kept in memory, so that a file that returns fewer samples than were written is an error.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::ops::Range;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use crate::error::AnalysisError;

/// A callback for a metre of ground-truth distance and samples in it.
pub(super) type Visitor<'a> = dyn FnMut(usize, &[u32]) -> Result<(), AnalysisError> + 'a;

/// The number of samples per read.
const BATCH: usize = 1 << 14;

/// The file and an index of its contents.
pub(super) struct Spill {
    file: File,
    /// The folder of the file, for messages.
    folder: PathBuf,
    end: u64,
    by_estimate: Vec<SpilledEstimate>,
}

/// The index of an estimate's samples in the file.
#[derive(Clone, Default)]
struct SpilledEstimate {
    stretches: Vec<Stretch>,
    /// The number of samples of each metre in all stretches.
    counts: Vec<u64>,
}

/// One append: the number of samples of each metre, then the samples, metre by metre.
#[derive(Clone, Copy)]
struct Stretch {
    start: u64,
    metres: usize,
}

impl Spill {
    /// An empty file on the file system of `folder`.
    pub(super) fn new(folder: &Path, estimates: usize) -> Result<Self, AnalysisError> {
        let file = tempfile::tempfile_in(folder).map_err(AnalysisError::write(&temporary(folder)))?;
        Ok(Self { file, folder: folder.to_owned(), end: 0, by_estimate: vec![SpilledEstimate::default(); estimates] })
    }

    /// The number of samples of an estimate by metre.
    pub(super) fn counts(&self, estimate: usize) -> &[u64] {
        &self.by_estimate[estimate].counts
    }

    /// Appends the samples of an estimate, by metre.
    pub(super) fn append(&mut self, estimate: usize, bins: &[Vec<u32>]) -> Result<(), AnalysisError> {
        let index = &mut self.by_estimate[estimate];
        index.stretches.push(Stretch { start: self.end, metres: bins.len() });
        index.counts.resize(index.counts.len().max(bins.len()), 0);
        index.counts.iter_mut().zip(bins).for_each(|(count, bin)| *count += bin.len() as u64);
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
            let wanted = || counts.iter().enumerate().take(metres.end).skip(metres.start);
            let mut unread: usize = wanted().map(|(_, count)| *count as usize).sum();
            // The samples of neighbouring metres follow each other, and are read together.
            let mut batch = 0..0;
            for (metre, &count) in wanted() {
                seen[metre - metres.start] += u64::from(count);
                let mut remaining = count as usize;
                while remaining > 0 {
                    if batch.is_empty() {
                        batch = 0..unread.min(BATCH);
                        let read = &mut samples[batch.clone()];
                        self.file.read_exact_at(bytemuck::cast_slice_mut(read), at).map_err(failed)?;
                        unread -= batch.len();
                        at += 4 * batch.len() as u64;
                    }
                    let of_metre = batch.start..batch.end.min(batch.start + remaining);
                    f(metre, &samples[of_metre.clone()])?;
                    remaining -= of_metre.len();
                    batch.start = of_metre.end;
                }
            }
        }
        if metres.zip(seen).any(|(metre, seen)| self.counts(estimate).get(metre).is_some_and(|count| *count != seen)) {
            return Err(failed(io::Error::other("the file does not contain the data that was written to it")));
        }
        Ok(())
    }
}

/// The name of the file in messages.
fn temporary(folder: &Path) -> PathBuf {
    folder.join("(a temporary file for the error against distance)")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_01_a_truncated_spill_is_an_error() {
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
        assert_eq!(all(0, 0..3).unwrap().len(), 4, "complete stretches can be read");
        // A disk that returns other bytes.
        spill.file.write_all_at(&[1], 0).unwrap();
        let error = all(0, 0..3).unwrap_err();
        assert!(error.to_string().starts_with("failed to read"), "{error}");
    }
}
