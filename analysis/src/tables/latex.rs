//! A table in LaTeX, in a fixed type size, split into blocks if it is too wide.

use super::layout::{TextCell, TextColumn, are_together, blocks, capitalised};
use super::{Orientation, Table};
use crate::tables::best::Mark;

/// The available width in digits of `\footnotesize` (4.25 pt): the 345 pt of an article's page, and the 240 pt of one
/// of two columns.
const PAGE: usize = 81;
const COLUMN: usize = 56;
/// The longest name of a metric, and the space between two columns (twice `\tabcolsep`, 4 pt).
const NAMES: usize = 23;
const GAP: usize = 2;
/// The number of rows of `\footnotesize` on a page of an article, with a caption.
const ROWS: usize = 55;

impl Table {
    /// In LaTeX, for the package `booktabs`, with caption and label; the best in bold, the second best underlined.
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
            text.push_str(&format!("% longer than a page: use --top {} to shorten it\n", ROWS / blocks.len()));
        }
        let caption = self.caption.clone().unwrap_or_else(|| caption(self));
        let plain = |letter: char| if letter.is_ascii_alphanumeric() { letter } else { '-' };
        let label = self.own_label.clone().unwrap_or_else(|| self.label.chars().map(plain).collect());
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

/// The caption: a description of the numbers, and notes.
fn caption(table: &Table) -> String {
    let mut text = format!("{}.", capitalised(&escaped(&table.about)));
    if let Some(marks) = table.marks() {
        let has_second = table.columns.iter().any(|column| column.marks.contains(&Mark::Second));
        let second = if has_second { ", second best underlined" } else { "" };
        text.push_str(&format!(" {} in bold{second}.", capitalised(marks)));
    }
    for note in &table.notes {
        let note = escaped(note);
        // A note that starts with the name of a column is not capitalised: `ms`, not `Ms`.
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
    let name = column.latex.as_ref().map_or_else(|| escaped(&column.name), ToString::to_string);
    match column.more_is_better {
        None => name,
        Some(true) => format!("{name} $\\uparrow$"),
        Some(false) => format!("{name} $\\downarrow$"),
    }
}

fn cell(cell: &TextCell, is_text: bool) -> String {
    let is_number = !is_text || cell.text == "-" || cell.text.parse::<f64>().is_ok();
    let text = match (&cell.latex, is_number) {
        (Some(latex), _) => latex.to_string(),
        (None, true) => number(&cell.text),
        (None, false) => escaped(&cell.text),
    };
    let text = match cell.mark {
        Mark::Best => format!("\\textbf{{{text}}}"),
        Mark::Second => format!("\\underline{{{text}}}"),
        Mark::None => text,
    };
    cell.suffix.as_ref().map_or_else(|| text.clone(), |suffix| format!("{text} {}", numbers(suffix)))
}

/// The width of columns under one heading, in digits, including the gap after each column.
fn width(columns: &[&TextColumn]) -> usize {
    let one = |column: &&TextColumn| {
        let cells = column.cells.iter().map(|cell| {
            let suffix = cell.suffix.as_ref().map_or(0, |suffix| suffix.chars().count() + 1);
            if cell.latex.is_some() { NAMES - GAP } else { cell.text.chars().count() + suffix }
        });
        cells.chain([column.heading().chars().count()]).max().unwrap_or(0) + GAP
    };
    // Headings are bold and therefore wider.
    let heading = columns[0].group.chars().count() * 6 / 5 + GAP;
    columns.iter().map(one).sum::<usize>().max(heading)
}

/// Escapes the special characters of LaTeX.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for letter in text.chars() {
        match letter {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => escaped.extend(['\\', letter]),
            '\\' => escaped.push_str("\\textbackslash{}"),
            '~' => escaped.push_str("\\textasciitilde{}"),
            '^' => escaped.push_str("\\textasciicircum{}"),
            // The default font encoding shows other characters for these.
            '<' => escaped.push_str("\\textless{}"),
            '>' => escaped.push_str("\\textgreater{}"),
            letter => escaped.push(letter),
        }
    }
    escaped
}

/// A text such as an interval, with minus signs in front of its numbers.
fn numbers(text: &str) -> String {
    let mut typeset = String::new();
    let mut before = ' ';
    for (at, letter) in text.char_indices() {
        let is_minus = letter == '-'
            && !before.is_alphanumeric()
            && text[at + 1..].starts_with(|next: char| next.is_ascii_digit());
        if is_minus {
            typeset.push_str("$-$");
        } else {
            typeset.push_str(&escaped(letter.encode_utf8(&mut [0; 4])));
        }
        before = letter;
    }
    typeset
}

/// A typeset number: with a minus sign instead of a hyphen, and a dash for a missing number.
fn number(text: &str) -> String {
    match text.strip_prefix('-') {
        Some("") => "--".to_owned(),
        Some(positive) => format!("$-${}", escaped(positive)),
        None => escaped(text),
    }
}
