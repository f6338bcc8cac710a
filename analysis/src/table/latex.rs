//! The table in LaTeX, as papers print it: in the type's own size, in as many blocks below each other as it needs.

use std::ops::Range;

use super::Table;
use super::markdown::capitalised;

/// What fits beside each other, in digits of `\footnotesize` (4.25 pt): the 345 pt of an article's page, and the 240 pt of a
/// column of two.
pub(crate) const PAGE: usize = 81;
pub(crate) const COLUMN: usize = 56;
/// The longest name of a score, and the room between two columns (twice `\tabcolsep`, 4 pt).
const NAMES: usize = 23;
pub(crate) const GAP: usize = 2;

pub(super) fn render(table: &Table) -> String {
    let blocks = blocks(table);
    let wide = blocks.iter().map(|block| NAMES + block.iter().map(|part| width(table, part)).sum::<usize>()).max();
    let float = if wide.unwrap_or(0) <= COLUMN { "table" } else { "table*" };
    let mut text = format!("% \\usepackage{{booktabs}}\n\\begin{{{float}}}[t]\n\\centering\n");
    let caption = table.caption.clone().unwrap_or_else(|| caption(table));
    text.push_str(&format!("\\caption{{{caption}}}\n\\label{{tab:{}}}\n", label(&table.label)));
    text.push_str("\\footnotesize\n\\setlength{\\tabcolsep}{4pt}\n");
    for (place, block) in blocks.iter().enumerate() {
        if place > 0 {
            text.push_str("\n\\medskip\n");
        }
        push_block(table, block, &mut text);
    }
    text.push_str(&format!("\\end{{{float}}}\n"));
    text
}

/// What the numbers are.
fn caption(table: &Table) -> String {
    let mut text = format!("{}.", capitalised(&escaped(&table.about())));
    if let Some(best) = table.best_of() {
        text.push_str(&format!(" {} in bold.", capitalised(best)));
    }
    if table.with_paper {
        text.push_str(" In brackets: Martins et al.\\ 2018, Table~I.");
    }
    text
}

/// Groups, or parts of those that are too wide alone, in blocks that fit on a page.
fn blocks(table: &Table) -> Vec<Vec<Range<usize>>> {
    let mut blocks: Vec<Vec<Range<usize>>> = Vec::new();
    let mut free = 0;
    for group in table.groups() {
        for part in parts(table, group) {
            let wide = width(table, &part);
            match blocks.last_mut().filter(|_| wide <= free) {
                Some(block) => block.push(part),
                None => {
                    free = PAGE - NAMES;
                    blocks.push(vec![part]);
                }
            }
            free = free.saturating_sub(wide);
        }
    }
    blocks
}

/// A group, or as many parts of it as fit on a page.
fn parts(table: &Table, group: Range<usize>) -> Vec<Range<usize>> {
    let mut parts: Vec<Range<usize>> = Vec::new();
    for column in group {
        match parts.last_mut().filter(|part| width(table, &(part.start..column + 1)) <= PAGE - NAMES) {
            Some(part) => part.end = column + 1,
            None => parts.push(column..column + 1),
        }
    }
    parts
}

/// How wide some columns under one heading are.
fn width(table: &Table, columns: &Range<usize>) -> usize {
    let column = |column: usize| {
        let cells = (0..table.metrics.len()).map(|line| {
            let (ours, paper) = table.cell(line, column);
            ours.len() + paper.map_or(0, |paper| paper.len() + 1)
        });
        cells.chain([table.columns[column].name.chars().count()]).max().unwrap_or(0) + GAP
    };
    // A heading is bold, and wider for it.
    let heading = table.columns[columns.start].group.chars().count() * 6 / 5 + GAP;
    columns.clone().map(column).sum::<usize>().max(heading)
}

fn push_block(table: &Table, block: &[Range<usize>], text: &mut String) {
    text.push_str("\\begin{tabular}{@{}l");
    for part in block {
        text.push_str(&format!(" {}", "r".repeat(part.len())));
    }
    text.push_str("@{}}\n\\toprule\n");
    for part in block {
        let heading = escaped(&table.columns[part.start].group);
        text.push_str(&format!(" & \\multicolumn{{{}}}{{c}}{{\\textbf{{{heading}}}}}", part.len()));
    }
    text.push_str(" \\\\\n");
    // The first column holds the names of the scores.
    let mut first = 2;
    let rules = block.iter().map(|part| {
        let rule = format!("\\cmidrule(lr){{{first}-{}}}", first + part.len() - 1);
        first += part.len();
        rule
    });
    text.push_str(&rules.collect::<Vec<_>>().join(" "));
    text.push('\n');
    let columns = || block.iter().cloned().flatten();
    for column in columns() {
        text.push_str(&format!(" & {}", escaped(&table.columns[column].name)));
    }
    text.push_str(" \\\\\n\\midrule\n");
    for (line, row) in table.metrics.iter().enumerate() {
        text.push_str(row.latex);
        for column in columns() {
            let (ours, paper) = table.cell(line, column);
            let ours = number(&ours);
            let ours = if table.is_best(line, column) { format!("\\textbf{{{ours}}}") } else { ours };
            text.push_str(&format!(" & {ours}"));
            text.push_str(&paper.map_or_else(String::new, |paper| format!(" {paper}")));
        }
        text.push_str(" \\\\\n");
    }
    text.push_str("\\bottomrule\n\\end{tabular}\n");
}

/// A name that `\ref` takes.
pub(crate) fn label(experiment: &str) -> String {
    experiment.chars().map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '-' }).collect()
}

/// What LaTeX reads as commands, taken literally.
pub(crate) fn escaped(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        match letter {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => text.extend(['\\', letter]),
            '\\' => text.push_str("\\textbackslash{}"),
            '~' => text.push_str("\\textasciitilde{}"),
            '^' => text.push_str("\\textasciicircum{}"),
            // In the usual encoding of fonts these are other signs.
            '<' => text.push_str("\\textless{}"),
            '>' => text.push_str("\\textgreater{}"),
            letter => text.push(letter),
        }
    }
    text
}

/// A number as it is typeset: with a minus, not a hyphen; and a dash where there is none.
pub(crate) fn number(text: &str) -> String {
    match text.strip_prefix('-') {
        Some("") => "--".to_owned(),
        Some(positive) => format!("$-${}", escaped(positive)),
        None => escaped(text),
    }
}
