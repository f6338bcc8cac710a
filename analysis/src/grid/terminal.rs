//! A table as aligned text.

use std::collections::HashSet;

use super::Grid;

/// The longest text of a cell; of what is longer, the middle is left out, but where that would make two texts one.
const LONGEST: usize = 40;

pub(super) fn render(grid: &Grid, width: usize) -> String {
    let best = if grid.is_marked() { "; * best" } else { "" };
    let mut text = String::new();
    push_words(&format!("{}{best}", grid.about), width, &mut text);
    let columns: Vec<Column> = (0..grid.columns.len()).map(|column| Column::of(grid, column)).collect();
    for block in grid.blocks(width + 2, |column| columns[column].wide + 2) {
        let block: Vec<&Column> = block.iter().map(|&column| &columns[column]).collect();
        text.push('\n');
        push_line(block.iter().map(|column| column.padded(&column.heading)), &mut text);
        for row in 0..grid.height() {
            if row > 0 && grid.gaps.contains(&row) {
                text.push('\n');
            }
            push_line(block.iter().map(|column| column.padded(&column.cells[row])), &mut text);
        }
    }
    for note in &grid.notes {
        push_words(&format!("note: {note}"), width, &mut text);
    }
    text
}

/// A column's texts.
struct Column {
    heading: String,
    cells: Vec<String>,
    /// The widest of them, characters.
    wide: usize,
    is_text: bool,
}

impl Column {
    fn of(grid: &Grid, column: usize) -> Self {
        let of = &grid.columns[column];
        let has_marks = (0..of.cells.len()).any(|row| of.cells.is_best(row));
        // Behind a heading over numbers one place is left, for the mark of the best.
        let heading = format!("{}{}", of.heading("↑", "↓"), if has_marks { " " } else { "" });
        let mark = |row: usize| match (has_marks, of.cells.is_best(row)) {
            (true, true) => "*",
            (true, false) => " ",
            (false, _) => "",
        };
        let texts: Vec<String> = (0..grid.height()).map(|row| grid.text(row, column)).collect();
        let short: Vec<String> = texts.iter().map(|text| shortened(text)).collect();
        // A name without its middle may be another's, too: then the column is wide.
        let tells_apart = distinct(&short) == distinct(&texts);
        let texts = if tells_apart { short } else { texts };
        let cells: Vec<String> = texts.iter().enumerate().map(|(row, text)| format!("{text}{}", mark(row))).collect();
        let wide = cells.iter().chain([&heading]).map(|text| text.chars().count()).max().unwrap_or(0);
        Self { heading, cells, wide, is_text: of.is_text() }
    }

    /// Text to the left, numbers to the right.
    fn padded(&self, text: &str) -> String {
        let wide = self.wide;
        if self.is_text { format!("{text:<wide$}") } else { format!("{text:>wide$}") }
    }
}

/// A sentence, broken between words.
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

fn distinct(texts: &[String]) -> usize {
    texts.iter().collect::<HashSet<_>>().len()
}

fn shortened(text: &str) -> String {
    let letters: Vec<char> = text.chars().collect();
    if letters.len() <= LONGEST {
        return text.to_owned();
    }
    let half = LONGEST / 2;
    letters[..half - 1].iter().chain(['…'].iter()).chain(&letters[letters.len() - half..]).collect()
}
