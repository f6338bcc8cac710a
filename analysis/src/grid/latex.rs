//! A table in LaTeX: in the type's own size, in as many blocks below each other as its width needs.

use super::{Grid, GridColumn};
use crate::table::latex::{COLUMN, GAP, PAGE, escaped, label, number};
use crate::table::markdown::capitalised;

/// How many rows of `\footnotesize` a page of an article holds, with a caption.
const ROWS: usize = 55;

pub(super) fn render(grid: &Grid) -> String {
    let wide = |column: usize| wide(grid, column);
    let blocks = grid.blocks(PAGE, wide);
    let widest = blocks.iter().map(|block| block.iter().map(|&column| wide(column)).sum::<usize>()).max();
    let float = if widest.unwrap_or(0) <= COLUMN { "table" } else { "table*" };
    let mut text = String::from("% \\usepackage{booktabs}\n");
    if grid.height() * blocks.len() > ROWS {
        text.push_str(&format!("% longer than a page: --top {} makes it shorter\n", ROWS / blocks.len()));
    }
    let caption = grid.caption.clone().unwrap_or_else(|| caption(grid));
    text.push_str(&format!(
        "\\begin{{{float}}}[t]\n\\centering\n\\caption{{{caption}}}\n\\label{{tab:{}}}\n",
        label(&grid.label)
    ));
    text.push_str("\\footnotesize\n\\setlength{\\tabcolsep}{4pt}\n");
    for (place, block) in blocks.iter().enumerate() {
        if place > 0 {
            text.push_str("\n\\medskip\n");
        }
        push_block(grid, block, &mut text);
    }
    text.push_str(&format!("\\end{{{float}}}\n"));
    text
}

/// What the numbers are, and notes.
fn caption(grid: &Grid) -> String {
    let mut text = format!("{}.", capitalised(&escaped(&grid.about)));
    if grid.is_marked() {
        text.push_str(" Best in bold.");
    }
    for note in &grid.notes {
        let note = escaped(note);
        // A note on a column begins with its name, which is written as it is: `ms` is no `Ms`.
        let of_column = note.split_whitespace().next().is_some_and(|word| word.ends_with(':'));
        text.push_str(&format!(" {}.", if of_column { note } else { capitalised(&note) }));
    }
    text
}

fn push_block(grid: &Grid, block: &[usize], text: &mut String) {
    let columns = || block.iter().map(|&column| &grid.columns[column]).filter(|column| !column.joins);
    let sides: String = columns().map(|column| if column.is_text() { 'l' } else { 'r' }).collect();
    let heads: Vec<String> = columns().map(heading).collect();
    text.push_str(&format!(
        "\\begin{{tabular}}{{@{{}}{sides}@{{}}}}\n\\toprule\n{} \\\\\n\\midrule\n",
        heads.join(" & ")
    ));
    for row in 0..grid.height() {
        if row > 0 && grid.gaps.contains(&row) {
            text.push_str("\\addlinespace\n");
        }
        let cell = |column: usize| {
            let cell = grid.text(row, column);
            let is_number = !grid.columns[column].is_text() || cell == "-" || cell.parse::<f64>().is_ok();
            let cell = if is_number { number(&cell) } else { escaped(&cell) };
            if grid.columns[column].cells.is_best(row) { format!("\\textbf{{{cell}}}") } else { cell }
        };
        // A score and its interval are one cell.
        let cells = block.chunk_by(|_, next| grid.columns[*next].joins).map(|together| {
            let has_text = |column: &&usize| !grid.columns[**column].joins || grid.text(row, **column) != "-";
            together.iter().filter(has_text).map(|&column| cell(column)).collect::<Vec<_>>().join(" ")
        });
        text.push_str(&format!("{} \\\\\n", cells.collect::<Vec<_>>().join(" & ")));
    }
    text.push_str("\\bottomrule\n\\end{tabular}\n");
}

fn heading(column: &GridColumn) -> String {
    let name = column.latex.map_or_else(|| escaped(column.shown_name()), str::to_owned);
    match column.more_is_better {
        None => name,
        Some(true) => format!("{name} $\\uparrow$"),
        Some(false) => format!("{name} $\\downarrow$"),
    }
}

/// How wide a column is, in digits, with the gap behind it.
fn wide(grid: &Grid, column: usize) -> usize {
    let cells = (0..grid.height()).map(|row| grid.text(row, column).chars().count());
    if grid.columns[column].joins {
        return cells.max().unwrap_or(0) + 1;
    }
    cells.chain([grid.columns[column].heading("x", "x").chars().count()]).max().unwrap_or(0) + GAP
}
