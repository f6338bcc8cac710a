//! The files of a report: each whole or not there.

use std::io::{BufWriter, Write};
use std::path::Path;

use depthloom_graphs::Key;

use crate::error::AnalysisError;
use crate::sheet::Sheet;

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
    pub(crate) fn write_csv(&self, name: &str, table: &Sheet<'_>) -> Result<(), AnalysisError> {
        self.go_on()?;
        let path = self.folder.join(name);
        let written = depthloom_durable::write_with(&path, |file| {
            let mut file = BufWriter::new(file);
            table.write_csv(&mut file)?;
            file.flush()
        });
        written.map_err(AnalysisError::write(&path))
    }

    /// Writes a table as CSV and as Parquet, of a run whose plan has this key.
    pub(crate) fn write_table<'t>(
        &self,
        name: &str,
        run: &Key,
        table: impl Fn() -> Sheet<'t>,
    ) -> Result<(), AnalysisError> {
        self.write_csv(&format!("{name}.csv"), &table())?;
        let file = format!("{name}.parquet");
        let bytes = table().parquet(name, run).map_err(AnalysisError::compute(&file))?;
        self.write(&file, &bytes)
    }
}
