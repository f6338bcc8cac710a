//! A table as CSV: numbers with the fewest digits that are read back exactly, quotes only if needed.

use std::io::{self, Write};

use super::{Cells, Table};

impl Table {
    /// Writes it as CSV.
    pub(crate) fn write_csv(&self, out: &mut impl Write) -> io::Result<()> {
        let names: Vec<&str> = self.in_files().map(|column| column.name.as_str()).collect();
        writeln!(out, "{}", names.join(","))?;
        self.write_csv_rows(out)
    }

    /// Writes its rows as CSV, without the columns' names.
    pub(crate) fn write_csv_rows(&self, out: &mut impl Write) -> io::Result<()> {
        for row in 0..self.height() {
            for (place, column) in self.in_files().enumerate() {
                if place > 0 {
                    out.write_all(b",")?;
                }
                write_cell(&column.cells, row, out)?;
            }
            out.write_all(b"\n")?;
        }
        Ok(())
    }

    /// As CSV: all digits, an empty field where there is no value.
    #[must_use]
    #[expect(clippy::missing_panics_doc, reason = "memory takes what is written")]
    pub fn csv(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.write_csv(&mut bytes).expect("memory takes what is written");
        bytes
    }
}

fn write_cell(cells: &Cells, row: usize, out: &mut impl Write) -> io::Result<()> {
    match cells {
        Cells::Text(cells) => cells[row].as_ref().map_or(Ok(()), |text| write_text(text, out)),
        Cells::Levels(cells) => cells[row].as_ref().map_or(Ok(()), |level| write_text(&level.text, out)),
        Cells::Metres(cells) => write!(out, "{}", cells[row]),
        Cells::Count(cells) => cells[row].map_or(Ok(()), |count| write!(out, "{count}")),
        Cells::Number(cells, _) => match cells[row] {
            None => Ok(()),
            Some(number) if number.is_finite() => Ok(serde_json::to_writer(out, &number)?),
            Some(number) => write!(out, "{number}"),
        },
        Cells::Interval(..) => Ok(()),
    }
}

fn write_text(text: &str, out: &mut impl Write) -> io::Result<()> {
    if text.is_empty() || text.contains([',', '"', '\n', '\r']) {
        write!(out, "\"{}\"", text.replace('"', "\"\""))
    } else {
        out.write_all(text.as_bytes())
    }
}
