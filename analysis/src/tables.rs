//! Tables: columns of text and numbers, with one renderer per format.
//!
//! Files (CSV, Parquet, JSON) have all rows and all digits. Text (terminal, Markdown, LaTeX) has the columns that a
//! reader needs, with one line per row or one line per metric.

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

use depthloom_recording::Recording;
use depthloom_scores::Metric;

use crate::titles::Titles;

pub(crate) use column::{Cells, Column, Format, Rows};
pub(crate) use json::JsonRow;
pub use json::TableOutput;
pub use parquet::{TABLE_FORMAT, TABLE_MARK};
pub(crate) use parquet::{file_metadata, parquet_of_parts, with_arrow_schema};
pub(crate) use row_key::key_columns;
pub use row_key::{COMMON, KEY_COLUMNS, Level, RowKey, RowKeys, plan_key, variant_of};

/// The unit of shares and other dimensionless numbers.
pub(crate) const DIMENSIONLESS: &str = "1";

/// The unit of a metric; `1` if it is dimensionless.
pub(crate) const fn unit_of(metric: &Metric) -> &'static str {
    if metric.unit.is_empty() { DIMENSIONLESS } else { metric.unit }
}

/// Caption, label and decimals that replace the defaults.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Typesetting {
    /// The LaTeX caption, inserted verbatim.
    pub caption: Option<String>,
    /// The LaTeX label after `tab:`.
    pub label: Option<String>,
    /// The number of decimals of metrics and their intervals in text.
    pub decimals: Option<usize>,
}

/// The orientation of a table in text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Orientation {
    /// One line per row.
    #[default]
    Rows,
    /// One line per metric, as in Table I of the paper. Two key columns are the headings, one above the other.
    Metrics,
}

/// A table that can be written in any format.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Describes the numbers: a caption, without a full stop.
    pub(crate) about: String,
    /// The LaTeX label, after `tab:`.
    pub(crate) label: String,
    /// The LaTeX label after `tab:` as the user wrote it.
    pub(crate) own_label: Option<String>,
    /// The LaTeX caption; `None`: `description` and notes.
    pub(crate) caption: Option<String>,
    pub(crate) columns: Vec<Column>,
    pub(crate) orientation: Orientation,
    /// Describes marked cells, if it is more than `best`.
    pub(crate) marks: Option<&'static str>,
    /// The rows before which text has a gap.
    pub(crate) gaps: Vec<usize>,
    /// The rows at which text shows columns with one value for several rows.
    pub(crate) starts: Vec<usize>,
    pub(crate) notes: Vec<String>,
    /// Additional metadata of its Parquet file: names and texts.
    pub(crate) metadata: Vec<(&'static str, String)>,
}

impl Table {
    /// A table with these columns and without a caption.
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

    /// Appends notes.
    pub fn add_notes(&mut self, notes: impl IntoIterator<Item = String>) {
        self.notes.extend(notes);
    }

    /// Shows the labels of these recordings instead of the names of estimates, variants and axes. Files keep the names.
    pub fn show_labels(&mut self, recordings: &[Recording]) {
        Titles::new(recordings.iter().map(Recording::plan)).apply(self);
    }

    /// Replaces caption, label and decimals if given.
    pub fn typeset(&mut self, typesetting: &Typesetting) {
        self.caption.clone_from(&typesetting.caption);
        self.own_label.clone_from(&typesetting.label);
        for column in &mut self.columns {
            if let (Some(requested), Some(decimals)) = (typesetting.decimals, column.cells.decimals()) {
                *decimals = requested;
            }
        }
    }

    /// The columns of files.
    fn in_files(&self) -> impl Iterator<Item = &Column> {
        self.columns.iter().filter(|column| !column.only_in_text)
    }

    fn has_marks(&self) -> bool {
        self.columns.iter().any(|column| column.marks.contains(&best::Mark::Best))
    }

    /// Describes marked cells, if any.
    fn marks(&self) -> Option<&'static str> {
        self.has_marks().then(|| self.marks.unwrap_or("best"))
    }
}

#[cfg(test)]
mod tests;
