//! Record batches of one row.

use std::borrow::Cow;
use std::io::{self, Write};
use std::ops::Range;

use super::flat::{Slot, Table};
use super::types::{DataType, Field, Offsets, RECORD_BATCH, Schema, message};

/// The value of a field in the row that is written.
#[derive(Clone, Debug)]
pub enum Data<'a> {
    /// None.
    Null,
    /// A whole number.
    Int(i64),
    /// A number.
    Float(f64),
    /// A text.
    Text(Cow<'a, str>),
    /// Bytes.
    Bytes(&'a [u8]),
    /// A list.
    List(Items<'a>),
    /// The parts of a struct, in the order of its fields.
    Struct(Vec<Data<'a>>),
}

/// The items of a list.
#[derive(Clone, Debug)]
pub enum Items<'a> {
    /// Bytes.
    U8(&'a [u8]),
    /// Whole numbers of 16 bits.
    I16(&'a [i16]),
    /// Whole numbers of 64 bits.
    I64(Vec<i64>),
    /// Numbers of 32 bits.
    F32(&'a [f32]),
    /// Numbers of 64 bits.
    F64(Vec<f64>),
    /// Texts.
    Text(Vec<String>),
}

/// Where buffers begin in a body: a multiple of this many bytes, as Arrow recommends.
const ALIGNMENT: usize = 64;

/// A record batch as it goes over the wire: large buffers are those of the values.
pub struct Encoded<'a> {
    head: Vec<u8>,
    parts: Vec<Cow<'a, [u8]>>,
}

#[derive(Default)]
struct Body<'a> {
    nodes: Vec<[i64; 2]>,
    buffers: Vec<[i64; 2]>,
    parts: Vec<Cow<'a, [u8]>>,
    bytes: usize,
}

/// Lays a row out.
///
/// # Panics
/// If the row does not fit the schema: whoever writes it makes both.
#[must_use]
pub fn encode<'a>(schema: &Schema, row: Vec<Data<'a>>) -> Encoded<'a> {
    assert_eq!(schema.fields.len(), row.len(), "a value a column");
    let mut body = Body::default();
    for (field, data) in schema.fields.iter().zip(row) {
        body.put(field, data);
    }
    let (mut writer, header) = message(RECORD_BATCH, body.bytes as i64);
    let places = writer.table(header, &[Slot::I64(1), Slot::Offset, Slot::Offset]);
    writer.pairs(places[0], &body.nodes);
    writer.pairs(places[1], &body.buffers);
    Encoded { head: framed(&writer.finish()), parts: body.parts }
}

/// A message with what stands before it in a stream.
pub(super) fn framed(message: &[u8]) -> Vec<u8> {
    // Values begin at a multiple of that too, where the message lies in memory.
    let length = (8 + message.len()).next_multiple_of(ALIGNMENT) - 8;
    let mut framed = Vec::with_capacity(8 + length);
    framed.extend(u32::MAX.to_le_bytes());
    framed.extend((length as u32).to_le_bytes());
    framed.extend(message);
    framed.resize(8 + length, 0);
    framed
}

impl Encoded<'_> {
    /// How many bytes are written.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.head.len() + self.parts.iter().map(|part| part.len() + padding(part.len())).sum::<usize>()
    }

    /// Writes it.
    ///
    /// # Errors
    /// What the writer says.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        // Small pieces are gathered, large ones written from where they lie.
        let mut small = self.head.clone();
        for part in &self.parts {
            if part.len() < 16 << 10 {
                small.extend_from_slice(part);
            } else {
                out.write_all(&small)?;
                out.write_all(part)?;
                small.clear();
            }
            small.resize(small.len() + padding(part.len()), 0);
        }
        out.write_all(&small)?;
        out.flush()
    }
}

const fn padding(bytes: usize) -> usize {
    bytes.next_multiple_of(ALIGNMENT) - bytes
}

impl<'a> Body<'a> {
    fn buffer(&mut self, bytes: Cow<'a, [u8]>) {
        self.buffers.push([self.bytes as i64, bytes.len() as i64]);
        self.bytes += bytes.len() + padding(bytes.len());
        self.parts.push(bytes);
    }

    /// A field's length, and that all of it is there, or nothing is.
    fn node(&mut self, length: usize, is_null: bool) {
        self.nodes.push([length as i64, if is_null { length as i64 } else { 0 }]);
        let validity: Vec<u8> = if is_null { vec![0; length.div_ceil(8)] } else { Vec::new() };
        self.buffer(validity.into());
    }

    fn offsets(&mut self, width: Offsets, offsets: impl IntoIterator<Item = usize>) {
        let bytes: Vec<u8> = match width {
            Offsets::Narrow => offsets.into_iter().flat_map(|offset| (offset as i32).to_le_bytes()).collect(),
            Offsets::Wide => offsets.into_iter().flat_map(|offset| (offset as i64).to_le_bytes()).collect(),
        };
        self.buffer(bytes.into());
    }

    fn put(&mut self, field: &Field, data: Data<'a>) {
        let is_null = matches!(data, Data::Null);
        self.node(1, is_null);
        match (&field.data_type, data) {
            (DataType::Int(bits, _), Data::Null) => self.buffer(vec![0; usize::from(*bits) / 8].into()),
            (DataType::Int(bits, _), Data::Int(value)) => {
                self.buffer(value.to_le_bytes()[..usize::from(*bits) / 8].to_vec().into());
            }
            (DataType::Float(64), Data::Null) => self.buffer(vec![0; 8].into()),
            (DataType::Float(64), Data::Float(value)) => self.buffer(value.to_le_bytes().to_vec().into()),
            (DataType::Utf8(width) | DataType::Binary(width), Data::Null) => {
                self.offsets(*width, [0, 0]);
                self.buffer(Cow::Borrowed(&[]));
            }
            (DataType::Utf8(width), Data::Text(text)) => {
                self.offsets(*width, [0, text.len()]);
                self.buffer(match text {
                    Cow::Borrowed(text) => text.as_bytes().into(),
                    Cow::Owned(text) => text.into_bytes().into(),
                });
            }
            (DataType::Binary(width), Data::Bytes(bytes)) => {
                self.offsets(*width, [0, bytes.len()]);
                self.buffer(bytes.into());
            }
            (DataType::List(width, item), Data::Null) => {
                self.offsets(*width, [0, 0]);
                self.nothing(item);
            }
            (DataType::List(width, item), Data::List(items)) => {
                self.offsets(*width, [0, items.len()]);
                self.node(items.len(), false);
                self.items(item, items);
            }
            (DataType::Struct(fields), Data::Null) => fields.iter().for_each(|field| self.put(field, Data::Null)),
            (DataType::Struct(fields), Data::Struct(parts)) => {
                assert_eq!(fields.len(), parts.len(), "a value a field");
                fields.iter().zip(parts).for_each(|(field, part)| self.put(field, part));
            }
            (data_type, data) => unreachable!("{data:?} is no {data_type}"),
        }
    }

    /// An empty list's items.
    fn nothing(&mut self, item: &Field) {
        self.node(0, false);
        match &item.data_type {
            DataType::Utf8(width) | DataType::Binary(width) => {
                self.offsets(*width, [0]);
                self.buffer(Cow::Borrowed(&[]));
            }
            _ => self.buffer(Cow::Borrowed(&[])),
        }
    }

    fn items(&mut self, item: &Field, items: Items<'a>) {
        fn little<T: bytemuck::NoUninit>(items: &[T]) -> &[u8] {
            const { assert!(cfg!(target_endian = "little"), "the numbers of values are written as they lie") };
            bytemuck::cast_slice(items)
        }
        match items {
            Items::U8(items) => self.buffer(items.into()),
            Items::I16(items) => self.buffer(little(items).into()),
            Items::F32(items) => self.buffer(little(items).into()),
            Items::I64(items) => self.buffer(little(&items).to_vec().into()),
            Items::F64(items) => self.buffer(little(&items).to_vec().into()),
            Items::Text(items) => {
                let DataType::Utf8(width) = item.data_type else { unreachable!("texts are texts") };
                let ends = items.iter().scan(0, |end, text| {
                    *end += text.len();
                    Some(*end)
                });
                self.offsets(width, [0].into_iter().chain(ends));
                self.buffer(items.concat().into_bytes().into());
            }
        }
    }
}

impl Items<'_> {
    fn len(&self) -> usize {
        match self {
            Self::U8(items) => items.len(),
            Self::I16(items) => items.len(),
            Self::I64(items) => items.len(),
            Self::F32(items) => items.len(),
            Self::F64(items) => items.len(),
            Self::Text(items) => items.len(),
        }
    }
}

/// A record batch of one row that was read.
#[derive(Debug)]
pub struct Batch {
    columns: Vec<Column>,
    body: Vec<u8>,
}

/// Where a field's values lie in the body.
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

/// The nodes and buffers of a batch that no field has taken yet.
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
            return Err("a batch is compressed, which is not read".to_owned());
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

    /// A column; `None` if there is none of that name, or it is null.
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

    /// The next buffer, of at least so many bytes, or, if it may be left out, none.
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

    /// Whether there is no value in a row.
    fn is_null(&self, row: usize) -> bool {
        let validity = self.buffer(0);
        validity.get(row / 8).is_some_and(|byte| byte >> (row % 8) & 1 == 0)
    }

    fn wrong(&self, wanted: &str) -> String {
        format!("`{}` is of type {}, and {wanted} is wanted", self.field.name, self.field.data_type)
    }

    /// A part of a struct; `None` if it has none of that name, or it is null.
    #[must_use]
    pub fn part(&self, name: &str) -> Option<Self> {
        let DataType::Struct(fields) = &self.field.data_type else { return None };
        let place = fields.iter().position(|field| field.name == name)?;
        let view = Self { field: &fields[place], column: &self.column.children[place], body: self.body };
        (!view.is_null(0)).then_some(view)
    }

    /// The parts of a struct, null or not.
    ///
    /// # Errors
    /// If it is none.
    pub fn parts(&self) -> Result<&'a [Field], String> {
        match &self.field.data_type {
            DataType::Struct(fields) => Ok(fields),
            _ => Err(self.wrong("a struct")),
        }
    }

    /// A whole number.
    ///
    /// # Errors
    /// If it is none of 64 bits or fewer.
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
    ///
    /// # Errors
    /// If it is none.
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
    ///
    /// # Errors
    /// If it is none.
    pub fn text(&self) -> Result<&'a str, String> {
        self.text_at(0)
    }

    fn text_at(&self, row: usize) -> Result<&'a str, String> {
        let DataType::Utf8(width) = self.field.data_type else { return Err(self.wrong("string")) };
        let bytes = self.buffer(2);
        let range = self.range(width, row, bytes.len())?;
        str::from_utf8(&bytes[range]).map_err(|_| format!("`{}` is no UTF-8", self.field.name))
    }

    /// Bytes.
    ///
    /// # Errors
    /// If it is none.
    pub fn bytes(&self) -> Result<&'a [u8], String> {
        let DataType::Binary(width) = self.field.data_type else { return Err(self.wrong("large_binary")) };
        let bytes = self.buffer(2);
        Ok(&bytes[self.range(width, 0, bytes.len())?])
    }

    /// The items of a list, and which of them are of it.
    fn list(&self, wanted: &DataType) -> Result<(Self, Range<usize>), String> {
        let error = || self.wrong(&format!("list<{wanted}>"));
        let DataType::List(width, item) = &self.field.data_type else { return Err(error()) };
        if item.data_type != *wanted {
            return Err(error());
        }
        let items = Self { field: item, column: &self.column.children[0], body: self.body };
        let range = self.range(*width, 0, items.column.length)?;
        // What is null would be read as whatever lies there.
        if !items.buffer(0).is_empty() && range.clone().any(|row| items.is_null(row)) {
            return Err(format!("an item of `{}` is null", self.field.name));
        }
        Ok((items, range))
    }

    /// The bytes of a list's numbers, each of so many bytes.
    fn numbers(&self, wanted: &DataType, size: usize) -> Result<&'a [u8], String> {
        let (items, range) = self.list(wanted)?;
        Ok(&items.buffer(1)[range.start * size..range.end * size])
    }

    /// A list of bytes.
    ///
    /// # Errors
    /// If it is none.
    pub fn u8s(&self) -> Result<&'a [u8], String> {
        self.numbers(&DataType::Int(8, false), 1)
    }

    /// A list of whole numbers of 16 bits.
    ///
    /// # Errors
    /// If it is none.
    pub fn i16s(&self) -> Result<Vec<i16>, String> {
        let bytes = self.numbers(&DataType::Int(16, true), 2)?;
        Ok(bytes.as_chunks().0.iter().map(|bytes| i16::from_le_bytes(*bytes)).collect())
    }

    /// A list of whole numbers of 16 bits without a sign.
    ///
    /// # Errors
    /// If it is none.
    pub fn u16s(&self) -> Result<Vec<u16>, String> {
        let bytes = self.numbers(&DataType::Int(16, false), 2)?;
        Ok(bytes.as_chunks().0.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect())
    }

    /// A list of whole numbers of 64 bits.
    ///
    /// # Errors
    /// If it is none.
    pub fn i64s(&self) -> Result<Vec<i64>, String> {
        let bytes = self.numbers(&DataType::Int(64, true), 8)?;
        Ok(bytes.as_chunks().0.iter().map(|bytes| i64::from_le_bytes(*bytes)).collect())
    }

    /// A list of numbers of 32 bits.
    ///
    /// # Errors
    /// If it is none.
    pub fn f32s(&self) -> Result<Vec<f32>, String> {
        let bytes = self.numbers(&DataType::Float(32), 4)?;
        Ok(bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    }

    /// A list of numbers of 64 bits.
    ///
    /// # Errors
    /// If it is none.
    pub fn f64s(&self) -> Result<Vec<f64>, String> {
        let bytes = self.numbers(&DataType::Float(64), 8)?;
        Ok(bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
    }

    /// A list of texts.
    ///
    /// # Errors
    /// If it is none.
    pub fn texts(&self) -> Result<Vec<&'a str>, String> {
        let wide =
            matches!(&self.field.data_type, DataType::List(_, item) if item.data_type == DataType::Utf8(Offsets::Wide));
        let (items, range) = self.list(&DataType::Utf8(if wide { Offsets::Wide } else { Offsets::Narrow }))?;
        range.map(|row| items.text_at(row)).collect()
    }
}
