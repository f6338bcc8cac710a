//! Rows that are written: a record batch each.

use std::borrow::Cow;
use std::io::{self, Write};

use super::flat::Slot;
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

/// A record batch as it is sent: large buffers are those of the values.
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

/// Encodes a row.
///
/// # Panics
/// If the row does not fit the schema.
#[must_use]
pub fn encode<'a>(schema: &Schema, row: Vec<Data<'a>>) -> Encoded<'a> {
    assert_eq!(schema.fields.len(), row.len(), "one value per column");
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

/// A message with its marker and length.
pub(super) fn framed(message: &[u8]) -> Vec<u8> {
    // So that values in memory begin at a multiple of it too.
    let length = (8 + message.len()).next_multiple_of(ALIGNMENT) - 8;
    let mut framed = Vec::with_capacity(8 + length);
    framed.extend(u32::MAX.to_le_bytes());
    framed.extend((length as u32).to_le_bytes());
    framed.extend(message);
    framed.resize(8 + length, 0);
    framed
}

impl Encoded<'_> {
    /// How many bytes [`Self::write`] writes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.head.len() + self.parts.iter().map(|part| part.len() + padding(part.len())).sum::<usize>()
    }

    /// Writes the batch.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        // Small pieces are gathered, large ones written without a copy.
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

    /// A field's length, and its validity: all of it is valid, or nothing.
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
                self.no_items(item);
            }
            (DataType::List(width, item), Data::List(items)) => {
                self.offsets(*width, [0, items.len()]);
                self.node(items.len(), false);
                self.items(item, items);
            }
            (DataType::Struct(fields), Data::Null) => fields.iter().for_each(|field| self.put(field, Data::Null)),
            (DataType::Struct(fields), Data::Struct(parts)) => {
                assert_eq!(fields.len(), parts.len(), "one value per field");
                fields.iter().zip(parts).for_each(|(field, part)| self.put(field, part));
            }
            (data_type, data) => unreachable!("{data:?} is not of type {data_type}"),
        }
    }

    fn no_items(&mut self, item: &Field) {
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
            const { assert!(cfg!(target_endian = "little"), "numbers are written as they are in memory") };
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
