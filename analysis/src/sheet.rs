//! Tables as they are written: columns of text and numbers, as CSV and as Parquet.
//!
//! polars writes and reads Parquet, and is kept from starting threads for it: a table is small, and where a system gives no more
//! threads, polars' pools panic, or wait for ever for threads that never came. Its CSV writer cannot be kept from it.

use std::io::{self, Write};

use polars::frame::DataFrame;
use polars::prelude::{Column, NamedFrom, ParquetWriter, PlSmallStr, PolarsResult, Series};

/// A table: columns of one length, each with its name.
pub(crate) struct Sheet<'a> {
    columns: Vec<(String, Cells<'a>)>,
}

/// The cells of a column, top to bottom.
pub(crate) enum Cells<'a> {
    Text(Vec<&'a str>),
    Metres(Vec<u32>),
    Count(Vec<u64>),
    CountIfAny(Vec<Option<u64>>),
    /// Numbers as they were written: CSV has the same text.
    Numeral(Vec<Option<&'a str>>),
    /// `None` is an empty cell.
    Number(Vec<Option<f64>>),
}

impl<'a> Sheet<'a> {
    pub(crate) const fn new() -> Self {
        Self { columns: Vec::new() }
    }

    /// Adds a column on the right.
    pub(crate) fn with(mut self, name: impl Into<String>, cells: Cells<'a>) -> Self {
        let (name, height) = (name.into(), self.height());
        assert!(self.columns.is_empty() || cells.len() == height, "`{name}` is as long as the other columns");
        self.columns.push((name, cells));
        self
    }

    pub(crate) fn height(&self) -> usize {
        self.columns.first().map_or(0, |(_, cells)| cells.len())
    }

    /// Writes it as CSV: numbers with the fewest digits that give the same number again, quotes only where they are needed.
    pub(crate) fn write_csv(&self, out: &mut impl Write) -> io::Result<()> {
        let names: Vec<&str> = self.columns.iter().map(|(name, _)| name.as_str()).collect();
        writeln!(out, "{}", names.join(","))?;
        for row in 0..self.height() {
            for (place, (_, cells)) in self.columns.iter().enumerate() {
                if place > 0 {
                    out.write_all(b",")?;
                }
                cells.write(row, out)?;
            }
            out.write_all(b"\n")?;
        }
        Ok(())
    }

    /// The bytes of a CSV file.
    pub(crate) fn csv(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.write_csv(&mut bytes).expect("memory takes what is written");
        bytes
    }

    /// The bytes of a Parquet file.
    pub(crate) fn parquet(self) -> PolarsResult<Vec<u8>> {
        let height = self.height();
        let column = |(name, cells): (String, Cells<'_>)| {
            let name = name.as_str().into();
            Column::from(match cells {
                Cells::Text(cells) => Series::new(name, cells),
                Cells::Metres(cells) => Series::new(name, cells),
                Cells::Count(cells) => Series::new(name, cells),
                Cells::CountIfAny(cells) => Series::new(name, cells),
                Cells::Numeral(cells) => numerals(name, &cells),
                Cells::Number(cells) => Series::new(name, cells),
            })
        };
        let table = DataFrame::new(height, self.columns.into_iter().map(column).collect())?;
        let mut bytes = Vec::new();
        let mut writer = ParquetWriter::new(&mut bytes).set_parallel(false).batched(table.schema())?;
        writer.write_batch(&table)?;
        writer.finish()?;
        drop(writer);
        Ok(bytes)
    }
}

/// Whole numbers where all are.
fn numerals(name: PlSmallStr, cells: &[Option<&str>]) -> Series {
    let whole: Result<Vec<Option<i64>>, _> = cells.iter().map(|cell| cell.map(str::parse::<i64>).transpose()).collect();
    match whole {
        Ok(whole) => Series::new(name, whole),
        Err(_) => {
            Series::new(name, cells.iter().map(|cell| cell.and_then(|of| of.parse::<f64>().ok())).collect::<Vec<_>>())
        }
    }
}

impl Cells<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Text(cells) => cells.len(),
            Self::Metres(cells) => cells.len(),
            Self::Count(cells) => cells.len(),
            Self::CountIfAny(cells) => cells.len(),
            Self::Numeral(cells) => cells.len(),
            Self::Number(cells) => cells.len(),
        }
    }

    fn write(&self, row: usize, out: &mut impl Write) -> io::Result<()> {
        match self {
            Self::Text(cells) => write_text(cells[row], out),
            Self::Metres(cells) => write!(out, "{}", cells[row]),
            Self::Count(cells) => write!(out, "{}", cells[row]),
            Self::CountIfAny(cells) => cells[row].map_or(Ok(()), |count| write!(out, "{count}")),
            Self::Numeral(cells) => cells[row].map_or(Ok(()), |numeral| out.write_all(numeral.as_bytes())),
            Self::Number(cells) => match cells[row] {
                None => Ok(()),
                Some(number) if number.is_finite() => Ok(serde_json::to_writer(out, &number)?),
                Some(number) => write!(out, "{number}"),
            },
        }
    }
}

fn write_text(text: &str, out: &mut impl Write) -> io::Result<()> {
    if text.is_empty() || text.contains([',', '"', '\n', '\r']) {
        write!(out, "\"{}\"", text.replace('"', "\"\""))
    } else {
        out.write_all(text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_written_as_other_programs_read_them() {
        let numbers = vec![Some(0.1 + 0.2), Some(1.0), Some(1e-7), Some(1e300), None, Some(f64::NAN)];
        let sheet = Sheet::new()
            .with("name", Cells::Text(vec!["a/b", "two, three", "\"q\"", "", "ä", "x"]))
            .with("bin_m", Cells::Metres((0..6).collect()))
            .with("median", Cells::CountIfAny(vec![Some(5), None, None, None, None, None]))
            .with("score", Cells::Number(numbers));
        let mut bytes = Vec::new();
        sheet.write_csv(&mut bytes).unwrap();
        let expected = "name,bin_m,median,score\na/b,0,5,0.30000000000000004\n\"two, three\",1,,1.0\n\"\"\"q\"\"\",2,,1e-7\n\
                        \"\",3,,1e+300\nä,4,,\nx,5,,NaN\n";
        assert_eq!(String::from_utf8(bytes).unwrap(), expected);
    }
}
