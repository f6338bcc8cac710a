//! A table as aligned text.

use super::{Grid, GridColumn};

/// The longest text of a cell; of what is longer, the middle is left out.
const LONGEST: usize = 40;

pub(super) fn render(grid: &Grid, width: usize) -> String {
    let best = if grid.is_marked() { "; * best" } else { "" };
    let mut text = String::new();
    push_words(&format!("{}{best}", grid.about), width, &mut text);
    let wide = |column: usize| wide(grid, column) + 2;
    for block in grid.blocks(width + 2, wide) {
        text.push('\n');
        let heads = block.iter().map(|&column| heading(&grid.columns[column]));
        push_line(grid, &block, heads.collect(), &mut text);
        for row in 0..grid.height() {
            if row > 0 && grid.gaps.contains(&row) {
                text.push('\n');
            }
            push_line(grid, &block, block.iter().map(|&column| cell(grid, row, column)).collect(), &mut text);
        }
    }
    for note in &grid.notes {
        push_words(&format!("note: {note}"), width, &mut text);
    }
    text
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

/// A line: text to the left, numbers to the right.
fn push_line(grid: &Grid, block: &[usize], cells: Vec<String>, text: &mut String) {
    let cells = block.iter().zip(cells).map(|(&column, cell)| {
        let wide = wide(grid, column);
        if grid.columns[column].is_text() { format!("{cell:<wide$}") } else { format!("{cell:>wide$}") }
    });
    text.push_str(cells.collect::<Vec<_>>().join("  ").trim_end());
    text.push('\n');
}

fn wide(grid: &Grid, column: usize) -> usize {
    let cells = (0..grid.height()).map(|row| cell(grid, row, column).chars().count());
    cells.chain([heading(&grid.columns[column]).chars().count()]).max().unwrap_or(0)
}

/// Behind a heading over numbers one place is left, for the mark of the best.
fn heading(column: &GridColumn) -> String {
    let heading = column.heading("↑", "↓");
    if has_marks(column) { format!("{heading} ") } else { heading }
}

fn has_marks(column: &GridColumn) -> bool {
    (0..column.cells.len()).any(|row| column.cells.is_best(row))
}

fn cell(grid: &Grid, row: usize, column: usize) -> String {
    let text = shortened(grid.text(row, column));
    let column = &grid.columns[column];
    match (has_marks(column), column.cells.is_best(row)) {
        (true, true) => format!("{text}*"),
        (true, false) => format!("{text} "),
        (false, _) => text,
    }
}

fn shortened(text: String) -> String {
    let letters: Vec<char> = text.chars().collect();
    if letters.len() <= LONGEST {
        return text;
    }
    let half = LONGEST / 2;
    letters[..half - 1].iter().chain(['…'].iter()).chain(&letters[letters.len() - half..]).collect()
}
