//! The table in Markdown.

use super::Table;

pub(super) fn render(table: &Table) -> String {
    let mut text = String::from("| |");
    for column in &table.columns {
        text.push_str(&format!(" {}<br>{} |", escaped(&column.group), escaped(&column.name)));
    }
    text.push_str("\n|---|");
    text.push_str(&"---:|".repeat(table.columns.len()));
    text.push('\n');
    for (line, row) in table.metrics.iter().enumerate() {
        text.push_str(&format!("| {} {} |", row.plain, if row.more_is_better { '↑' } else { '↓' }));
        for column in 0..table.columns.len() {
            let (ours, paper) = table.cell(line, column);
            text.push_str(&if table.is_best(line, column) { format!(" **{ours}**") } else { format!(" {ours}") });
            text.push_str(&paper.map_or_else(|| " |".to_owned(), |paper| format!(" {paper} |")));
        }
        text.push('\n');
    }
    text.push_str(&format!("\n{}.", capitalised(&table.about())));
    if let Some(best) = table.best_of() {
        text.push_str(&format!(" {} in bold.", capitalised(best)));
    }
    if table.with_paper {
        text.push_str(" In brackets: Martins et al. 2018, Table I.");
    }
    text.push('\n');
    text
}

pub(crate) fn escaped(name: &str) -> String {
    name.replace('|', "\\|")
}

pub(crate) fn capitalised(sentence: &str) -> String {
    let mut letters = sentence.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
