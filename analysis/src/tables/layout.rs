//! The layout of a table as text, in both orientations.

use std::borrow::Cow;

use super::{Column, Orientation, Table};
use crate::tables::best::Mark;

/// A column of text.
#[derive(Default)]
pub(super) struct TextColumn {
    /// The heading that it shares with its neighbours.
    pub(super) group: String,
    pub(super) name: String,
    /// Its published name in LaTeX, if any.
    pub(super) latex: Option<Cow<'static, str>>,
    pub(super) more_is_better: Option<bool>,
    pub(super) cells: Vec<TextCell>,
    pub(super) is_text: bool,
    /// Whether it is repeated in each block.
    pub(super) is_key: bool,
    /// Whether it stays together with the column before it.
    pub(super) joins: bool,
    /// Whether it has room for marks.
    pub(super) has_marks: bool,
}

/// A cell of text.
pub(super) struct TextCell {
    pub(super) text: String,
    /// The replacement in LaTeX.
    pub(super) latex: Option<Cow<'static, str>>,
    pub(super) mark: Mark,
    /// Text after the cell: an interval, or a number to compare with.
    pub(super) suffix: Option<String>,
}

impl TextColumn {
    /// The name with an arrow that shows which way is better.
    pub(super) fn heading(&self) -> String {
        with_arrow(&self.name, self.more_is_better)
    }
}

/// The name and an arrow that shows which way is better.
fn with_arrow(name: &str, more_is_better: Option<bool>) -> String {
    match more_is_better {
        None => name.to_owned(),
        Some(more) => format!("{name} {}", if more { '↑' } else { '↓' }),
    }
}

impl Table {
    /// The columns of text. With `folded`, columns that join another one are appended to its cells.
    pub(super) fn layout(&self, folded: bool) -> Vec<TextColumn> {
        match self.orientation {
            Orientation::Rows => self.rows_layout(folded),
            Orientation::Metrics => self.metrics_layout(),
        }
    }

    /// The number of lines of text, without headings.
    pub(super) fn lines(&self) -> usize {
        match self.orientation {
            Orientation::Rows => self.height(),
            Orientation::Metrics => self.metrics().count(),
        }
    }

    fn shown(&self) -> impl Iterator<Item = &Column> + Clone {
        self.columns.iter().filter(|column| !column.only_in_files)
    }

    fn rows_layout(&self, folded: bool) -> Vec<TextColumn> {
        let mut columns: Vec<TextColumn> = Vec::new();
        for column in self.shown() {
            let text = |row: usize| match column.once && !self.starts.contains(&row) {
                true => String::new(),
                false => column.text(row).unwrap_or_else(|| "-".to_owned()),
            };
            if let Some(before) = columns.last_mut().filter(|_| folded && column.joins) {
                for (row, cell) in before.cells.iter_mut().enumerate() {
                    cell.suffix = column.cells.text(row).filter(|text| text != "-");
                }
                continue;
            }
            let cell = |row| TextCell { text: text(row), latex: None, mark: column.mark(row), suffix: None };
            columns.push(TextColumn {
                group: String::new(),
                name: column.shown.as_ref().unwrap_or(&column.name).clone(),
                latex: column.latex.clone(),
                more_is_better: column.more_is_better,
                cells: (0..self.height()).map(cell).collect(),
                is_text: column.is_text(),
                is_key: column.is_key,
                joins: column.joins,
                has_marks: column.marks.contains(&Mark::Best),
            });
        }
        columns
    }

    /// The columns that have one line each, with the columns that are appended to their cells.
    fn metrics(&self) -> impl Iterator<Item = (&Column, Vec<&Column>)> {
        let shown: Vec<&Column> = self.shown().filter(|column| !column.is_key).collect();
        let lines: Vec<_> = shown.chunk_by(|_, next| next.joins).map(|line| (line[0], line[1..].to_vec())).collect();
        lines.into_iter()
    }

    fn metrics_layout(&self) -> Vec<TextColumn> {
        let name = |(column, _): (&Column, _)| TextCell {
            text: with_arrow(column.shown.as_ref().unwrap_or(&column.name), column.more_is_better),
            latex: column.latex.clone(),
            mark: Mark::None,
            suffix: None,
        };
        let names = self.metrics().map(name).collect();
        let mut columns = vec![TextColumn { cells: names, is_text: true, is_key: true, ..TextColumn::default() }];
        let mut keys = self.shown().filter(|column| column.is_key);
        let (group, name) = (keys.next(), keys.next());
        let text = |key: Option<&Column>, row| key.and_then(|key| key.text(row)).unwrap_or_default();
        columns.extend((0..self.height()).map(|row| {
            let cell = |(column, joined): (&Column, Vec<&Column>)| {
                let suffix: Vec<String> = joined.iter().filter_map(|column| column.cells.text(row)).collect();
                TextCell {
                    text: column.cells.text(row).unwrap_or_else(|| "-".to_owned()),
                    latex: None,
                    mark: column.mark(row),
                    suffix: (!suffix.is_empty()).then(|| suffix.join(" ")),
                }
            };
            let cells = self.metrics().map(cell).collect();
            let (group, name) = (text(group, row), text(name, row));
            TextColumn { group, name, cells, has_marks: true, ..TextColumn::default() }
        }));
        columns
    }
}

/// Splits the columns into blocks of at most `room` width. Each block contains the key columns and as many others as
/// fit. Columns that join each other or share a heading stay together if they fit. `width` is the width of such
/// columns.
pub(super) fn blocks(
    columns: &[TextColumn],
    room: usize,
    width: impl Fn(&[&TextColumn]) -> usize,
) -> Vec<Vec<&TextColumn>> {
    let (keys, others): (Vec<&TextColumn>, Vec<&TextColumn>) = columns.iter().partition(|column| column.is_key);
    let keys_width: usize = keys.iter().map(|key| width(&[*key])).sum();
    let mut blocks = vec![keys.clone()];
    let mut used = keys_width;
    let mut parts: Vec<Vec<&TextColumn>> = Vec::new();
    for group in others.chunk_by(|one, next| are_together(one, next)) {
        parts.push(Vec::new());
        for joined in group.chunk_by(|_, next| next.joins) {
            let part = parts.last_mut().expect("there is one");
            if !part.is_empty() && keys_width + width(&[part.as_slice(), joined].concat()) > room {
                parts.push(joined.to_vec());
            } else {
                part.extend(joined);
            }
        }
    }
    for part in parts {
        let wide = width(&part);
        if used + wide > room && used > keys_width {
            blocks.push(keys.clone());
            used = keys_width;
        }
        used += wide;
        blocks.last_mut().expect("there is one").extend(part);
    }
    blocks
}

/// Whether the second of two neighbours joins the first or shares its heading.
pub(super) fn are_together(one: &TextColumn, next: &TextColumn) -> bool {
    next.joins || !one.group.is_empty() && one.group == next.group
}

pub(super) fn capitalised(sentence: &str) -> String {
    let mut letters = sentence.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
