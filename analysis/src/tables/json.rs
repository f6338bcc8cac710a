//! A table as JSON: rows that are objects, with the columns of its files.

use depthloom_graphs::render::ByName;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Number;

use super::{Cells, Table};

/// A row: column to cell, in the order of the columns. An empty cell is null.
pub(crate) type JsonRow = ByName<Option<Cell>>;

/// A cell of a table.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
#[serde(untagged)]
pub(crate) enum Cell {
    // Not `f64`, which would print a count with a decimal point.
    Number(#[schemars(with = "f64")] Number),
    Text(String),
}

/// The output of `table` and `analyse`.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct TableOutput {
    /// Describes the numbers.
    about: String,
    /// One object per row, with the columns of the CSV form, which docs/tables.md explains.
    rows: Vec<JsonRow>,
    notes: Vec<String>,
}

impl Table {
    /// The JSON output, with the columns of [`Table::csv`].
    #[must_use]
    pub fn output(&self) -> TableOutput {
        TableOutput { about: self.about.clone(), rows: self.json_rows(), notes: self.notes.clone() }
    }

    pub(crate) fn json_rows(&self) -> Vec<JsonRow> {
        (0..self.height()).map(|row| self.json_row(row).collect()).collect()
    }

    /// The cells of a row, each with the name of its column.
    pub(crate) fn json_row(&self, row: usize) -> impl Iterator<Item = (String, Option<Cell>)> {
        self.in_files().map(move |column| (column.name.clone(), cell(&column.cells, row)))
    }
}

fn cell(cells: &Cells, row: usize) -> Option<Cell> {
    match cells {
        Cells::Text(cells) => cells[row].clone().map(Cell::Text),
        Cells::Levels(cells) => match cells[row].as_ref()? {
            level if level.is_number => numeral(&level.text),
            level => Some(Cell::Text(level.text.clone())),
        },
        Cells::Metres(cells) => Some(Cell::Number(cells[row].into())),
        Cells::Count(cells) => cells[row].map(|count| Cell::Number(count.into())),
        // JSON cannot express NaN and infinity.
        Cells::Number(cells, _) => cells[row].and_then(Number::from_f64).map(Cell::Number),
        Cells::Interval(..) => None,
    }
}

/// A number as the experiment writes it.
fn numeral(text: &str) -> Option<Cell> {
    let whole = text.parse::<i64>().ok().map(Number::from);
    whole.or_else(|| text.parse().ok().and_then(Number::from_f64)).map(Cell::Number)
}
