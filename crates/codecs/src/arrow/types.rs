//! Fields and their types, and the message that carries them.

use std::fmt;

use super::flat::{Broken, Slot, Table, Writer};

/// Types of columns: those that depthloom uses, and those that other programs may send instead.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DataType {
    /// An integer: bits, and whether it has a sign.
    Int(u8, bool),
    /// A floating-point number of 16, 32 or 64 bits.
    Float(u8),
    /// A boolean, one bit each.
    Bool,
    /// A text; the offsets have 32 bits, or 64.
    Utf8(Offsets),
    /// Bytes; the offsets have 32 bits, or 64.
    Binary(Offsets),
    /// A list of values; the offsets have 32 bits, or 64.
    List(Offsets, Box<Field>),
    /// Values side by side.
    Struct(Vec<Field>),
}

/// How wide the offsets of texts, bytes and lists are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offsets {
    /// 32 bits.
    Narrow,
    /// 64 bits: Arrow's "large" types.
    Wide,
}

/// A named column, or a named part of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// Whether it can be absent.
    pub nullable: bool,
    /// What it holds.
    pub data_type: DataType,
    /// Metadata: value type, unit, scale.
    pub metadata: Vec<(String, String)>,
}

impl Field {
    /// A field that is always there.
    #[must_use]
    pub fn new(name: impl Into<String>, data_type: DataType) -> Self {
        Self { name: name.into(), nullable: false, data_type, metadata: Vec::new() }
    }

    /// The same, but it can be absent.
    #[must_use]
    pub fn nullable(self) -> Self {
        Self { nullable: true, ..self }
    }

    /// The same with a further entry of metadata.
    #[must_use]
    pub fn with_metadata(mut self, key: &str, value: impl Into<String>) -> Self {
        self.metadata.push((key.to_owned(), value.into()));
        self
    }
}

impl fmt::Display for DataType {
    /// As `pyarrow` prints it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let large = |offsets: &Offsets| if *offsets == Offsets::Wide { "large_" } else { "" };
        match self {
            Self::Int(bits, true) => write!(f, "int{bits}"),
            Self::Int(bits, false) => write!(f, "uint{bits}"),
            Self::Float(bits) => write!(f, "float{bits}"),
            Self::Bool => f.write_str("bool"),
            Self::Utf8(offsets) => write!(f, "{}string", large(offsets)),
            Self::Binary(offsets) => write!(f, "{}binary", large(offsets)),
            Self::List(offsets, item) => write!(f, "{}list<{}>", large(offsets), item.data_type),
            Self::Struct(fields) => {
                let parts: Vec<String> =
                    fields.iter().map(|field| format!("{}: {}", field.name, field.data_type)).collect();
                write!(f, "struct<{}>", parts.join(", "))
            }
        }
    }
}

/// What all batches of a stream are made of.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Schema {
    /// The columns.
    pub fields: Vec<Field>,
    /// Metadata of the stream.
    pub metadata: Vec<(String, String)>,
}

impl Schema {
    /// The value of a metadata key.
    #[must_use]
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.metadata.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }
}

/// The version of Arrow's metadata that is written, V5, and the oldest that is read, V4.
const VERSION: i16 = 4;
const OLDEST: i16 = 3;
/// Which message a message is.
pub(super) const SCHEMA: u8 = 1;
pub(super) const RECORD_BATCH: u8 = 3;

/// How many fields a schema may have, in all depths together.
const MOST_FIELDS: usize = 4096;
const DEEPEST: usize = 8;

/// The head of any message, its header still to be written at the place that is given.
pub(super) fn message(kind: u8, body_bytes: i64) -> (Writer, usize) {
    let (mut writer, root) = Writer::new();
    let slots = [Slot::I16(VERSION), Slot::U8(kind), Slot::Offset, Slot::I64(body_bytes)];
    let header = writer.table(root, &slots)[0];
    (writer, header)
}

/// The kind of a message, the place of its header, and the number of bytes of its body.
pub(super) fn read_message(bytes: &[u8]) -> Result<(u8, Table<'_>, i64), String> {
    let message = Table::root(bytes)?;
    let version = message.i16(0)?;
    if !(OLDEST..=VERSION).contains(&version) {
        return Err(format!("it is of version {} of Arrow's format, and V4 and V5 are read", version + 1));
    }
    let header = message.table(2)?.ok_or("a message has no header")?;
    Ok((message.u8(1)?, header, message.i64(3)?))
}

impl Schema {
    /// The message that opens a stream, without its length.
    pub(super) fn encode(&self) -> Vec<u8> {
        let (mut writer, header) = message(SCHEMA, 0);
        let schema = writer.table(header, &[Slot::I16(0), Slot::Offset, Slot::Offset]);
        put_fields(&mut writer, schema[0], &self.fields);
        put_metadata(&mut writer, schema[1], &self.metadata);
        writer.finish()
    }

    pub(super) fn decode(header: &Table<'_>) -> Result<Self, String> {
        if header.i16(0)? != 0 {
            return Err("its numbers are big endian, and little endian is read".to_owned());
        }
        let mut left = MOST_FIELDS;
        let fields = read_fields(header, 1, DEEPEST, &mut left)?;
        Ok(Self { fields, metadata: read_metadata(header, 2)? })
    }
}

fn put_metadata(writer: &mut Writer, at: usize, metadata: &[(String, String)]) {
    for (place, (key, value)) in writer.vector(at, metadata.len()).into_iter().zip(metadata) {
        let pair = writer.table(place, &[Slot::Offset, Slot::Offset]);
        writer.text(pair[0], key);
        writer.text(pair[1], value);
    }
}

fn read_metadata(table: &Table<'_>, field: usize) -> Result<Vec<(String, String)>, Broken> {
    let pairs = table.tables(field)?;
    pairs.iter().map(|pair| Ok((pair.text(0)?.to_owned(), pair.text(1)?.to_owned()))).collect()
}

fn put_fields(writer: &mut Writer, at: usize, fields: &[Field]) {
    for (place, field) in writer.vector(at, fields.len()).into_iter().zip(fields) {
        let (tag, slots): (u8, &[Slot]) = match &field.data_type {
            DataType::Int(bits, signed) => (2, &[Slot::I32(i32::from(*bits)), Slot::U8(u8::from(*signed))]),
            DataType::Float(bits) => (3, &[Slot::I16(i16::from(*bits) / 32)]),
            DataType::Binary(Offsets::Narrow) => (4, &[]),
            DataType::Utf8(Offsets::Narrow) => (5, &[]),
            DataType::Bool => (6, &[]),
            DataType::List(Offsets::Narrow, _) => (12, &[]),
            DataType::Struct(_) => (13, &[]),
            DataType::Binary(Offsets::Wide) => (19, &[]),
            DataType::Utf8(Offsets::Wide) => (20, &[]),
            DataType::List(Offsets::Wide, _) => (21, &[]),
        };
        let nullable = Slot::U8(u8::from(field.nullable));
        let metadata = if field.metadata.is_empty() { Slot::None } else { Slot::Offset };
        let slots_of_field = [Slot::Offset, nullable, Slot::U8(tag), Slot::Offset, Slot::None, Slot::Offset, metadata];
        let places = writer.table(place, &slots_of_field);
        writer.text(places[0], &field.name);
        writer.table(places[1], slots);
        let children: &[Field] = match &field.data_type {
            DataType::List(_, item) => std::slice::from_ref(item),
            DataType::Struct(fields) => fields,
            _ => &[],
        };
        put_fields(writer, places[2], children);
        if let Some(place) = places.get(3) {
            put_metadata(writer, *place, &field.metadata);
        }
    }
}

fn read_fields(table: &Table<'_>, field: usize, deep: usize, left: &mut usize) -> Result<Vec<Field>, String> {
    table.tables(field)?.iter().map(|field| read_field(field, deep, left)).collect()
}

fn read_field(field: &Table<'_>, deep: usize, left: &mut usize) -> Result<Field, String> {
    if deep == 0 || *left == 0 {
        return Err(format!("it has more than {MOST_FIELDS} fields, or fields in fields deeper than {DEEPEST}"));
    }
    *left -= 1;
    let name = field.text(0)?.to_owned();
    if field.has(4) {
        return Err(format!("column `{name}` is encoded by a dictionary, which is not read: send its values"));
    }
    let type_table = field.table(3)?;
    let number = |get: &dyn Fn(&Table<'_>) -> Result<i32, Broken>| type_table.as_ref().map_or(Ok(0), get);
    let mut children = read_fields(field, 5, deep - 1, left)?;
    let mut item = || match children.len() {
        1 => children.pop().map(Box::new).ok_or("a list has no items"),
        _ => Err("a list has not one kind of items"),
    };
    let data_type = match field.u8(2)? {
        2 => match (number(&|of| of.i32(0))?, number(&|of| of.u8(1).map(i32::from))? != 0) {
            (bits @ (8 | 16 | 32 | 64), signed) => DataType::Int(bits as u8, signed),
            (bits, _) => return Err(format!("column `{name}` has whole numbers of {bits} bits")),
        },
        3 => match number(&|of| of.i16(0).map(i32::from))? {
            0 => DataType::Float(16),
            1 => DataType::Float(32),
            2 => DataType::Float(64),
            other => {
                return Err(format!("column `{name}` has floating-point numbers of the unknown precision {other}"));
            }
        },
        4 => DataType::Binary(Offsets::Narrow),
        5 => DataType::Utf8(Offsets::Narrow),
        6 => DataType::Bool,
        12 => DataType::List(Offsets::Narrow, item()?),
        13 => DataType::Struct(children),
        19 => DataType::Binary(Offsets::Wide),
        20 => DataType::Utf8(Offsets::Wide),
        21 => DataType::List(Offsets::Wide, item()?),
        other => return Err(format!("column `{name}` is of Arrow's type {other}, which no value here has")),
    };
    Ok(Field { name, nullable: field.u8(1)? != 0, data_type, metadata: read_metadata(field, 6)? })
}
