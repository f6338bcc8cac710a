//! A table as a Parquet file, whose metadata has: `depthloom.format` (the version of these columns), `depthloom.table`
//! (which table it is), `depthloom.run` (the [key](crate::plan_key) of the run's plan) and `depthloom.units` (a JSON
//! object, column to unit).
//!
//! polars writes and reads Parquet, but without starting threads: tables are small, and if a system refuses new
//! threads, polars' pools panic or wait indefinitely. Its CSV writer always starts threads.

use std::str::FromStr;

use depthloom_graphs::Key;
use polars::frame::DataFrame;
use polars::prelude::{
    Column, CompatLevel, KeyValueMetadata, NamedFrom, ParquetWriter, PolarsResult, Schema, SchemaExt as _, Series,
};
use polars_parquet::write::schema_to_metadata_key;
use serde_json::{Map, Value as Json};

use super::column::Value;
use super::row_key::is_reserved;
use super::{Cells, Table};
use crate::error::{AnalysisError, caught};

/// The version of the names and meanings of columns.
pub const TABLE_FORMAT: u32 = 2;

/// The metadata key of the version in Parquet files.
pub const TABLE_MARK: &str = "depthloom.format";

impl Table {
    /// The bytes of a Parquet file with the columns of [`Table::csv`]. `run` is the key of the run's plan.
    ///
    /// # Errors
    /// If polars fails.
    pub fn parquet(&self, name: &str, run: &Key) -> Result<Vec<u8>, AnalysisError> {
        caught(|| parquet_of_parts(|| std::iter::once(self), name, run).map_err(AnalysisError::compute("the table")))
    }

    fn file_metadata(&self, name: &str, run: &Key) -> Vec<(String, String)> {
        let has_axes = self.in_files().any(|column| column.is_axis);
        let is_known = |column: &super::Column| {
            let name = column.name.as_str();
            column.is_axis
                || is_reserved(name.strip_suffix("_low").or_else(|| name.strip_suffix("_high")).unwrap_or(name))
        };
        debug_assert!(
            !has_axes || self.in_files().all(is_known),
            "{name} has a column that an axis may have the name of"
        );
        let units = self.in_files().filter_map(|column| Some((column.name.as_str(), column.unit?)));
        let mut all = file_metadata(name, run, units);
        all.extend(self.metadata.iter().map(|(name, text)| ((*name).to_owned(), text.clone())));
        all
    }

    /// For each column, whether it has levels that are all integers.
    fn whole_levels(&self) -> Vec<bool> {
        let is_whole = |level: &Value| level.is_number && level.text.parse::<i64>().is_ok();
        let are_whole = |cells: &Cells| matches!(cells, Cells::Levels(cells) if cells.iter().flatten().all(is_whole));
        self.in_files().map(|column| are_whole(&column.cells)).collect()
    }

    fn data_frame(&self, whole_levels: &[bool]) -> PolarsResult<DataFrame> {
        let columns = self.in_files().zip(whole_levels).map(|(column, are_whole)| {
            let name = column.name.as_str().into();
            Column::from(match &column.cells {
                Cells::Text(cells) => Series::new(name, cells.iter().map(Option::as_deref).collect::<Vec<_>>()),
                Cells::Levels(cells) if *are_whole => Series::new(name, parsed::<i64>(cells)),
                Cells::Levels(cells) if cells.iter().flatten().all(|level| level.is_number) => {
                    Series::new(name, parsed::<f64>(cells))
                }
                Cells::Levels(cells) => {
                    let texts = cells.iter().map(|level| level.as_ref().map(|level| level.text.as_str()));
                    Series::new(name, texts.collect::<Vec<_>>())
                }
                Cells::Metres(cells) => Series::new(name, cells),
                Cells::Count(cells) => Series::new(name, cells),
                Cells::Number(cells, _) => Series::new(name, cells),
                Cells::Interval(cells, _) => Series::new_null(name, cells.len()),
            })
        });
        DataFrame::new(self.height(), columns.collect())
    }
}

fn parsed<T: FromStr>(levels: &[Option<Value>]) -> Vec<Option<T>> {
    levels.iter().map(|level| level.as_ref().and_then(|level| level.text.parse().ok())).collect()
}

/// The bytes of a Parquet file of a table that `parts` yields from top to bottom; it is called twice. Each part becomes
/// a row group, and only one part is in memory at a time. There must be at least one part; all parts have the same
/// columns.
pub(crate) fn parquet_of_parts<T: AsRef<Table>, I: Iterator<Item = T>>(
    parts: impl Fn() -> I,
    name: &str,
    run: &Key,
) -> PolarsResult<Vec<u8>> {
    let (mut whole, mut metadata) = (Vec::new(), None);
    for part in parts() {
        let part_levels = part.as_ref().whole_levels();
        if metadata.is_none() {
            (whole, metadata) = (part_levels, Some(part.as_ref().file_metadata(name, run)));
        } else {
            whole.iter_mut().zip(part_levels).for_each(|(whole, own)| *whole &= own);
        }
    }
    let mut frames = parts().map(|part| part.as_ref().data_frame(&whole)).peekable();
    let metadata = metadata.expect("a table has at least one part");
    let schema = match frames.peek() {
        Some(Ok(first)) => first.schema().clone(),
        _ => return frames.next().map_or(Ok(Vec::new()), |first| first.map(|_| Vec::new())),
    };
    let mut file = Vec::new();
    let metadata = with_arrow_schema(metadata, &schema);
    let writer = ParquetWriter::new(&mut file).set_parallel(false).with_key_value_metadata(Some(metadata));
    let mut writer = writer.batched(&schema)?;
    for frame in frames {
        writer.write_batch(&frame?)?;
    }
    writer.finish()?;
    Ok(file)
}

impl AsRef<Self> for Table {
    fn as_ref(&self) -> &Self {
        self
    }
}

/// The metadata of a Parquet file, with an Arrow schema in which texts are `large_utf8`.
///
/// By default polars writes a schema with `string_view`, which readers from before 2024 refuse (pyarrow 14:
/// "Unrecognized type: 24").
pub(crate) fn with_arrow_schema(mut metadata: Vec<(String, String)>, schema: &Schema) -> KeyValueMetadata {
    let arrow = schema_to_metadata_key(&schema.to_arrow(CompatLevel::oldest()));
    metadata.insert(0, (arrow.key, arrow.value.unwrap_or_default()));
    KeyValueMetadata::from_static(metadata)
}

/// The metadata of a Parquet file: the name of the table, the key of the run's plan, and the units of columns.
pub(crate) fn file_metadata<'c>(
    table: &str,
    run: &Key,
    units: impl IntoIterator<Item = (&'c str, &'c str)>,
) -> Vec<(String, String)> {
    let units: Map<String, Json> = units.into_iter().map(|(column, unit)| (column.to_owned(), unit.into())).collect();
    let entries = [
        (TABLE_MARK, TABLE_FORMAT.to_string()),
        ("depthloom.table", table.to_owned()),
        ("depthloom.run", run.to_string()),
        ("depthloom.units", Json::Object(units).to_string()),
    ];
    entries.map(|(key, value)| (key.to_owned(), value)).to_vec()
}
