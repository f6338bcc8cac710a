//! Reads samples from a file, one part at a time.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use polars::frame::DataFrame;
use polars::prelude::{ParallelStrategy, ParquetReader, SerReader, StringChunked};

use super::described::{Described, FIXED};
use crate::error::AnalysisError;
use crate::query::FramesOfRun;

/// The name of the metadata in the file.
pub(super) const METADATA: &str = "depthloom.samples";

/// An open samples file.
pub(crate) struct SamplesFile {
    path: PathBuf,
    pub(crate) described: Described,
    pub(crate) parts: Vec<Part>,
    metadata: Metadata,
}

type Metadata = polars::io::prelude::FileMetadataRef;

/// A row group: the pixels of a frame with one scoring.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Part {
    pub(crate) stage: Arc<str>,
    pub(crate) scoring: Arc<str>,
    /// The frame's place in its stage.
    pub(crate) position: u32,
    pub(crate) frame: Arc<str>,
    /// The first row of the part.
    start: usize,
    pub(crate) rows: usize,
}

impl Part {
    /// Whether its frame is selected; `None` selects all frames.
    pub(crate) fn is_selected(&self, frames: Option<&FramesOfRun>) -> bool {
        frames.is_none_or(|frames| frames.contains(&(self.stage.to_string(), self.position, self.frame.to_string())))
    }
}

impl SamplesFile {
    /// Opens a file that [`write_samples`](super::write_samples) wrote.
    ///
    /// # Errors
    /// If it cannot be read, or is not a samples file.
    pub(crate) fn open(path: &Path) -> Result<Self, AnalysisError> {
        let computed = || AnalysisError::compute(format!("the contents of {}", path.display()));
        let file = File::open(path).map_err(AnalysisError::read(path))?;
        let mut reader = ParquetReader::new(file);
        let metadata = reader.get_metadata().map_err(computed())?.clone();
        let of_file = metadata.key_value_metadata().as_ref().and_then(|all| {
            all.iter().find(|entry| entry.key.as_str() == METADATA).and_then(|entry| entry.value.clone())
        });
        let not_samples = || {
            let what = format!("{} is not a samples file of this version", path.display());
            AnalysisError::request(what, "write it again with `depthloom analyse RUN --samples-only`".to_owned())
        };
        let described: Described =
            of_file.and_then(|text| serde_json::from_str(text.as_str()).ok()).ok_or_else(not_samples)?;
        if !described.is_known() {
            return Err(not_samples());
        }
        let lengths: Vec<usize> =
            (0..metadata.row_groups.len()).map(|group| metadata.row_groups[group].num_rows()).collect();
        let mut file = Self { path: path.to_owned(), described, parts: Vec::new(), metadata };
        let mut start = 0;
        for rows in lengths.into_iter().filter(|rows| *rows > 0) {
            // These columns are constant within a part.
            let first = file.slice(&FIXED[..4], start, 1)?;
            let text = |name: &str| -> Result<Arc<str>, AnalysisError> {
                let column: &StringChunked = first.column(name).and_then(|column| column.str()).map_err(computed())?;
                Ok(column.get(0).unwrap_or_default().into())
            };
            let position =
                first.column("position").and_then(|column| column.u32()).map_err(computed())?.get(0).unwrap_or(0);
            let (stage, scoring, frame) = (text("stage")?, text("scoring")?, text("frame")?);
            file.parts.push(Part { stage, scoring, position, frame, start, rows });
            start += rows;
        }
        Ok(file)
    }

    /// Some columns of a part.
    pub(crate) fn read(&self, part: &Part, columns: &[&str]) -> Result<DataFrame, AnalysisError> {
        self.slice(columns, part.start, part.rows)
    }

    fn slice(&self, columns: &[&str], start: usize, rows: usize) -> Result<DataFrame, AnalysisError> {
        let file = File::open(&self.path).map_err(AnalysisError::read(&self.path))?;
        let mut reader = ParquetReader::new(file);
        reader.set_metadata(self.metadata.clone());
        let read = reader
            // Other strategies also decompress all earlier row groups.
            .read_parallel(ParallelStrategy::RowGroups)
            .with_columns(Some(columns.iter().map(|column| (*column).to_owned()).collect()))
            .with_slice(Some((start, rows)))
            .set_rechunk(true)
            .finish()
            .map_err(AnalysisError::compute(format!("rows {start} to {} of {}", start + rows, self.path.display())))?;
        Ok(read)
    }
}
