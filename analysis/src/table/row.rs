//! The rows of `table.csv`, for programs.

use schemars::JsonSchema;
use serde::Serialize;

use super::{Table, TableColumn};
use crate::leading::LEADING;
use crate::sheet::SheetRow;

/// A row of `table.csv`: beside these its scores, `density` and the axes of `matrix:`, as docs/tables.md explains.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct TableRow {
    stage: String,
    /// Null where all variants share the row.
    variant: Option<String>,
    estimator: String,
    /// The pixels: `all`, `answered` or `filled`.
    set: &'static str,
    // Keys are in the order of the columns of the file, in which `frames` is between the scores and the paper's numbers.
    #[serde(flatten)]
    axes_and_scores: SheetRow,
    frames: u64,
    #[serde(flatten)]
    paper_and_density: SheetRow,
}

impl Table {
    /// The rows of `table.csv`.
    pub(crate) fn rows(&self) -> Vec<TableRow> {
        let sheet = self.long_form();
        let row = |(place, column): (usize, &TableColumn)| {
            let mut cells = sheet.row(place).skip(LEADING.len());
            TableRow {
                stage: column.lead.stage.clone(),
                variant: column.lead.variant.clone(),
                estimator: column.estimator.clone(),
                set: column.set.name(),
                axes_and_scores: cells.by_ref().take_while(|(name, _)| name != "frames").collect(),
                frames: column.frames,
                paper_and_density: cells.collect(),
            }
        };
        self.columns.iter().enumerate().map(row).collect()
    }
}
