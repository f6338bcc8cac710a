//! The table as aligned text.

use super::Table;

/// Blocks of whole groups, none wider than `width` unless a single group is.
pub(super) fn render(table: &Table, width: usize) -> String {
    let names = table.metrics.iter().map(|line| line.plain.len() + 2).max().unwrap_or(0);
    let widths: Vec<usize> = (0..table.columns.len())
        .map(|column| {
            let cells = (0..table.metrics.len()).map(|line| cell(table, line, column).chars().count());
            cells.chain([table.columns[column].name.chars().count()]).max().unwrap_or(0) + 2
        })
        .collect();
    let mut text = table.about();
    if let Some(best) = table.best_of() {
        text.push_str(&format!("; * {best}"));
    }
    text.push_str(if table.with_paper { "; in brackets: the paper's\n" } else { "\n" });
    let mut block: Vec<(std::ops::Range<usize>, usize)> = Vec::new();
    for group in table.groups() {
        // A heading may be wider than its columns: the group is then as wide as the heading.
        let wide =
            widths[group.clone()].iter().sum::<usize>().max(table.columns[group.start].group.chars().count() + 2);
        if !block.is_empty() && names + block.iter().map(|(_, wide)| wide).sum::<usize>() + wide > width {
            render_block(table, names, &widths, &block, &mut text);
            block.clear();
        }
        block.push((group, wide));
    }
    render_block(table, names, &widths, &block, &mut text);
    text
}

fn render_block(
    table: &Table,
    names: usize,
    widths: &[usize],
    block: &[(std::ops::Range<usize>, usize)],
    text: &mut String,
) {
    let mut headings = " ".repeat(names);
    let mut columns = " ".repeat(names);
    for (group, wide) in block {
        headings.push_str(&format!("  {:<1$}", table.columns[group.start].group, wide - 2));
        columns.push_str(&" ".repeat(wide - widths[group.clone()].iter().sum::<usize>()));
        for column in group.clone() {
            // One place is left for the mark of the best.
            columns.push_str(&format!("{:>1$} ", table.columns[column].name, widths[column] - 1));
        }
    }
    push_line(text, "");
    push_line(text, &headings);
    push_line(text, &columns);
    for (line, row) in table.metrics.iter().enumerate() {
        let arrow = if row.more_is_better { '↑' } else { '↓' };
        let mut cells = format!("{:<1$}", format!("{} {arrow}", row.plain), names);
        for (group, wide) in block {
            cells.push_str(&" ".repeat(wide - widths[group.clone()].iter().sum::<usize>()));
            for column in group.clone() {
                cells.push_str(&format!("{:>1$}", cell(table, line, column), widths[column]));
            }
        }
        push_line(text, &cells);
    }
}

/// Our number, the mark of the best or a place for it, and the paper's number.
fn cell(table: &Table, line: usize, column: usize) -> String {
    let mark = if table.is_best(line, column) { '*' } else { ' ' };
    let (ours, paper) = table.cell(line, column);
    format!("{ours}{mark}{}", paper.map_or_else(String::new, |paper| format!(" {paper}")))
}

fn push_line(text: &mut String, line: &str) {
    text.push_str(line.trim_end());
    text.push('\n');
}
