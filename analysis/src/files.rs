//! Writes the files of a report atomically: each is complete or missing.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

use depthloom_graphs::Key;

use crate::error::AnalysisError;
use crate::tables::{Table, parquet_of_parts};

/// The folder of a report, and the stop callback.
#[derive(Clone, Copy)]
pub(crate) struct Output<'a> {
    pub(crate) folder: &'a Path,
    pub(crate) stop: &'a (dyn Fn() -> bool + Sync),
}

impl Output<'_> {
    /// Returns an error once the report must stop.
    pub(crate) fn check_stop(&self) -> Result<(), AnalysisError> {
        if (self.stop)() { Err(AnalysisError::Stopped) } else { Ok(()) }
    }

    /// Writes a file.
    pub(crate) fn write(&self, name: &str, content: &[u8]) -> Result<(), AnalysisError> {
        self.check_stop()?;
        let path = self.folder.join(name);
        depthloom_durable::write(&path, content).map_err(AnalysisError::write(&path))
    }

    /// Writes a table as CSV.
    pub(crate) fn write_csv(&self, name: &str, table: &Table) -> Result<(), AnalysisError> {
        self.write_with(name, |file| table.write_csv(file))
    }

    fn write_with(
        &self,
        name: &str,
        write: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
    ) -> Result<(), AnalysisError> {
        self.check_stop()?;
        let path = self.folder.join(name);
        let written = depthloom_durable::write_with(&path, |file| {
            let mut file = BufWriter::new(file);
            write(&mut file)?;
            file.flush()
        });
        written.map_err(AnalysisError::write(&path))
    }

    /// Writes a table as CSV and as Parquet. `run` is the key of the run's plan.
    pub(crate) fn write_table(&self, name: &str, run: &Key, table: &Table) -> Result<(), AnalysisError> {
        self.write_table_in_parts(name, run, || std::iter::once(table))
    }

    /// Writes a table as CSV and as Parquet. `parts` yields one or more parts from top to bottom; only one part is in
    /// memory at a time.
    pub(crate) fn write_table_in_parts<T: AsRef<Table>, I: Iterator<Item = T>>(
        &self,
        name: &str,
        run: &Key,
        parts: impl Fn() -> I,
    ) -> Result<(), AnalysisError> {
        self.write_with(&format!("{name}.csv"), |file| {
            for (place, part) in parts().enumerate() {
                if place == 0 { part.as_ref().write_csv(file)? } else { part.as_ref().write_csv_rows(file)? }
            }
            Ok(())
        })?;
        let file = format!("{name}.parquet");
        let bytes = parquet_of_parts(parts, name, run).map_err(AnalysisError::compute(&file))?;
        self.write(&file, &bytes)
    }
}
