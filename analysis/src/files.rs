//! Files that are whole or not there.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use polars::frame::DataFrame;
use polars::prelude::{CsvWriter, ParquetWriter, PolarsResult, SerWriter};

use crate::error::AnalysisError;

/// Writes `<name>.partial` in the folder and renames it: under its final name a file is never half written.
pub(crate) fn write(folder: &Path, name: &str, content: &[u8]) -> Result<(), AnalysisError> {
    let (partial, path) = (folder.join(format!("{name}.partial")), folder.join(name));
    fs::write(&partial, content).map_err(AnalysisError::write(&partial))?;
    fs::rename(&partial, &path).map_err(AnalysisError::write(&path))
}

/// Writes a table as CSV; null is an empty cell.
pub(crate) fn write_csv(folder: &Path, name: &str, table: &mut DataFrame) -> Result<(), AnalysisError> {
    write_with(folder, name, |file| CsvWriter::new(file).finish(table))
}

/// Writes a table as Parquet.
pub(crate) fn write_parquet(folder: &Path, name: &str, table: &mut DataFrame) -> Result<(), AnalysisError> {
    write_with(folder, name, |file| ParquetWriter::new(file).finish(table).map(drop))
}

/// Has polars write `<name>.partial` and renames it.
fn write_with(
    folder: &Path,
    name: &str,
    write: impl FnOnce(&mut BufWriter<File>) -> PolarsResult<()>,
) -> Result<(), AnalysisError> {
    let (partial, path) = (folder.join(format!("{name}.partial")), folder.join(name));
    let mut file = BufWriter::new(File::create(&partial).map_err(AnalysisError::write(&partial))?);
    write(&mut file).map_err(AnalysisError::compute(name))?;
    file.flush().map_err(AnalysisError::write(&partial))?;
    fs::rename(&partial, &path).map_err(AnalysisError::write(&path))
}
