//! A table in Markdown.

use super::Grid;
use crate::table::markdown::{capitalised, escaped};

pub(super) fn render(grid: &Grid) -> String {
    let shown = grid.shown();
    let mut text = String::from("|");
    for &column in &shown {
        text.push_str(&format!(" {} |", escaped(&grid.columns[column].heading("↑", "↓"))));
    }
    text.push_str("\n|");
    for &column in &shown {
        text.push_str(if grid.columns[column].is_text() { "---|" } else { "---:|" });
    }
    text.push('\n');
    for row in 0..grid.height() {
        text.push('|');
        for &column in &shown {
            let cell = escaped(&grid.text(row, column));
            let best = grid.columns[column].cells.is_best(row);
            text.push_str(&if best { format!(" **{cell}** |") } else { format!(" {cell} |") });
        }
        text.push('\n');
    }
    text.push_str(&format!("\n{}.", capitalised(&grid.about)));
    text.push_str(if grid.is_marked() { " Best in bold.\n" } else { "\n" });
    for note in &grid.notes {
        text.push_str(&format!("\n{}.\n", capitalised(note)));
    }
    text
}
