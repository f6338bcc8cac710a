//! Samples that no longer fit in memory: a temporary file without a name.
//!
//! It belongs to this process alone and goes with it, however that ends: nobody else's samples get in, and nothing is left. What
//! was written where is remembered here, so that a file that gives back less than was put into it is an error.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::error::AnalysisError;

/// What is called with a metre of true distance and errors there.
pub(super) type Visitor<'a> = dyn FnMut(u32, &[u32]) -> Result<(), AnalysisError> + 'a;

/// Errors read at a time.
const BATCH: usize = 1 << 14;

/// The file, and what stands where in it.
pub(super) struct Spill {
    file: File,
    /// The folder it has no name in: for messages.
    folder: PathBuf,
    end: u64,
    /// By estimator: where its stretches begin and end.
    stretches: Vec<Vec<(u64, u64)>>,
}

impl Spill {
    /// An empty file on the file system of `folder`.
    pub(super) fn new(folder: &Path, estimators: usize) -> Result<Self, AnalysisError> {
        let file = tempfile::tempfile_in(folder).map_err(AnalysisError::write(&temporary(folder)))?;
        Ok(Self { file, folder: folder.to_owned(), end: 0, stretches: vec![Vec::new(); estimators] })
    }

    /// Appends the samples of an estimator, by metre.
    pub(super) fn append(&mut self, estimator: usize, bins: &[Vec<u32>]) -> Result<(), AnalysisError> {
        let length = write(&mut self.file, self.end, bins).map_err(AnalysisError::write(&temporary(&self.folder)))?;
        self.stretches[estimator].push((self.end, self.end + length));
        self.end += length;
        Ok(())
    }

    /// Calls `f(metre, errors)` for all samples of an estimator, a batch at a time.
    pub(super) fn visit(&self, estimator: usize, f: &mut Visitor<'_>) -> Result<(), AnalysisError> {
        let failed = |source: io::Error| AnalysisError::read(&temporary(&self.folder))(source);
        let (mut bytes, mut errors) = (vec![0; 4 * BATCH], Vec::with_capacity(BATCH));
        for &(start, end) in &self.stretches[estimator] {
            let mut file = &self.file;
            file.seek(SeekFrom::Start(start)).map_err(failed)?;
            let mut at = start;
            while at < end {
                let mut head = [0; 8];
                file.read_exact(&mut head).map_err(failed)?;
                let (metre, length) = head.split_at(4);
                let (metre, mut left) = (number(metre), number(length) as usize);
                at += 8 + 4 * left as u64;
                if metre >= super::FARTHEST_M || at > end {
                    return Err(failed(io::Error::other("it does not hold what was written to it")));
                }
                while left > 0 {
                    let batch = left.min(BATCH);
                    let bytes = &mut bytes[..4 * batch];
                    file.read_exact(bytes).map_err(failed)?;
                    errors.clear();
                    errors.extend(bytes.chunks_exact(4).map(number));
                    f(metre, &errors)?;
                    left -= batch;
                }
            }
        }
        Ok(())
    }
}

/// Stretches of one metre, each with its metre and length before it; gives the bytes written.
fn write(file: &mut File, at: u64, bins: &[Vec<u32>]) -> io::Result<u64> {
    file.seek(SeekFrom::Start(at))?;
    let mut file = BufWriter::with_capacity(4 * BATCH, file);
    let mut length = 0;
    for (metre, errors) in bins.iter().enumerate().filter(|(_, errors)| !errors.is_empty()) {
        for number in [metre as u32, errors.len() as u32].iter().chain(errors) {
            file.write_all(&number.to_le_bytes())?;
        }
        length += 8 + 4 * errors.len() as u64;
    }
    file.flush()?;
    Ok(length)
}

fn number(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
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
        spill.append(0, &[vec![10]]).unwrap();
        let all = |estimator| {
            let mut all = Vec::new();
            let visited = spill.visit(estimator, &mut |metre, errors| {
                all.extend(errors.iter().map(|&error| (metre, error)));
                Ok(())
            });
            visited.map(|()| all)
        };
        assert_eq!(all(0).unwrap(), [(0, 7), (0, 8), (2, 9), (0, 10)]);
        assert_eq!(all(1).unwrap(), [(0, 1)]);
        spill.file.set_len(spill.end - 2).unwrap();
        let error = all(0).unwrap_err();
        assert!(matches!(error, AnalysisError::Read { .. }), "{error}");
        assert_eq!(all(1).unwrap(), [(0, 1)], "what is whole can be read");
    }
}
