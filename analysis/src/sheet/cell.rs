//! Tables as they are printed for programs: rows that are JSON objects.

use depthloom_graphs::render::ByName;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Number;

/// A row: column to cell, in the order of the columns. An empty cell is null.
pub type SheetRow = ByName<Option<Cell>>;

/// A cell of a table.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
#[serde(untagged)]
pub enum Cell {
    // Not `f64`, which would print a count with a decimal point.
    Number(#[schemars(with = "f64")] Number),
    Text(String),
}

impl Cell {
    /// A number; `None` where it is NaN or infinite, which JSON cannot express.
    pub(super) fn number(number: f64) -> Option<Self> {
        Number::from_f64(number).map(Self::Number)
    }

    /// A number as it was written.
    pub(super) fn numeral(text: &str) -> Option<Self> {
        match text.parse::<i64>() {
            Ok(whole) => Some(Self::Number(whole.into())),
            Err(_) => text.parse().ok().and_then(Self::number),
        }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Self {
        Self::Number(count.into())
    }
}
