//! Files that are whole or not there.

use std::fs;
use std::path::Path;

use polars::frame::DataFrame;
use polars::prelude::{CsvWriter, ParquetWriter, SerWriter};

use crate::error::AnalysisError;

/// Writes `<name>.partial` in the folder and renames it: under its final name a file is never half written.
pub(crate) fn write(folder: &Path, name: &str, content: &[u8]) -> Result<(), AnalysisError> {
    let (partial, path) = (folder.join(format!("{name}.partial")), folder.join(name));
    fs::write(&partial, content).map_err(AnalysisError::write(&partial))?;
    fs::rename(&partial, &path).map_err(AnalysisError::write(&path))
}

/// Writes a table as CSV; null is an empty cell.
pub(crate) fn write_csv(folder: &Path, name: &str, table: &mut DataFrame) -> Result<(), AnalysisError> {
    let mut bytes = Vec::new();
    CsvWriter::new(&mut bytes).finish(table).map_err(AnalysisError::compute(name))?;
    write(folder, name, &bytes)
}

/// Writes a table as Parquet.
pub(crate) fn write_parquet(folder: &Path, name: &str, table: &mut DataFrame) -> Result<(), AnalysisError> {
    let mut bytes = Vec::new();
    ParquetWriter::new(&mut bytes).finish(table).map_err(AnalysisError::compute(name))?;
    write(folder, name, &bytes)
}
