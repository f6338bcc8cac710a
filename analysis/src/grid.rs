//! A table as it is shown, in any format: columns of text and numbers, what they are, and which of their cells are best.

mod latex;
mod markdown;
mod page;
mod terminal;

use depthloom_scores::Metric;
use serde_json::Value as Json;

use crate::sheet::{Cells, Sheet, unit_of};

/// How a table is set, where it is not as usual.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Typesetting {
    /// LaTeX's caption, as LaTeX reads it.
    pub caption: Option<String>,
    /// LaTeX's label behind `tab:`.
    pub label: Option<String>,
    /// How many decimals of scores are shown, and of their intervals.
    pub decimals: Option<usize>,
}

/// A table that can be printed in any format.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Grid {
    /// What the numbers are: a caption, without a full stop.
    pub(crate) about: String,
    /// What tells its LaTeX label from others'.
    pub(crate) label: String,
    /// What LaTeX has as its caption; `None`: what the numbers are, and notes.
    pub(crate) caption: Option<String>,
    pub(crate) columns: Vec<GridColumn>,
    /// The rows before which text leaves a gap.
    pub(crate) gaps: Vec<usize>,
    /// The rows at which text shows columns that say one thing of several rows.
    pub(crate) starts: Vec<usize>,
    /// What is to be said of the numbers.
    pub(crate) notes: Vec<String>,
}

/// A column of a [`Grid`].
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GridColumn {
    /// Its name, as programs read it.
    pub(crate) name: String,
    /// What text calls it, where that is not its name.
    pub(crate) shown: Option<String>,
    /// The unit of its numbers.
    pub(crate) unit: Option<&'static str>,
    /// What papers call it, for LaTeX.
    pub(crate) latex: Option<&'static str>,
    /// Whether more or less of it is better, where that is so.
    pub(crate) more_is_better: Option<bool>,
    pub(crate) cells: GridCells,
    /// Whether it says what a row is: then it stands in each block of a table that is too wide.
    pub(crate) is_key: bool,
    /// Whether text shows it at the [starts](Grid::starts) alone.
    pub(crate) once: bool,
    /// Whether only files have it: what a person sees has it elsewhere.
    pub(crate) only_in_files: bool,
    /// Whether only a person sees it: files have it in other columns.
    pub(crate) only_in_text: bool,
    /// Whether it says more of the column before it: both stay together, in LaTeX in one cell.
    pub(crate) joins: bool,
}

/// The cells of a column, top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum GridCells {
    /// `None`: there is nothing to say, as of an axis that a variant does not have.
    Text(Vec<Option<String>>),
    /// The same where some are numbers, told as the experiment wrote them: programs read numbers.
    Levels(Vec<Option<Level>>),
    Count(Vec<Option<u64>>),
    /// Text shows so many decimals, and marks the best; files have all digits.
    Number {
        decimals: usize,
        values: Vec<Option<f64>>,
        best: Vec<bool>,
    },
    /// Intervals, in square brackets with so many decimals; files have their ends in other columns.
    Interval {
        decimals: usize,
        ends: Vec<Option<(f64, f64)>>,
    },
    /// From 0 to 1; text shows per cent.
    Share(Vec<Option<f64>>),
    /// Numbers that text shows each in its own way; files have all digits.
    Written {
        values: Vec<Option<f64>>,
        texts: Vec<Option<String>>,
    },
}

/// A value of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Level {
    text: String,
    is_number: bool,
}

impl GridColumn {
    /// A column that says what a row is by values of axes; `is_number(row)` says whether all values of the row's axis are numbers.
    pub(crate) fn levels(
        name: impl Into<String>,
        cells: Vec<Option<String>>,
        is_number: impl Fn(usize) -> bool,
    ) -> Self {
        let cells = cells.into_iter().enumerate();
        let levels = cells.map(|(row, text)| text.map(|text| Level { text, is_number: is_number(row) }));
        Self { is_key: true, ..Self::of(name, GridCells::Levels(levels.collect())) }
    }

    /// A column that says what a row is.
    pub(crate) fn key(name: impl Into<String>, cells: Vec<Option<String>>) -> Self {
        Self { is_key: true, ..Self::of(name, GridCells::Text(cells)) }
    }

    /// Any other column.
    pub(crate) fn of(name: impl Into<String>, cells: GridCells) -> Self {
        Self {
            name: name.into(),
            shown: None,
            unit: None,
            latex: None,
            more_is_better: None,
            cells,
            is_key: false,
            once: false,
            only_in_files: false,
            only_in_text: false,
            joins: false,
        }
    }

    /// A column of a score.
    pub(crate) fn score(metric: &Metric, cells: GridCells) -> Self {
        Self {
            unit: Some(unit_of(metric)),
            latex: Some(metric.heading),
            more_is_better: Some(metric.more_is_better),
            ..Self::of(metric.name, cells)
        }
    }

    /// What text calls it.
    fn shown_name(&self) -> &str {
        self.shown.as_deref().unwrap_or(&self.name)
    }

    /// What text puts above it.
    fn heading(&self, up: &str, down: &str) -> String {
        match self.more_is_better {
            None => self.shown_name().to_owned(),
            Some(more) => format!("{} {}", self.shown_name(), if more { up } else { down }),
        }
    }

    fn is_text(&self) -> bool {
        matches!(self.cells, GridCells::Text(_) | GridCells::Levels(_) | GridCells::Interval { .. })
    }
}

impl GridCells {
    fn len(&self) -> usize {
        match self {
            Self::Text(cells) => cells.len(),
            Self::Levels(cells) => cells.len(),
            Self::Count(cells) => cells.len(),
            Self::Number { values, .. } => values.len(),
            Self::Interval { ends, .. } => ends.len(),
            Self::Share(cells) => cells.len(),
            Self::Written { values, .. } => values.len(),
        }
    }

    /// A cell as text shows it.
    pub(crate) fn text(&self, row: usize) -> String {
        let shown = match self {
            Self::Text(cells) => cells[row].clone(),
            Self::Levels(cells) => cells[row].as_ref().map(|level| level.text.clone()),
            Self::Count(cells) => cells[row].map(|count| count.to_string()),
            Self::Number { decimals, values, .. } => values[row].map(|value| format!("{value:.decimals$}")),
            Self::Interval { decimals, ends } => {
                ends[row].map(|(low, high)| format!("[{low:.decimals$}, {high:.decimals$}]"))
            }
            Self::Share(cells) => cells[row].map(|share| format!("{:.1} %", 100.0 * share)),
            Self::Written { texts, .. } => texts[row].clone(),
        };
        shown.unwrap_or_else(|| "-".to_owned())
    }

    fn is_best(&self, row: usize) -> bool {
        matches!(self, Self::Number { best, .. } if best[row])
    }
}

impl Grid {
    /// How many rows it has.
    #[must_use]
    pub fn height(&self) -> usize {
        self.columns.first().map_or(0, |column| column.cells.len())
    }

    /// A cell of a column of text, where there is one.
    pub(crate) fn text_of(&self, name: &str, row: usize) -> Option<String> {
        match &self.columns.iter().find(|column| column.name == name)?.cells {
            GridCells::Text(cells) => cells[row].clone(),
            GridCells::Levels(cells) => cells[row].as_ref().map(|level| level.text.clone()),
            _ => None,
        }
    }

    /// A cell of a column of numbers, where there is one.
    pub(crate) fn number_of(&self, name: &str, row: usize) -> Option<f64> {
        match &self.columns.iter().find(|column| column.name == name)?.cells {
            GridCells::Count(cells) => cells[row].map(|count| count as f64),
            GridCells::Number { values, .. } | GridCells::Written { values, .. } => values[row],
            GridCells::Share(cells) => cells[row],
            GridCells::Text(_) | GridCells::Levels(_) | GridCells::Interval { .. } => None,
        }
    }

    /// Takes a caption, label and decimals that were asked for.
    pub(crate) fn typeset(&mut self, typesetting: &Typesetting) {
        self.caption.clone_from(&typesetting.caption);
        if let Some(label) = &typesetting.label {
            self.label.clone_from(label);
        }
        if let Some(decimals) = typesetting.decimals {
            self.set_decimals(decimals);
        }
    }

    /// Shows so many decimals of scores and their intervals.
    fn set_decimals(&mut self, decimals: usize) {
        for column in self.columns.iter_mut().filter(|column| column.name != "ms") {
            match &mut column.cells {
                GridCells::Number { decimals: of, .. } | GridCells::Interval { decimals: of, .. } => *of = decimals,
                _ => {}
            }
        }
    }

    pub(crate) fn terminal(&self, width: usize) -> String {
        terminal::render(self, width)
    }

    pub(crate) fn markdown(&self) -> String {
        markdown::render(self)
    }

    pub(crate) fn latex(&self) -> String {
        latex::render(self)
    }

    /// As the page of a report reads it.
    pub(crate) fn page(&self) -> Json {
        page::render(self)
    }

    /// As programs read it: all columns.
    pub(crate) fn sheet(&self) -> Sheet<'_> {
        let mut sheet = Sheet::new();
        for column in self.in_files() {
            let cells = match &column.cells {
                GridCells::Text(cells) => Cells::TextIfAny(cells.iter().map(Option::as_deref).collect()),
                GridCells::Levels(cells) if cells.iter().flatten().all(|level| level.is_number) => {
                    Cells::Numeral(cells.iter().map(|cell| cell.as_ref().map(|level| level.text.as_str())).collect())
                }
                GridCells::Levels(cells) => {
                    let levels = cells.iter().map(Option::as_ref);
                    let levels = levels.map(|level| level.map(|level| (level.text.as_str(), level.is_number)));
                    Cells::NumeralOrText(levels.collect())
                }
                GridCells::Count(cells) => Cells::CountIfAny(cells.clone()),
                GridCells::Number { values, .. } => Cells::Number(values.clone()),
                GridCells::Interval { ends, .. } => Cells::Number(ends.iter().map(|of| of.map(|of| of.0)).collect()),
                GridCells::Share(cells) => Cells::Number(cells.clone()),
                GridCells::Written { values, .. } => Cells::Number(values.clone()),
            };
            sheet = sheet.with_unit(column.name.clone(), column.unit, cells);
        }
        sheet
    }

    /// The columns that files have.
    fn in_files(&self) -> impl Iterator<Item = &GridColumn> {
        self.columns.iter().filter(|column| !column.only_in_text)
    }

    /// The columns that text shows.
    fn shown(&self) -> Vec<usize> {
        (0..self.columns.len()).filter(|&column| !self.columns[column].only_in_files).collect()
    }

    /// A cell as text shows it.
    fn text(&self, row: usize, column: usize) -> String {
        let column = &self.columns[column];
        if column.once && !self.starts.contains(&row) { String::new() } else { column.cells.text(row) }
    }

    /// Whether a cell is marked.
    fn is_marked(&self) -> bool {
        self.columns.iter().any(|column| (0..column.cells.len()).any(|row| column.cells.is_best(row)))
    }

    /// The columns that text shows, in blocks no wider than `width`: the keys in each, and as many of the others as fit; `wide(column)`
    /// says how wide one is.
    fn blocks(&self, width: usize, wide: impl Fn(usize) -> usize) -> Vec<Vec<usize>> {
        let (keys, others): (Vec<usize>, Vec<usize>) =
            self.shown().into_iter().partition(|&column| self.columns[column].is_key);
        let of_keys: usize = keys.iter().map(|&column| wide(column)).sum();
        let mut blocks = vec![keys.clone()];
        let mut used = of_keys;
        for together in others.chunk_by(|_, next| self.columns[*next].joins) {
            let of_them: usize = together.iter().map(|&column| wide(column)).sum();
            let last = blocks.last_mut().expect("there is one");
            if used + of_them > width && last.len() > keys.len() {
                blocks.push(keys.clone());
                used = of_keys;
            }
            used += of_them;
            blocks.last_mut().expect("there is one").extend(together);
        }
        blocks
    }
}

#[cfg(test)]
mod tests;
