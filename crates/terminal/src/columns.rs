//! Lists for a terminal: rows of text as aligned columns.

use std::borrow::Cow;

use unicode_width::UnicodeWidthStr as _;

use crate::streams::on_one_line;

/// Rows as lines, two spaces between columns; the columns named `right` are numbers.
///
/// A cell is one line, whatever the source file contains.
pub fn aligned<const N: usize>(rows: &[[String; N]], right: &[usize]) -> String {
    let rows: Vec<[Cow<'_, str>; N]> = rows.iter().map(|row| row.each_ref().map(|cell| on_one_line(cell))).collect();
    let widths: [usize; N] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].width()).max().unwrap_or(0));
    let mut text = String::new();
    for row in &rows {
        let cells = row.iter().enumerate().map(|(column, cell)| {
            // The width of a formatted argument has only 16 bits.
            let padding = " ".repeat(widths[column] - cell.width());
            if right.contains(&column) { format!("{padding}{cell}") } else { format!("{cell}{padding}") }
        });
        text.push_str(cells.collect::<Vec<_>>().join("  ").trim_end());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::aligned;

    #[test]
    fn numbers_end_below_each_other() {
        let rows = [["run", "frames"], ["ä", "16"], ["first", "-"]].map(|row| row.map(str::to_owned));
        assert_eq!(aligned(&rows, &[1]), "run    frames\nä          16\nfirst       -\n");
    }

    #[test]
    fn letters_of_two_columns_keep_the_next_column_in_place() {
        let rows = [["深度", "16"], ["first", "3"]].map(|row| row.map(str::to_owned));
        assert_eq!(aligned(&rows, &[]), "深度   16\nfirst  3\n");
    }

    #[test]
    fn a_cell_may_be_long() {
        let rows = [["a".repeat(70_000), "b".to_owned()], [String::new(), "c".to_owned()]];
        assert_eq!(aligned(&rows, &[0]).lines().map(str::len).collect::<Vec<_>>(), [70_003, 70_003]);
    }

    #[test]
    fn a_cell_is_one_line() {
        let rows = [["a\nrun", "\u{1b}[31m1"]].map(|row| row.map(str::to_owned));
        assert_eq!(aligned(&rows, &[]), "a\\nrun  \\u{1b}[31m1\n");
    }
}
