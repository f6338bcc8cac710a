//! Tables as they are written: columns of text and numbers, as CSV, as Parquet and as JSON.
//!
//! A Parquet file says what it is: `depthloom.format` (the version of these columns), `depthloom.table` (which table it is),
//! `depthloom.run` (the [key](crate::plan_key) of the run's plan) and `depthloom.units` (a JSON object, column to unit) lie in its metadata.
//!
//! polars writes and reads Parquet, and is kept from starting threads for it: a table is small, and where a system gives no more
//! threads, polars' pools panic, or wait for ever for threads that never came. Its CSV writer cannot be kept from it.

mod cell;

use std::io::{self, Write};
use std::str::FromStr;

use depthloom_graphs::Key;
use depthloom_scores::Metric;
use polars::frame::DataFrame;
use polars::prelude::{
    Column, CompatLevel, KeyValueMetadata, NamedFrom, ParquetWriter, PolarsResult, Schema, SchemaExt as _, Series,
};
use polars_parquet::write::schema_to_metadata_key;
use serde_json::{Map, Value as Json};

use cell::Cell;
pub use cell::SheetRow;

/// The version of what tables' columns are called and mean.
pub const TABLE_FORMAT: u32 = 1;

/// Where the metadata of a Parquet file of ours says its version.
pub const TABLE_MARK: &str = "depthloom.format";

/// The unit of shares and other numbers that have none.
pub(crate) const DIMENSIONLESS: &str = "1";

/// A table: columns of one length, each with its name, and its unit where it has one.
pub(crate) struct Sheet<'a> {
    columns: Vec<SheetColumn<'a>>,
    /// What the metadata of its Parquet file says beside what all tables say: names and texts.
    more_metadata: Vec<(&'static str, String)>,
}

struct SheetColumn<'a> {
    name: String,
    unit: Option<&'static str>,
    cells: Cells<'a>,
}

/// The cells of a column, top to bottom.
pub(crate) enum Cells<'a> {
    Text(Vec<&'a str>),
    /// `None` is an empty cell.
    TextIfAny(Vec<Option<&'a str>>),
    Metres(Vec<u32>),
    Count(Vec<u64>),
    CountIfAny(Vec<Option<u64>>),
    /// Numbers as they were written: CSV has the same text.
    Numeral(Vec<Option<&'a str>>),
    /// The same beside texts, with whether each is a number: JSON has numbers, CSV and Parquet have texts.
    NumeralOrText(Vec<Option<(&'a str, bool)>>),
    /// `None` is an empty cell.
    Number(Vec<Option<f64>>),
}

impl<'a> Sheet<'a> {
    pub(crate) const fn new() -> Self {
        Self { columns: Vec::new(), more_metadata: Vec::new() }
    }

    /// Adds an entry to the metadata of its Parquet file.
    pub(crate) fn with_metadata(mut self, name: &'static str, text: String) -> Self {
        self.more_metadata.push((name, text));
        self
    }

    /// Adds a column on the right.
    pub(crate) fn with(self, name: impl Into<String>, cells: Cells<'a>) -> Self {
        self.with_unit(name, None, cells)
    }

    /// Adds a column on the right: of numbers in this unit, such as `m`, `ns` or `pixels`.
    pub(crate) fn with_unit(
        mut self,
        name: impl Into<String>,
        unit: impl Into<Option<&'static str>>,
        cells: Cells<'a>,
    ) -> Self {
        let (name, unit, height) = (name.into(), unit.into(), self.height());
        assert!(self.columns.is_empty() || cells.len() == height, "`{name}` is as long as the other columns");
        self.columns.push(SheetColumn { name, unit, cells });
        self
    }

    /// Adds a column of a score on the right.
    pub(crate) fn with_score(self, metric: &'static Metric, cells: Cells<'a>) -> Self {
        self.with_unit(metric.name, unit_of(metric), cells)
    }

    /// Adds a column of shares on the right, from 0 to 1.
    pub(crate) fn with_share(self, name: &str, cells: Vec<Option<f64>>) -> Self {
        self.with_unit(name, DIMENSIONLESS, Cells::Number(cells))
    }

    pub(crate) fn height(&self) -> usize {
        self.columns.first().map_or(0, |column| column.cells.len())
    }

    /// Writes it as CSV: numbers with the fewest digits that give the same number again, quotes only where they are needed.
    pub(crate) fn write_csv(&self, out: &mut impl Write) -> io::Result<()> {
        let names: Vec<&str> = self.columns.iter().map(|column| column.name.as_str()).collect();
        writeln!(out, "{}", names.join(","))?;
        self.write_csv_rows(out)
    }

    /// Writes its rows as CSV, without the columns' names.
    pub(crate) fn write_csv_rows(&self, out: &mut impl Write) -> io::Result<()> {
        for row in 0..self.height() {
            for (place, column) in self.columns.iter().enumerate() {
                if place > 0 {
                    out.write_all(b",")?;
                }
                column.cells.write(row, out)?;
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

    /// The cells of a row, each with the name of its column.
    pub(crate) fn row(&self, row: usize) -> impl Iterator<Item = (String, Option<Cell>)> {
        self.columns.iter().map(move |column| (column.name.clone(), column.cells.cell(row)))
    }

    /// Its rows, for programs.
    pub(crate) fn rows(&self) -> Vec<SheetRow> {
        (0..self.height()).map(|row| self.row(row).collect()).collect()
    }

    /// What the metadata of a Parquet file of its columns says: `table` is what the table is called, `run` the key of the plan of the run it is of.
    fn metadata(&self, table: &str, run: &Key) -> Vec<(String, String)> {
        let units = self.columns.iter().filter_map(|column| Some((column.name.as_str(), column.unit?)));
        let mut all = metadata(table, run, units);
        all.extend(self.more_metadata.iter().map(|(name, text)| ((*name).to_owned(), text.clone())));
        all
    }

    /// The bytes of a Parquet file; see [`Sheet::metadata`].
    pub(crate) fn parquet(self, table: &str, run: &Key) -> PolarsResult<Vec<u8>> {
        let whole = self.whole_numerals();
        let mut file = Vec::new();
        let metadata = self.metadata(table, run);
        let part = self.into_frame(&whole)?;
        write_parquet(&mut file, metadata, std::iter::once(Ok(part)))?;
        Ok(file)
    }

    /// By column, whether it has numerals that are all of whole numbers.
    fn whole_numerals(&self) -> Vec<bool> {
        let is_whole = |cell: &Option<&str>| cell.is_none_or(|cell| cell.parse::<i64>().is_ok());
        let are_whole = |column: &SheetColumn<'_>| match &column.cells {
            Cells::Numeral(cells) => cells.iter().all(is_whole),
            _ => false,
        };
        self.columns.iter().map(are_whole).collect()
    }

    /// The table as polars has it; `whole` says of each column whether its numerals are whole numbers.
    fn into_frame(self, whole: &[bool]) -> PolarsResult<DataFrame> {
        let height = self.height();
        let column = |(SheetColumn { name, cells, .. }, whole): (SheetColumn<'_>, &bool)| {
            let name = name.as_str().into();
            Column::from(match cells {
                Cells::Text(cells) => Series::new(name, cells),
                Cells::TextIfAny(cells) => Series::new(name, cells),
                Cells::Metres(cells) => Series::new(name, cells),
                Cells::Count(cells) => Series::new(name, cells),
                Cells::CountIfAny(cells) => Series::new(name, cells),
                Cells::Numeral(cells) if *whole => Series::new(name, parsed::<i64>(&cells)),
                Cells::Numeral(cells) => Series::new(name, parsed::<f64>(&cells)),
                Cells::NumeralOrText(cells) => {
                    Series::new(name, cells.iter().map(|cell| cell.map(|(text, _)| text)).collect::<Vec<_>>())
                }
                Cells::Number(cells) => Series::new(name, cells),
            })
        };
        DataFrame::new(height, self.columns.into_iter().zip(whole).map(column).collect())
    }
}

/// The bytes of a Parquet file of a table that `parts` makes, from top to bottom and twice: memory holds one of its parts, a row group each, and
/// these bytes. There is at least one; all have the same columns.
pub(crate) fn parquet_of_parts<'t, I: Iterator<Item = Sheet<'t>>>(
    parts: impl Fn() -> I,
    table: &str,
    run: &Key,
) -> PolarsResult<Vec<u8>> {
    let (mut whole, mut metadata) = (Vec::new(), None);
    for part in parts() {
        let of_part = part.whole_numerals();
        if metadata.is_none() {
            (whole, metadata) = (of_part, Some(part.metadata(table, run)));
        } else {
            whole.iter_mut().zip(of_part).for_each(|(whole, of_part)| *whole &= of_part);
        }
    }
    let mut file = Vec::new();
    let metadata = metadata.expect("a table has a part, though it may have no row");
    write_parquet(&mut file, metadata, parts().map(|part| part.into_frame(&whole)))?;
    Ok(file)
}

fn write_parquet(
    file: &mut Vec<u8>,
    metadata: Vec<(String, String)>,
    parts: impl Iterator<Item = PolarsResult<DataFrame>>,
) -> PolarsResult<()> {
    let mut parts = parts.peekable();
    let schema = match parts.peek() {
        Some(Ok(first)) => first.schema().clone(),
        _ => return parts.next().map_or(Ok(()), |first| first.map(drop)),
    };
    let metadata = with_arrow_schema(metadata, &schema);
    let writer = ParquetWriter::new(file).set_parallel(false).with_key_value_metadata(Some(metadata));
    let mut writer = writer.batched(&schema)?;
    for part in parts {
        writer.write_batch(&part?)?;
    }
    writer.finish()?;
    Ok(())
}

/// The metadata of a Parquet file, with an Arrow schema in which texts are `large_utf8`.
///
/// The schema that polars writes unless it is given one says `string_view`, which readers older than 2024 refuse (pyarrow 14: "Unrecognized type: 24").
pub(crate) fn with_arrow_schema(mut metadata: Vec<(String, String)>, schema: &Schema) -> KeyValueMetadata {
    let arrow = schema_to_metadata_key(&schema.to_arrow(CompatLevel::oldest()));
    metadata.insert(0, (arrow.key, arrow.value.unwrap_or_default()));
    KeyValueMetadata::from_static(metadata)
}

/// What the metadata of a Parquet file says: which table it is, of the run whose plan has this key, and the units of its columns.
pub(crate) fn metadata<'c>(
    table: &str,
    run: &Key,
    units: impl IntoIterator<Item = (&'c str, &'c str)>,
) -> Vec<(String, String)> {
    let units: Map<String, Json> = units.into_iter().map(|(column, unit)| (column.to_owned(), unit.into())).collect();
    let told = [
        (TABLE_MARK, TABLE_FORMAT.to_string()),
        ("depthloom.table", table.to_owned()),
        ("depthloom.run", run.to_string()),
        ("depthloom.units", Json::Object(units).to_string()),
    ];
    told.map(|(key, value)| (key.to_owned(), value)).to_vec()
}

/// The unit of a score; of shares and of numbers without one, `1`.
pub(crate) const fn unit_of(metric: &Metric) -> &'static str {
    if metric.unit.is_empty() { DIMENSIONLESS } else { metric.unit }
}

fn parsed<T: FromStr>(cells: &[Option<&str>]) -> Vec<Option<T>> {
    cells.iter().map(|cell| cell.and_then(|of| of.parse().ok())).collect()
}

impl Cells<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Text(cells) => cells.len(),
            Self::TextIfAny(cells) => cells.len(),
            Self::Metres(cells) => cells.len(),
            Self::Count(cells) => cells.len(),
            Self::CountIfAny(cells) => cells.len(),
            Self::Numeral(cells) => cells.len(),
            Self::NumeralOrText(cells) => cells.len(),
            Self::Number(cells) => cells.len(),
        }
    }

    fn cell(&self, row: usize) -> Option<Cell> {
        match self {
            Self::Text(cells) => Some(cells[row].into()),
            Self::TextIfAny(cells) => cells[row].map(Cell::from),
            Self::Metres(cells) => Some(u64::from(cells[row]).into()),
            Self::Count(cells) => Some(cells[row].into()),
            Self::CountIfAny(cells) => cells[row].map(Cell::from),
            Self::Numeral(cells) => cells[row].and_then(Cell::numeral),
            Self::NumeralOrText(cells) => match cells[row]? {
                (number, true) => Cell::numeral(number),
                (text, false) => Some(text.into()),
            },
            Self::Number(cells) => cells[row].and_then(Cell::number),
        }
    }

    fn write(&self, row: usize, out: &mut impl Write) -> io::Result<()> {
        match self {
            Self::Text(cells) => write_text(cells[row], out),
            Self::TextIfAny(cells) => cells[row].map_or(Ok(()), |text| write_text(text, out)),
            Self::Metres(cells) => write!(out, "{}", cells[row]),
            Self::Count(cells) => write!(out, "{}", cells[row]),
            Self::CountIfAny(cells) => cells[row].map_or(Ok(()), |count| write!(out, "{count}")),
            Self::Numeral(cells) => cells[row].map_or(Ok(()), |numeral| out.write_all(numeral.as_bytes())),
            Self::NumeralOrText(cells) => cells[row].map_or(Ok(()), |(text, _)| write_text(text, out)),
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
    use std::io::Cursor;

    use polars::prelude::{DataType, ParallelStrategy, ParquetReader, SerReader as _};

    use super::*;

    #[test]
    fn cells_are_written_as_other_programs_read_them() {
        let numbers = vec![Some(0.1 + 0.2), Some(1.0), Some(1e-7), Some(1e300), None, Some(f64::NAN)];
        let sheet = Sheet::new()
            .with("name", Cells::Text(vec!["a/b", "two, three", "\"q\"", "", "ä", "x"]))
            .with("variant", Cells::TextIfAny(vec![Some("a,b"), None, None, None, None, Some("full")]))
            .with("bin_m", Cells::Metres((0..6).collect()))
            .with("median", Cells::CountIfAny(vec![Some(5), None, None, None, None, None]))
            .with("score", Cells::Number(numbers));
        let mut bytes = Vec::new();
        sheet.write_csv(&mut bytes).unwrap();
        let expected = "name,variant,bin_m,median,score\na/b,\"a,b\",0,5,0.30000000000000004\n\"two, three\",,1,,1.0\n\
                        \"\"\"q\"\"\",,2,,1e-7\n\"\",,3,,1e+300\nä,,4,,\nx,full,5,,NaN\n";
        assert_eq!(String::from_utf8(bytes).unwrap(), expected);
        let row = serde_json::json!({ "name": "", "variant": null, "bin_m": 3, "median": null, "score": 1e300 });
        let rows = serde_json::to_value(sheet.rows()).unwrap();
        assert_eq!(rows[3], row);
        assert!(rows[5]["score"].is_null(), "JSON has no NaN");
    }

    #[test]
    fn a_parquet_file_says_what_it_is_and_what_its_numbers_are_in() {
        let sheet = Sheet::new()
            .with("stage", Cells::Text(vec!["s"]))
            .with_score(Metric::named("rmse").unwrap(), Cells::Number(vec![Some(0.5)]))
            .with_share("density", vec![None]);
        let key = Key::of_content(b"a plan");
        let mut reader = ParquetReader::new(Cursor::new(sheet.parquet("scores", &key).unwrap()));
        let told = reader.get_metadata().unwrap().key_value_metadata().clone().unwrap();
        let of = |name: &str| told.iter().find(|pair| pair.key == name).and_then(|pair| pair.value.clone()).unwrap();
        assert_eq!(
            ["format", "table", "run"].map(|name| of(&format!("depthloom.{name}"))),
            ["1".to_owned(), "scores".to_owned(), key.to_string()]
        );
        assert_eq!(of("depthloom.units"), r#"{"rmse":"m","density":"1"}"#);
        // Texts are of a type that every reader of Parquet knows, not `string_view`.
        let table = DataFrame::new(0, vec![Column::new_empty("stage".into(), &DataType::String)]).unwrap();
        let types = |level| table.schema().to_arrow(level).get_at_index(0).map(|(_, field)| field.dtype().clone());
        assert_eq!(format!("{:?}", types(CompatLevel::oldest()).unwrap()), "LargeUtf8");
        let schema = |level| {
            let mut schema = table.schema().to_arrow(level);
            for (name, number) in [("rmse", DataType::Float64), ("density", DataType::Float64)] {
                schema.insert(name.into(), number.to_arrow_field(name.into(), level));
            }
            schema_to_metadata_key(&schema).value.unwrap()
        };
        assert_eq!(of("ARROW:schema"), schema(CompatLevel::oldest()));
        assert_ne!(of("ARROW:schema"), schema(CompatLevel::newest()));
        assert_eq!(reader.read_parallel(ParallelStrategy::None).finish().unwrap().shape(), (1, 3));
    }

    #[test]
    fn parts_make_the_table_that_they_are_parts_of() {
        let numerals = ["1", "2", "0.5"].map(Some);
        let part = |rows: std::ops::Range<usize>| {
            Sheet::new()
                .with("block", Cells::Numeral(numerals[rows.clone()].to_vec()))
                .with("count", Cells::Count(rows.map(|row| row as u64).collect()))
        };
        let key = Key::of_content(b"a plan");
        let read = |bytes: Vec<u8>| {
            let reader = ParquetReader::new(Cursor::new(bytes)).read_parallel(ParallelStrategy::None);
            reader.finish().unwrap()
        };
        let whole = read(part(0..3).parquet("table", &key).unwrap());
        // The first part alone would be of whole numbers.
        let parts = || [0..2, 2..3].into_iter().map(part);
        assert!(read(parquet_of_parts(parts, "table", &key).unwrap()).equals(&whole));
        let none = read(parquet_of_parts(|| std::iter::once(part(0..0)), "table", &key).unwrap());
        assert_eq!(none.shape(), (0, 2));
    }
}
