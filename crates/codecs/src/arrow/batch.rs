//! Record batches of one row that are read.

use std::ops::Range;

use super::flat::Table;
use super::types::{DataType, Field, Offsets, Schema};

/// A record batch of one row.
#[derive(Debug)]
pub struct Batch {
    columns: Vec<Column>,
    body: Vec<u8>,
}

#[derive(Debug)]
struct Column {
    length: usize,
    buffers: Vec<Range<usize>>,
    children: Vec<Column>,
}

/// A field of a batch, in the row of a struct or the list around it.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// The field.
    pub field: &'a Field,
    column: &'a Column,
    body: &'a [u8],
}

/// The nodes and buffers of a batch that no field has consumed yet.
struct Left<'a> {
    nodes: &'a [[i64; 2]],
    buffers: &'a [[i64; 2]],
    body: usize,
}

impl Batch {
    pub(super) fn decode(schema: &Schema, header: &Table<'_>, body: Vec<u8>) -> Result<Self, String> {
        let rows = header.i64(0)?;
        if rows != 1 {
            return Err(format!("a batch has {rows} rows, and 1 is what a call has"));
        }
        if header.has(3) {
            return Err("a batch is compressed, which is not supported".to_owned());
        }
        let (nodes, buffers) = (header.pairs(1)?, header.pairs(2)?);
        let mut left = Left { nodes: &nodes, buffers: &buffers, body: body.len() };
        let columns = schema.fields.iter().map(|field| left.column(field, Some(1))).collect::<Result<_, _>>()?;
        Ok(Self { columns, body })
    }

    /// How many bytes its values take.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.body.len()
    }

    /// A column; `None` if it is absent or null.
    #[must_use]
    pub fn column<'a>(&'a self, schema: &'a Schema, name: &str) -> Option<View<'a>> {
        let place = schema.fields.iter().position(|field| field.name == name)?;
        let view = View { field: &schema.fields[place], column: &self.columns[place], body: &self.body };
        (!view.is_null(0)).then_some(view)
    }
}

impl Left<'_> {
    fn column(&mut self, field: &Field, length: Option<usize>) -> Result<Column, String> {
        let ([node, nodes @ ..], name) = (self.nodes, &field.name) else {
            return Err(format!("a batch ends before column `{}`", field.name));
        };
        self.nodes = nodes;
        let rows = usize::try_from(node[0]).map_err(|_| format!("column `{name}` has {} rows", node[0]))?;
        if length.is_some_and(|length| length != rows) {
            return Err(format!("column `{name}` has {rows} rows, and 1 is what a call has"));
        }
        let mut buffers = vec![self.buffer(name, rows.div_ceil(8), true)?];
        let wide = |offsets: &Offsets| if *offsets == Offsets::Wide { 8 } else { 4 };
        // Of nothing there may be no offsets at all.
        let offsets = |width: &Offsets| if rows == 0 { 0 } else { rows.saturating_add(1).saturating_mul(wide(width)) };
        let mut children = Vec::new();
        match &field.data_type {
            DataType::Bool => buffers.push(self.buffer(name, rows.div_ceil(8), false)?),
            DataType::Int(bits, _) | DataType::Float(bits) => {
                let bytes = rows.saturating_mul(usize::from(*bits) / 8);
                buffers.push(self.buffer(name, bytes, false)?);
            }
            DataType::Utf8(width) | DataType::Binary(width) => {
                buffers.push(self.buffer(name, offsets(width), false)?);
                buffers.push(self.buffer(name, 0, false)?);
            }
            DataType::List(width, item) => {
                buffers.push(self.buffer(name, offsets(width), false)?);
                children.push(self.column(item, None)?);
            }
            DataType::Struct(fields) => {
                for field in fields {
                    children.push(self.column(field, length)?);
                }
            }
        }
        Ok(Column { length: rows, buffers, children })
    }

    /// The next buffer, of at least `least` bytes, or empty if it may be left out.
    fn buffer(&mut self, name: &str, least: usize, may_be_none: bool) -> Result<Range<usize>, String> {
        let [buffer, buffers @ ..] = self.buffers else {
            return Err(format!("a batch ends before the values of column `{name}`"));
        };
        self.buffers = buffers;
        let range = || {
            let (start, length) = (usize::try_from(buffer[0]).ok()?, usize::try_from(buffer[1]).ok()?);
            let end = start.checked_add(length)?;
            (end <= self.body).then_some(start..end)
        };
        let range = range().ok_or_else(|| format!("the values of column `{name}` lie outside of the batch"))?;
        if range.len() < least && !(may_be_none && range.is_empty()) {
            return Err(format!("column `{name}` has {} bytes of values, and {least} are needed", range.len()));
        }
        Ok(range)
    }
}

impl<'a> View<'a> {
    fn buffer(&self, index: usize) -> &'a [u8] {
        self.body.get(self.column.buffers[index].clone()).unwrap_or_default()
    }

    fn is_null(&self, row: usize) -> bool {
        let validity = self.buffer(0);
        validity.get(row / 8).is_some_and(|byte| byte >> (row % 8) & 1 == 0)
    }

    fn wrong(&self, wanted: &str) -> String {
        format!("`{}` is of type {}, expected {wanted}", self.field.name, self.field.data_type)
    }

    /// A part of a struct; `None` if it is absent or null.
    #[must_use]
    pub fn part(&self, name: &str) -> Option<Self> {
        let DataType::Struct(fields) = &self.field.data_type else { return None };
        let place = fields.iter().position(|field| field.name == name)?;
        let view = Self { field: &fields[place], column: &self.column.children[place], body: self.body };
        (!view.is_null(0)).then_some(view)
    }

    /// The parts of a struct, null or not.
    pub fn parts(&self) -> Result<&'a [Field], String> {
        match &self.field.data_type {
            DataType::Struct(fields) => Ok(fields),
            _ => Err(self.wrong("a struct")),
        }
    }

    /// A whole number.
    pub fn int(&self) -> Result<i64, String> {
        match self.field.data_type {
            DataType::Int(bits, signed) if bits < 64 || signed => {
                let mut bytes = [0; 8];
                let size = usize::from(bits) / 8;
                bytes[..size].copy_from_slice(&self.buffer(1)[..size]);
                let shift = 64 - u32::from(bits);
                let value = i64::from_le_bytes(bytes) << shift;
                Ok(if signed { value >> shift } else { ((value as u64) >> shift) as i64 })
            }
            _ => Err(self.wrong("int64")),
        }
    }

    /// A number of 64 bits.
    pub fn float(&self) -> Result<f64, String> {
        match self.field.data_type {
            DataType::Float(64) => {
                let bytes = self.buffer(1).first_chunk().copied().unwrap_or_default();
                Ok(f64::from_le_bytes(bytes))
            }
            _ => Err(self.wrong("float64")),
        }
    }

    /// Where a row of texts, bytes or a list begins and ends.
    fn range(&self, width: Offsets, row: usize, most: usize) -> Result<Range<usize>, String> {
        let offset = |at: usize| match width {
            Offsets::Narrow => {
                let bytes = self.buffer(1).get(4 * at..)?.first_chunk()?;
                usize::try_from(i32::from_le_bytes(*bytes)).ok()
            }
            Offsets::Wide => {
                let bytes = self.buffer(1).get(8 * at..)?.first_chunk()?;
                usize::try_from(i64::from_le_bytes(*bytes)).ok()
            }
        };
        let range = offset(row).zip(offset(row + 1)).map(|(start, end)| start..end);
        let range = range.filter(|range| range.start <= range.end && range.end <= most);
        range.ok_or_else(|| format!("the offsets of `{}` lead out of its values", self.field.name))
    }

    /// A text.
    pub fn text(&self) -> Result<&'a str, String> {
        self.text_at(0)
    }

    fn text_at(&self, row: usize) -> Result<&'a str, String> {
        let DataType::Utf8(width) = self.field.data_type else { return Err(self.wrong("string")) };
        let bytes = self.buffer(2);
        let range = self.range(width, row, bytes.len())?;
        str::from_utf8(&bytes[range]).map_err(|_| format!("`{}` is not UTF-8", self.field.name))
    }

    /// Bytes.
    pub fn bytes(&self) -> Result<&'a [u8], String> {
        let DataType::Binary(width) = self.field.data_type else { return Err(self.wrong("large_binary")) };
        let bytes = self.buffer(2);
        Ok(&bytes[self.range(width, 0, bytes.len())?])
    }

    fn list(&self, wanted: &DataType) -> Result<(Self, Range<usize>), String> {
        let error = || self.wrong(&format!("list<{wanted}>"));
        let DataType::List(width, item) = &self.field.data_type else { return Err(error()) };
        if item.data_type != *wanted {
            return Err(error());
        }
        let items = Self { field: item, column: &self.column.children[0], body: self.body };
        let range = self.range(*width, 0, items.column.length)?;
        // A null would be read as the bytes that happen to be there.
        if !items.buffer(0).is_empty() && range.clone().any(|row| items.is_null(row)) {
            return Err(format!("an item of `{}` is null", self.field.name));
        }
        Ok((items, range))
    }

    fn numbers<T, const N: usize>(&self, wanted: &DataType, number: fn([u8; N]) -> T) -> Result<Vec<T>, String> {
        let (items, range) = self.list(wanted)?;
        let bytes = &items.buffer(1)[range.start * N..range.end * N];
        Ok(bytes.as_chunks().0.iter().map(|bytes| number(*bytes)).collect())
    }

    /// A list of bytes.
    pub fn u8s(&self) -> Result<&'a [u8], String> {
        let (items, range) = self.list(&DataType::Int(8, false))?;
        Ok(&items.buffer(1)[range])
    }

    /// A list of 16-bit integers.
    pub fn i16s(&self) -> Result<Vec<i16>, String> {
        self.numbers(&DataType::Int(16, true), i16::from_le_bytes)
    }

    /// A list of 16-bit integers without a sign.
    pub fn u16s(&self) -> Result<Vec<u16>, String> {
        self.numbers(&DataType::Int(16, false), u16::from_le_bytes)
    }

    /// A list of 64-bit integers.
    pub fn i64s(&self) -> Result<Vec<i64>, String> {
        self.numbers(&DataType::Int(64, true), i64::from_le_bytes)
    }

    /// A list of 32-bit floats.
    pub fn f32s(&self) -> Result<Vec<f32>, String> {
        self.numbers(&DataType::Float(32), f32::from_le_bytes)
    }

    /// A list of 64-bit floats.
    pub fn f64s(&self) -> Result<Vec<f64>, String> {
        self.numbers(&DataType::Float(64), f64::from_le_bytes)
    }

    /// A list of texts.
    pub fn texts(&self) -> Result<Vec<&'a str>, String> {
        let wide =
            matches!(&self.field.data_type, DataType::List(_, item) if item.data_type == DataType::Utf8(Offsets::Wide));
        let (items, range) = self.list(&DataType::Utf8(if wide { Offsets::Wide } else { Offsets::Narrow }))?;
        range.map(|row| items.text_at(row)).collect()
    }
}
