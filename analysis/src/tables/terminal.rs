//! A table as aligned text.

use std::collections::HashSet;

use unicode_width::{UnicodeWidthChar as _, UnicodeWidthStr as _};

use super::Table;
use super::layout::{TextColumn, are_together, blocks};
use crate::tables::best::Mark;

/// The maximum width of a cell. The middle of longer texts is omitted, unless two texts would become equal.
const LONGEST: usize = 40;

impl Table {
    /// As aligned text, the best marked by `*`. A table wider than `width` columns is split into blocks.
    #[must_use]
    pub fn terminal(&self, width: usize) -> String {
        let marks = self.marks().map_or_else(String::new, |marks| format!("; * {marks}"));
        let mut text = String::new();
        push_words(&format!("{}{marks}", self.about), width, &mut text);
        let mut columns = self.layout(false);
        columns.iter_mut().for_each(shorten);
        for block in blocks(&columns, width + 2, |columns| group_width(columns) + 2) {
            text.push('\n');
            push_block(self, &block, &mut text);
        }
        for note in &self.notes {
            push_words(&format!("note: {note}"), width, &mut text);
        }
        text
    }
}

fn push_block(table: &Table, block: &[&TextColumn], text: &mut String) {
    let groups: Vec<&[&TextColumn]> = block.chunk_by(|one, next| are_together(one, next)).collect();
    if block.iter().any(|column| !column.group.is_empty()) {
        push_line(groups.iter().map(|group| padded(&group[0].group, group_width(group), true)), text);
    }
    // If a heading is wider than the columns below it, the first column is widened.
    let widths: Vec<usize> = groups
        .iter()
        .flat_map(|group| {
            let more = group_width(group) - columns_width(group);
            group.iter().enumerate().map(move |(place, column)| width(column) + if place == 0 { more } else { 0 })
        })
        .collect();
    let columns = || block.iter().zip(&widths);
    push_line(columns().map(|(column, wide)| padded(&heading(column), *wide, column.is_text)), text);
    for row in 0..table.lines() {
        if row > 0 && table.gaps.contains(&row) {
            text.push('\n');
        }
        push_line(columns().map(|(column, wide)| padded(&cell(column, row), *wide, column.is_text)), text);
    }
}

/// A text of this width on a terminal, where letters of Chinese, Japanese and Korean are two columns wide.
fn padded(text: &str, wide: usize, is_left: bool) -> String {
    let padding = " ".repeat(wide.saturating_sub(text.width()));
    if is_left { format!("{text}{padding}") } else { format!("{padding}{text}") }
}

/// Omits the middles of long texts, unless two texts would become equal.
fn shorten(column: &mut TextColumn) {
    let short: Vec<String> = column.cells.iter().map(|cell| shortened(&cell.text)).collect();
    let distinct = |texts: &mut dyn Iterator<Item = &String>| texts.collect::<HashSet<_>>().len();
    if distinct(&mut short.iter()) == distinct(&mut column.cells.iter().map(|cell| &cell.text)) {
        column.cells.iter_mut().zip(short).for_each(|(cell, short)| cell.text = short);
    }
}

/// The heading, with one space for the mark of the best value.
fn heading(column: &TextColumn) -> String {
    format!("{}{}", column.heading(), if column.has_marks { " " } else { "" })
}

fn cell(column: &TextColumn, row: usize) -> String {
    let cell = &column.cells[row];
    let mark = match (cell.mark == Mark::Best, column.has_marks) {
        (true, _) => "*",
        (false, true) => " ",
        (false, false) => "",
    };
    let suffix = cell.suffix.as_ref().map_or_else(String::new, |suffix| format!(" {suffix}"));
    format!("{}{mark}{suffix}", cell.text)
}

fn width(column: &TextColumn) -> usize {
    let cells = (0..column.cells.len()).map(|row| cell(column, row));
    cells.chain([heading(column)]).map(|text| text.width()).max().unwrap_or(0)
}

fn columns_width(columns: &[&TextColumn]) -> usize {
    columns.iter().map(|column| width(column) + 2).sum::<usize>() - 2
}

/// The width of columns under one heading.
fn group_width(columns: &[&TextColumn]) -> usize {
    columns_width(columns).max(columns[0].group.width())
}

/// Appends a sentence, wrapped between words.
fn push_words(sentence: &str, width: usize, text: &mut String) {
    let mut used = 0;
    for word in sentence.split(' ') {
        let wide = word.width();
        if used > 0 && used + 1 + wide > width {
            text.push('\n');
            used = 0;
        } else if used > 0 {
            text.push(' ');
            used += 1;
        }
        text.push_str(word);
        used += wide;
    }
    text.push('\n');
}

fn push_line(cells: impl Iterator<Item = String>, text: &mut String) {
    text.push_str(cells.collect::<Vec<_>>().join("  ").trim_end());
    text.push('\n');
}

fn shortened(text: &str) -> String {
    if text.width() <= LONGEST {
        return text.to_owned();
    }
    let half = LONGEST / 2;
    // The letters that fit into a width.
    let fitting = |letters: &mut dyn Iterator<Item = char>, wide: usize| -> Vec<char> {
        let mut used = 0;
        let fits = |letter: &char| {
            used += letter.width().unwrap_or(0);
            used <= wide
        };
        letters.take_while(fits).collect()
    };
    let (first, last) = (fitting(&mut text.chars(), half - 1), fitting(&mut text.chars().rev(), half));
    first.iter().chain(['…'].iter()).chain(last.iter().rev()).collect()
}
