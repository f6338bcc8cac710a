//! Tables: columns of text and numbers, with one renderer per format.
//!
//! Files (CSV, Parquet, JSON) have all rows below each other, and all digits. Text (terminal, Markdown, LaTeX) has the
//! columns that a reader needs, either oriented in the same way or with a line per column.

pub(crate) mod best;
mod column;
mod csv;
mod json;
mod latex;
mod layout;
mod markdown;
mod page;
mod parquet;
mod row_key;
mod terminal;

use depthloom_scores::Metric;

pub(crate) use column::{Cells, Column, Format, Rows};
pub(crate) use json::JsonRow;
pub use json::TableOutput;
pub use parquet::{TABLE_FORMAT, TABLE_MARK};
pub(crate) use parquet::{file_metadata, parquet_of_parts, with_arrow_schema};
pub(crate) use row_key::key_columns;
pub use row_key::{COMMON, KEY_COLUMNS, Level, RowKey, RowKeys, plan_key, variant_of};

/// The unit of shares and other numbers that have none.
pub(crate) const DIMENSIONLESS: &str = "1";

/// The unit of a metric; of shares and of numbers without one, `1`.
pub(crate) const fn unit_of(metric: &Metric) -> &'static str {
    if metric.unit.is_empty() { DIMENSIONLESS } else { metric.unit }
}

/// Caption, label and decimals that replace the usual ones.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Typesetting {
    /// LaTeX's caption, as LaTeX reads it.
    pub caption: Option<String>,
    /// LaTeX's label behind `tab:`.
    pub label: Option<String>,
    /// How many decimals of metrics and of their intervals text shows.
    pub decimals: Option<usize>,
}

/// Which way text shows a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Orientation {
    /// A line per row.
    #[default]
    Rows,
    /// A line per metric, as in Table I of the paper: the key columns are the headings, two of which stand above each
    /// other.
    Metrics,
}

/// A table that can be written in any format.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// What the numbers are: a caption, without a full stop.
    pub(crate) about: String,
    /// The LaTeX label, behind `tab:`.
    pub(crate) label: String,
    /// The LaTeX caption; `None`: `about` and notes.
    pub(crate) caption: Option<String>,
    pub(crate) columns: Vec<Column>,
    pub(crate) orientation: Orientation,
    /// What marked cells are, where that is more than `best`.
    pub(crate) marks: Option<&'static str>,
    /// The rows before which text leaves a gap.
    pub(crate) gaps: Vec<usize>,
    /// The rows at which text shows columns that have one value for several rows.
    pub(crate) starts: Vec<usize>,
    pub(crate) notes: Vec<String>,
    /// What the metadata of its Parquet file has besides the usual: names and texts.
    pub(crate) metadata: Vec<(&'static str, String)>,
}

impl Table {
    /// A table of columns that only files have.
    pub(crate) fn new(columns: Vec<Column>) -> Self {
        Self { columns, ..Self::default() }
    }

    pub(crate) fn height(&self) -> usize {
        self.columns.first().map_or(0, |column| column.cells.len())
    }

    fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }

    /// The text of a cell; `None` if it is empty or the column is not of texts.
    pub(crate) fn text_of(&self, name: &str, row: usize) -> Option<String> {
        match &self.column(name)?.cells {
            Cells::Text(cells) => cells[row].clone(),
            _ => None,
        }
    }

    /// The number of a cell; `None` if it is empty or the column is not of numbers.
    pub(crate) fn number_of(&self, name: &str, row: usize) -> Option<f64> {
        match &self.column(name)?.cells {
            Cells::Count(cells) => cells[row].map(|count| count as f64),
            Cells::Number(cells, _) => cells[row],
            _ => None,
        }
    }

    /// Replaces caption, label and decimals where others are wanted.
    pub fn typeset(&mut self, typesetting: &Typesetting) {
        self.caption.clone_from(&typesetting.caption);
        if let Some(label) = &typesetting.label {
            self.label.clone_from(label);
        }
        for column in &mut self.columns {
            if let (Some(wanted), Some(decimals)) = (typesetting.decimals, column.cells.decimals()) {
                *decimals = wanted;
            }
        }
    }

    /// The columns of files.
    fn in_files(&self) -> impl Iterator<Item = &Column> {
        self.columns.iter().filter(|column| !column.only_in_text)
    }

    fn has_marks(&self) -> bool {
        self.columns.iter().any(|column| column.best.contains(&true))
    }

    /// What marked cells are, if any cell is.
    fn marks(&self) -> Option<&'static str> {
        self.has_marks().then(|| self.marks.unwrap_or("best"))
    }
}

#[cfg(test)]
mod tests;
