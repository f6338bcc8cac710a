//! The files of a report: each whole or not there.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

use depthloom_graphs::Key;

use crate::error::AnalysisError;
use crate::tables::{Table, parquet_of_parts};

/// Where a report's files go, and whether it is to go on.
#[derive(Clone, Copy)]
pub(crate) struct Output<'a> {
    pub(crate) folder: &'a Path,
    pub(crate) stop: &'a (dyn Fn() -> bool + Sync),
}

impl Output<'_> {
    /// An error once it is to stop.
    pub(crate) fn go_on(&self) -> Result<(), AnalysisError> {
        if (self.stop)() { Err(AnalysisError::Stopped) } else { Ok(()) }
    }

    /// Writes a file.
    pub(crate) fn write(&self, name: &str, content: &[u8]) -> Result<(), AnalysisError> {
        self.go_on()?;
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
        self.go_on()?;
        let path = self.folder.join(name);
        let written = depthloom_durable::write_with(&path, |file| {
            let mut file = BufWriter::new(file);
            write(&mut file)?;
            file.flush()
        });
        written.map_err(AnalysisError::write(&path))
    }

    /// Writes a table as CSV and as Parquet, of a run whose plan has this key.
    pub(crate) fn write_table(&self, name: &str, run: &Key, table: &Table) -> Result<(), AnalysisError> {
        self.write_table_in_parts(name, run, || std::iter::once(table))
    }

    /// Writes a table as CSV and as Parquet that `parts` makes from top to bottom, one or more; memory holds one of
    /// them at a time.
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
