//! A table in LaTeX, as papers print it: in the type's own size, in as many blocks below each other as its width needs.

use super::layout::{TextCell, TextColumn, are_together, blocks, capitalised};
use super::{Orientation, Table};

/// What fits beside each other, in digits of `\footnotesize` (4.25 pt): the 345 pt of an article's page, and the 240 pt
/// of a column of two.
const PAGE: usize = 81;
const COLUMN: usize = 56;
/// The longest name of a metric, and the room between two columns (twice `\tabcolsep`, 4 pt).
const NAMES: usize = 23;
const GAP: usize = 2;
/// How many rows of `\footnotesize` a page of an article holds, with a caption.
const ROWS: usize = 55;

impl Table {
    /// In LaTeX, for the package `booktabs`, in the type's own size, with caption and label; the best in bold.
    #[must_use]
    pub fn latex(&self) -> String {
        let columns = self.layout(true);
        let blocks = blocks(&columns, PAGE, width);
        let groups =
            |block: &[&TextColumn]| block.chunk_by(|one, next| are_together(one, next)).map(width).sum::<usize>();
        let widest = blocks.iter().map(|block| groups(block)).max().unwrap_or(0);
        let float = if widest <= COLUMN { "table" } else { "table*" };
        let mut text = String::from("% \\usepackage{booktabs}\n");
        if self.orientation == Orientation::Rows && self.height() * blocks.len() > ROWS {
            text.push_str(&format!("% longer than a page: --top {} makes it shorter\n", ROWS / blocks.len()));
        }
        let caption = self.caption.clone().unwrap_or_else(|| caption(self));
        let label: String =
            self.label.chars().map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '-' }).collect();
        text.push_str(&format!(
            "\\begin{{{float}}}[t]\n\\centering\n\\caption{{{caption}}}\n\\label{{tab:{label}}}\n\
             \\footnotesize\n\\setlength{{\\tabcolsep}}{{4pt}}\n"
        ));
        let blocks: Vec<String> = blocks.iter().map(|columns| block(self, columns)).collect();
        text.push_str(&blocks.join("\n\\medskip\n"));
        text.push_str(&format!("\\end{{{float}}}\n"));
        text
    }
}

/// What the numbers are, and notes.
fn caption(table: &Table) -> String {
    let mut text = format!("{}.", capitalised(&escaped(&table.about)));
    if let Some(marks) = table.marks() {
        text.push_str(&format!(" {} in bold.", capitalised(marks)));
    }
    for note in &table.notes {
        let note = escaped(note);
        // A note on a column begins with its name, which is written as it is: `ms`, not `Ms`.
        let is_on_column = note.split_whitespace().next().is_some_and(|word| word.ends_with(':'));
        text.push_str(&format!(" {}.", if is_on_column { note } else { capitalised(&note) }));
    }
    text
}

fn block(table: &Table, columns: &[&TextColumn]) -> String {
    let groups: Vec<&[&TextColumn]> = columns.chunk_by(|one, next| are_together(one, next)).collect();
    let has_groups = columns.iter().any(|column| !column.group.is_empty());
    let side = |column: &&TextColumn| if column.is_text { 'l' } else { 'r' };
    let sides: Vec<String> = groups.iter().map(|group| group.iter().map(side).collect()).collect();
    let sides = sides.join(if has_groups { " " } else { "" });
    let mut text = format!("\\begin{{tabular}}{{@{{}}{sides}@{{}}}}\n\\toprule\n");
    if has_groups {
        let (mut headings, mut rules, mut first) = (Vec::new(), Vec::new(), 1);
        for group in groups {
            let last = first + group.len() - 1;
            let heading = escaped(&group[0].group);
            if heading.is_empty() {
                headings.push(heading);
            } else {
                headings.push(format!("\\multicolumn{{{}}}{{c}}{{\\textbf{{{heading}}}}}", group.len()));
                rules.push(format!("\\cmidrule(lr){{{first}-{last}}}"));
            }
            first = last + 1;
        }
        text.push_str(&format!("{}{}\n", line(headings.into_iter()), rules.join(" ")));
    }
    text.push_str(&format!("{}\\midrule\n", line(columns.iter().map(|column| heading(column)))));
    for row in 0..table.lines() {
        if row > 0 && table.gaps.contains(&row) {
            text.push_str("\\addlinespace\n");
        }
        text.push_str(&line(columns.iter().map(|column| cell(&column.cells[row], column.is_text))));
    }
    text.push_str("\\bottomrule\n\\end{tabular}\n");
    text
}

fn line(cells: impl Iterator<Item = String>) -> String {
    format!("{} \\\\\n", cells.collect::<Vec<_>>().join(" & "))
}

fn heading(column: &TextColumn) -> String {
    let name = column.latex.map_or_else(|| escaped(&column.name), str::to_owned);
    match column.more_is_better {
        None => name,
        Some(true) => format!("{name} $\\uparrow$"),
        Some(false) => format!("{name} $\\downarrow$"),
    }
}

fn cell(cell: &TextCell, is_text: bool) -> String {
    let is_number = !is_text || cell.text == "-" || cell.text.parse::<f64>().is_ok();
    let text = match (cell.latex, is_number) {
        (Some(latex), _) => latex.to_owned(),
        (None, true) => number(&cell.text),
        (None, false) => escaped(&cell.text),
    };
    let text = if cell.is_best { format!("\\textbf{{{text}}}") } else { text };
    cell.beside.as_ref().map_or_else(|| text.clone(), |beside| format!("{text} {}", escaped(beside)))
}

/// The width of some columns under one heading, in digits, each with the gap behind it.
fn width(columns: &[&TextColumn]) -> usize {
    let one = |column: &&TextColumn| {
        let cells = column.cells.iter().map(|cell| {
            let beside = cell.beside.as_ref().map_or(0, |beside| beside.chars().count() + 1);
            if cell.latex.is_some() { NAMES - GAP } else { cell.text.chars().count() + beside }
        });
        cells.chain([column.heading().chars().count()]).max().unwrap_or(0) + GAP
    };
    // A heading is bold, and wider for it.
    let heading = columns[0].group.chars().count() * 6 / 5 + GAP;
    columns.iter().map(one).sum::<usize>().max(heading)
}

/// What LaTeX reads as commands, taken literally.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for letter in text.chars() {
        match letter {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => escaped.extend(['\\', letter]),
            '\\' => escaped.push_str("\\textbackslash{}"),
            '~' => escaped.push_str("\\textasciitilde{}"),
            '^' => escaped.push_str("\\textasciicircum{}"),
            // In the usual encoding of fonts these are other signs.
            '<' => escaped.push_str("\\textless{}"),
            '>' => escaped.push_str("\\textgreater{}"),
            letter => escaped.push(letter),
        }
    }
    escaped
}

/// A number as it is typeset: with a minus, not a hyphen; and a dash where there is none.
fn number(text: &str) -> String {
    match text.strip_prefix('-') {
        Some("") => "--".to_owned(),
        Some(positive) => format!("$-${}", escaped(positive)),
        None => escaped(text),
    }
}
