//! The table in LaTeX, as papers print it.

use super::markdown::capitalised;
use super::{LINES, Table};

pub(super) fn render(table: &Table) -> String {
    let groups = table.groups();
    let mut text = String::from("% \\usepackage{booktabs,graphicx}\n\\begin{table*}[t]\n\\centering\n");
    text.push_str(&format!(
        "\\caption{{{}. Best results on all ground-truth pixels in bold.",
        capitalised(&escaped(&table.about()))
    ));
    if table.with_paper {
        text.push_str(" In brackets: Martins et al.\\ 2018, Table~I.");
    }
    text.push_str("}\n\\resizebox{\\textwidth}{!}{%\n\\begin{tabular}{l");
    for group in &groups {
        text.push(' ');
        text.push_str(&"r".repeat(group.len()));
    }
    text.push_str("}\n\\toprule\n");
    for group in &groups {
        let heading = escaped(&table.columns[group.start].group);
        text.push_str(&format!(" & \\multicolumn{{{}}}{{c}}{{\\textbf{{{heading}}}}}", group.len()));
    }
    text.push_str(" \\\\\n");
    for group in &groups {
        // The first column holds the names of the scores.
        text.push_str(&format!("\\cmidrule(lr){{{}-{}}} ", group.start + 2, group.end + 1));
    }
    text.push('\n');
    for column in &table.columns {
        text.push_str(&format!(" & {}", escaped(&column.name)));
    }
    text.push_str(" \\\\\n\\midrule\n");
    for (line, row) in LINES.iter().enumerate() {
        text.push_str(row.latex);
        let best = table.best(line);
        for column in 0..table.columns.len() {
            let cell = table.cell(line, column);
            text.push_str(&if best == Some(column) { format!(" & \\textbf{{{cell}}}") } else { format!(" & {cell}") });
        }
        text.push_str(" \\\\\n");
    }
    text.push_str("\\bottomrule\n\\end{tabular}}\n\\end{table*}\n");
    text
}

/// What LaTeX reads as commands, taken literally.
fn escaped(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        match letter {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => text.extend(['\\', letter]),
            '\\' => text.push_str("\\textbackslash{}"),
            '~' => text.push_str("\\textasciitilde{}"),
            '^' => text.push_str("\\textasciicircum{}"),
            letter => text.push(letter),
        }
    }
    text
}
