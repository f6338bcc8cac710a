//! A table as aligned text.

use std::collections::HashSet;

use super::Table;
use super::layout::{TextColumn, are_together, blocks};
use crate::tables::best::Mark;

/// The maximum length of a cell. The middle of longer texts is omitted, unless two texts would become equal.
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
        push_line(groups.iter().map(|group| format!("{:<1$}", group[0].group, group_width(group))), text);
    }
    // If a heading is wider than the columns below it, the first column is widened.
    let widths: Vec<usize> = groups
        .iter()
        .flat_map(|group| {
            let more = group_width(group) - columns_width(group);
            group.iter().enumerate().map(move |(place, column)| width(column) + if place == 0 { more } else { 0 })
        })
        .collect();
    let padded = |(column, wide): (&&TextColumn, &usize), text: &str| {
        if column.is_text { format!("{text:<wide$}") } else { format!("{text:>wide$}") }
    };
    let columns = || block.iter().zip(&widths);
    push_line(columns().map(|column| padded(column, &heading(column.0))), text);
    for row in 0..table.lines() {
        if row > 0 && table.gaps.contains(&row) {
            text.push('\n');
        }
        push_line(columns().map(|column| padded(column, &cell(column.0, row))), text);
    }
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
    cells.chain([heading(column)]).map(|text| text.chars().count()).max().unwrap_or(0)
}

fn columns_width(columns: &[&TextColumn]) -> usize {
    columns.iter().map(|column| width(column) + 2).sum::<usize>() - 2
}

/// The width of columns under one heading.
fn group_width(columns: &[&TextColumn]) -> usize {
    columns_width(columns).max(columns[0].group.chars().count())
}

/// Appends a sentence, wrapped between words.
fn push_words(sentence: &str, width: usize, text: &mut String) {
    let mut used = 0;
    for word in sentence.split(' ') {
        let wide = word.chars().count();
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
    let letters: Vec<char> = text.chars().collect();
    if letters.len() <= LONGEST {
        return text.to_owned();
    }
    let half = LONGEST / 2;
    letters[..half - 1].iter().chain(['…'].iter()).chain(&letters[letters.len() - half..]).collect()
}
