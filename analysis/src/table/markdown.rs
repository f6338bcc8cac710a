//! The table in Markdown.

use super::{LINES, Table};

pub(super) fn render(table: &Table) -> String {
    let mut text = String::from("| |");
    for column in &table.columns {
        text.push_str(&format!(" {}<br>{} |", escaped(&column.group), escaped(&column.name)));
    }
    text.push_str("\n|---|");
    text.push_str(&"---:|".repeat(table.columns.len()));
    text.push('\n');
    for (line, row) in LINES.iter().enumerate() {
        text.push_str(&format!("| {} {} |", row.plain, if row.more_is_better { '↑' } else { '↓' }));
        let best = table.best(line);
        for column in 0..table.columns.len() {
            let cell = table.cell(line, column);
            text.push_str(&if best == Some(column) { format!(" **{cell}** |") } else { format!(" {cell} |") });
        }
        text.push('\n');
    }
    text.push_str(&format!("\n{}. Best over all true pixels in bold.", capitalised(&table.about())));
    if table.with_paper {
        text.push_str(" In brackets: Martins et al. 2018, Table I.");
    }
    text.push('\n');
    text
}

fn escaped(name: &str) -> String {
    name.replace('|', "\\|")
}

pub(super) fn capitalised(sentence: &str) -> String {
    let mut letters = sentence.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
