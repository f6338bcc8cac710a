//! A table in Markdown (GitHub's).

use super::Table;
use super::layout::{TextCell, TextColumn, capitalised};
use crate::tables::best::Mark;

impl Table {
    /// In Markdown (GitHub's), the best in bold.
    #[must_use]
    pub fn markdown(&self) -> String {
        let columns = self.layout(false);
        let mut text = line(columns.iter().map(heading));
        text.push('|');
        text.extend(columns.iter().map(|column| if column.is_text { "---|" } else { "---:|" }));
        text.push('\n');
        for row in 0..self.lines() {
            text.push_str(&line(columns.iter().map(|column| cell(&column.cells[row]))));
        }
        text.push_str(&format!("\n{}.", capitalised(&self.about)));
        if let Some(marks) = self.marks() {
            text.push_str(&format!(" {} in bold.", capitalised(marks)));
        }
        text.push('\n');
        for note in &self.notes {
            text.push_str(&format!("\n{}.\n", capitalised(note)));
        }
        text
    }
}

fn line(cells: impl Iterator<Item = String>) -> String {
    format!("|{}\n", cells.map(|cell| format!(" {cell} |")).collect::<String>())
}

fn heading(column: &TextColumn) -> String {
    let group = if column.group.is_empty() { String::new() } else { format!("{}<br>", escaped(&column.group)) };
    format!("{group}{}", escaped(&column.heading()))
}

fn cell(cell: &TextCell) -> String {
    let text = escaped(&cell.text);
    let text = if cell.mark == Mark::Best { format!("**{text}**") } else { text };
    cell.suffix.as_ref().map_or_else(|| text.clone(), |suffix| format!("{text} {suffix}"))
}

fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            // The beginning of a tag or of a character reference.
            '<' if letters.peek().is_some_and(|next| next.is_ascii_alphabetic() || "/!?".contains(*next)) => {
                escaped.push_str("&lt;");
            }
            '&' if letters.peek().is_some_and(|next| next.is_ascii_alphanumeric() || *next == '#') => {
                escaped.push_str("&amp;");
            }
            '|' | '*' | '`' => escaped.extend(['\\', letter]),
            _ => escaped.push(letter),
        }
    }
    escaped
}
