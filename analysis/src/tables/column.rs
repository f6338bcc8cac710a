//! A column of a table, and its cells.

use std::borrow::Cow;

use depthloom_scores::Metric;

use super::unit_of;
use crate::statistics::Interval;
use crate::tables::best::Mark;

/// A column of a [`Table`](super::Table).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Column {
    /// Its name in files.
    pub(crate) name: String,
    /// Its name in text, if different.
    pub(crate) shown: Option<String>,
    pub(crate) unit: Option<&'static str>,
    /// Its published name in LaTeX, if any.
    pub(crate) latex: Option<Cow<'static, str>>,
    pub(crate) more_is_better: Option<bool>,
    pub(crate) cells: Cells,
    /// What text shows instead of the cells, if the experiment has labels.
    pub(crate) titles: Option<Vec<Option<String>>>,
    /// Whether each cell is marked; empty: none.
    pub(crate) marks: Vec<Mark>,
    /// Whether it is repeated in each block of a table that is too wide.
    pub(crate) is_key: bool,
    /// Whether text shows it only at the [starts](super::Table::starts).
    pub(crate) once: bool,
    pub(crate) only_in_files: bool,
    pub(crate) only_in_text: bool,
    /// Whether it is an axis of the experiment.
    pub(crate) is_axis: bool,
    /// Whether it belongs to the column before it: both stay together, in LaTeX in one cell.
    pub(crate) joins: bool,
}

/// The cells of a column, top to bottom; `None` is an empty cell.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Cells {
    Text(Vec<Option<String>>),
    /// Values of an axis as the experiment writes them.
    Levels(Vec<Option<Value>>),
    /// Metres of distance.
    Metres(Vec<u32>),
    Count(Vec<Option<u64>>),
    Number(Vec<Option<f64>>, Format),
    /// Intervals with this number of decimals, only for text; files have columns for both ends.
    Interval(Vec<Option<Interval>>, usize),
}

/// A value of an axis. It is a number if all values of the axis are numbers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Value {
    pub(super) text: String,
    pub(super) is_number: bool,
}

/// The format of numbers in text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Format {
    /// This number of decimals, unless the user chooses another.
    Decimals(usize),
    /// Always this number of decimals.
    Fixed(usize),
    Percent,
    /// Individual texts.
    Written(Vec<Option<String>>),
}

/// Converts a value to a cell of text.
pub(crate) trait TextCell {
    fn text(self) -> Option<String>;
}

impl TextCell for &str {
    fn text(self) -> Option<String> {
        Some(self.to_owned())
    }
}

impl TextCell for &String {
    fn text(self) -> Option<String> {
        Some(self.clone())
    }
}

impl TextCell for String {
    fn text(self) -> Option<String> {
        Some(self)
    }
}

impl<T: TextCell> TextCell for Option<T> {
    fn text(self) -> Option<String> {
        self.and_then(T::text)
    }
}

/// The source of rows of a table: a column extracts one cell from each.
pub(crate) struct Rows<'r, R>(pub(crate) &'r [R]);

impl<'r, R> Rows<'r, R> {
    pub(crate) fn text<T: TextCell>(&self, name: impl Into<String>, cell: impl Fn(&'r R) -> T) -> Column {
        Column::new(name, Cells::Text(self.0.iter().map(|row| cell(row).text()).collect()))
    }

    /// A column that identifies rows.
    pub(crate) fn key<T: TextCell>(&self, name: impl Into<String>, cell: impl Fn(&'r R) -> T) -> Column {
        self.text(name, cell).key()
    }

    pub(crate) fn count<C: Into<Option<u64>>>(&self, name: impl Into<String>, cell: impl Fn(&'r R) -> C) -> Column {
        Column::new(name, Cells::Count(self.0.iter().map(|row| cell(row).into()).collect()))
    }

    pub(crate) fn number<C: Into<Option<f64>>>(&self, name: impl Into<String>, cell: impl Fn(&'r R) -> C) -> Column {
        Column::new(name, Cells::Number(self.0.iter().map(|row| cell(row).into()).collect(), Format::Decimals(3)))
    }

    /// A column of a metric, with one more decimal than usual, because differences between variants are small.
    pub(crate) fn metric(&self, metric: &Metric, cell: impl Fn(&'r R) -> Option<f64>) -> Column {
        self.number(metric.name, cell).metric(metric)
    }

    /// A column of shares from 0 to 1, shown in per cent in text.
    pub(crate) fn share(&self, name: impl Into<String>, cell: impl Fn(&'r R) -> Option<f64>) -> Column {
        self.number(name, cell).format(Format::Percent)
    }

    /// A column of numbers with individual texts.
    pub(crate) fn written(&self, name: impl Into<String>, cell: impl Fn(&'r R) -> Option<(f64, String)>) -> Column {
        let (values, texts) = self.0.iter().map(cell).map(Option::unzip).unzip();
        Column::new(name, Cells::Number(values, Format::Written(texts)))
    }
}

impl Column {
    pub(crate) fn new(name: impl Into<String>, cells: Cells) -> Self {
        Self {
            name: name.into(),
            shown: None,
            unit: None,
            latex: None,
            more_is_better: None,
            cells,
            titles: None,
            marks: Vec::new(),
            is_key: false,
            is_axis: false,
            once: false,
            only_in_files: false,
            only_in_text: false,
            joins: false,
        }
    }

    /// A column that identifies rows by values of axes. `is_number(row)` states whether all values of the row's axis
    /// are numbers.
    pub(crate) fn levels(
        name: impl Into<String>,
        cells: impl IntoIterator<Item = Option<String>>,
        is_number: impl Fn(usize) -> bool,
    ) -> Self {
        let cells = cells.into_iter().enumerate();
        let level = |(row, text): (usize, Option<String>)| text.map(|text| Value { text, is_number: is_number(row) });
        Self::new(name, Cells::Levels(cells.map(level).collect())).key()
    }

    pub(crate) fn unit(self, unit: &'static str) -> Self {
        Self { unit: Some(unit), ..self }
    }

    pub(crate) fn latex(self, name: impl Into<Cow<'static, str>>) -> Self {
        Self { latex: Some(name.into()), ..self }
    }

    pub(crate) fn key(self) -> Self {
        Self { is_key: true, ..self }
    }

    pub(crate) fn axis(self) -> Self {
        Self { is_axis: true, ..self }
    }

    pub(crate) fn once(self) -> Self {
        Self { once: true, ..self }
    }

    pub(crate) fn joins(self) -> Self {
        Self { joins: true, ..self }
    }

    pub(crate) fn in_files(self) -> Self {
        Self { only_in_files: true, ..self }
    }

    pub(crate) fn in_text(self) -> Self {
        Self { only_in_text: true, ..self }
    }

    pub(crate) fn better(self, more_is_better: bool) -> Self {
        Self { more_is_better: Some(more_is_better), ..self }
    }

    pub(crate) fn marked(self, marks: Vec<Mark>) -> Self {
        Self { marks, ..self }
    }

    /// Names and formats a column of numbers of a metric.
    pub(crate) fn metric(self, metric: &Metric) -> Self {
        // Nearer to a nominal value is better: neither more nor less.
        let more_is_better = metric.nominal.is_none().then_some(metric.more_is_better);
        Self { latex: Some(metric.heading.into()), more_is_better, ..self.unit(unit_of(metric)) }
            .decimals(metric.decimals + 1)
    }

    pub(crate) fn decimals(self, decimals: usize) -> Self {
        self.format(Format::Decimals(decimals))
    }

    /// Sets the format of a column of numbers.
    pub(crate) fn format(mut self, format: Format) -> Self {
        if let Cells::Number(_, own) = &mut self.cells {
            *own = format;
        }
        self
    }

    /// A cell in text, as readers see it.
    pub(super) fn text(&self, row: usize) -> Option<String> {
        self.titles.as_ref().map_or_else(|| self.cells.text(row), |titles| titles[row].clone())
    }

    pub(super) fn mark(&self, row: usize) -> Mark {
        self.marks.get(row).copied().unwrap_or_default()
    }

    pub(super) fn is_text(&self) -> bool {
        matches!(self.cells, Cells::Text(_) | Cells::Levels(_) | Cells::Interval(..))
    }
}

impl Cells {
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Text(cells) => cells.len(),
            Self::Levels(cells) => cells.len(),
            Self::Metres(cells) => cells.len(),
            Self::Count(cells) => cells.len(),
            Self::Number(cells, _) => cells.len(),
            Self::Interval(cells, _) => cells.len(),
        }
    }

    /// The number of decimals in text, if it can be chosen.
    pub(super) fn decimals(&mut self) -> Option<&mut usize> {
        match self {
            Self::Number(_, Format::Decimals(decimals)) | Self::Interval(_, decimals) => Some(decimals),
            _ => None,
        }
    }

    /// A cell in text.
    pub(crate) fn text(&self, row: usize) -> Option<String> {
        match self {
            Self::Text(cells) => cells[row].clone(),
            Self::Levels(cells) => cells[row].as_ref().map(|level| level.text.clone()),
            Self::Metres(cells) => Some(cells[row].to_string()),
            Self::Count(cells) => cells[row].map(|count| count.to_string()),
            Self::Interval(cells, decimals) => {
                cells[row].map(|Interval { low, high }| format!("[{low:.decimals$}, {high:.decimals$}]"))
            }
            Self::Number(cells, format) => match format {
                Format::Decimals(decimals) | Format::Fixed(decimals) => {
                    cells[row].map(|number| format!("{number:.decimals$}"))
                }
                Format::Percent => cells[row].map(|share| format!("{:.1} %", 100.0 * share)),
                Format::Written(texts) => texts[row].clone(),
            },
        }
    }
}
