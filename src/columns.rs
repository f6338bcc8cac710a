//! Lists for a terminal: rows of text as aligned columns.

/// Rows as lines, two spaces between columns; the columns named `right` are numbers.
pub fn aligned<const N: usize>(rows: &[[String; N]], right: &[usize]) -> String {
    let widths: [usize; N] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0));
    let mut text = String::new();
    for row in rows {
        let cells = row.iter().enumerate().map(|(column, cell)| {
            let width = widths[column];
            if right.contains(&column) { format!("{cell:>width$}") } else { format!("{cell:width$}") }
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
}
