//! The protobuf wire format, as far as images need it: written into a buffer and read from one without copies.

use std::fmt;

use prost::encoding::{decode_varint, encode_varint};

pub(crate) fn put_varint(out: &mut Vec<u8>, value: u64) {
    encode_varint(value, out);
}

/// Appends a varint field; zero is the default and left out.
pub(crate) fn put_number(out: &mut Vec<u8>, field: u32, value: u64) {
    if value != 0 {
        put_varint(out, u64::from(field) << 3);
        put_varint(out, value);
    }
}

/// Appends a signed (zigzag) varint field; zero is the default and left out.
pub(crate) fn put_signed(out: &mut Vec<u8>, field: u32, value: i32) {
    put_number(out, field, u64::from(((value << 1) ^ (value >> 31)) as u32));
}

/// Appends a `fixed32` field; zero is the default and left out.
pub(crate) fn put_fixed32(out: &mut Vec<u8>, field: u32, value: u32) {
    if value != 0 {
        put_varint(out, u64::from(field) << 3 | 5);
        out.extend_from_slice(&value.to_le_bytes());
    }
}

/// Appends tag and length of a field of that many bytes, which are to follow.
pub(crate) fn put_length(out: &mut Vec<u8>, field: u32, length: usize) {
    put_varint(out, u64::from(field) << 3 | 2);
    put_varint(out, length as u64);
}

/// Appends a string or bytes field; empty is the default and left out.
pub(crate) fn put_bytes(out: &mut Vec<u8>, field: u32, bytes: &[u8]) {
    if !bytes.is_empty() {
        put_length(out, field, bytes.len());
        out.extend_from_slice(bytes);
    }
}

/// A field's content.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content<'a> {
    /// Wire type 0.
    Varint(u64),
    /// Wire type 1.
    Fixed64(u64),
    /// Wire type 2.
    Bytes(&'a [u8]),
    /// Wire type 5.
    Fixed32(u32),
}

impl<'a> Content<'a> {
    /// A `fixed32`; of another type 0, as protobuf's readers do it.
    #[must_use]
    pub const fn fixed32(self) -> u32 {
        match self {
            Self::Fixed32(value) => value,
            Self::Varint(_) | Self::Fixed64(_) | Self::Bytes(_) => 0,
        }
    }

    /// A zigzag varint; of another type 0.
    #[must_use]
    pub const fn signed(self) -> i32 {
        match self {
            Self::Varint(value) => ((value as u32) >> 1) as i32 ^ -((value as u32 & 1) as i32),
            Self::Fixed32(_) | Self::Fixed64(_) | Self::Bytes(_) => 0,
        }
    }

    /// A string or bytes; of another type nothing.
    #[must_use]
    pub const fn bytes(self) -> &'a [u8] {
        match self {
            Self::Bytes(bytes) => bytes,
            Self::Varint(_) | Self::Fixed32(_) | Self::Fixed64(_) => &[],
        }
    }
}

/// A message that does not follow the wire format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed;

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a message is not protobuf")
    }
}

/// The fields of a message, in the order they were written.
pub struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    fn varint(&mut self) -> Option<u64> {
        decode_varint(&mut self.0).ok()
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (array, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*array)
    }

    fn field(&mut self) -> Option<(u32, Content<'a>)> {
        let tag = self.varint()?;
        let content = match tag & 7 {
            0 => Content::Varint(self.varint()?),
            1 => Content::Fixed64(u64::from_le_bytes(self.array()?)),
            2 => {
                let length = usize::try_from(self.varint()?).ok()?;
                let (bytes, rest) = self.0.split_at_checked(length)?;
                self.0 = rest;
                Content::Bytes(bytes)
            }
            5 => Content::Fixed32(u32::from_le_bytes(self.array()?)),
            _ => return None,
        };
        Some((u32::try_from(tag >> 3).ok()?, content))
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<(u32, Content<'a>), Malformed>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_none() {
            self.0 = &[];
        }
        Some(field.ok_or(Malformed))
    }
}

#[cfg(test)]
mod tests {
    use super::{Content, Fields, Malformed, put_bytes, put_fixed32, put_number, put_signed};

    #[test]
    fn fields_read_back() {
        let mut out = Vec::new();
        put_number(&mut out, 1, 300);
        put_fixed32(&mut out, 2, 7);
        put_signed(&mut out, 1001, -5);
        put_bytes(&mut out, 6, b"depth");
        put_number(&mut out, 3, 0);
        let fields: Result<Vec<_>, _> = Fields(&out).collect();
        let fields = fields.unwrap();
        assert_eq!(fields[0], (1, Content::Varint(300)));
        assert_eq!(fields[1], (2, Content::Fixed32(7)));
        assert_eq!((fields[2].0, fields[2].1.signed()), (1001, -5));
        assert_eq!(fields[3], (6, Content::Bytes(b"depth")));
        assert_eq!(fields.len(), 4);
    }

    #[test]
    fn a_cut_message_is_refused() {
        let mut out = Vec::new();
        put_bytes(&mut out, 6, b"depth");
        let last = Fields(&out[..out.len() - 1]).last();
        assert_eq!(last, Some(Err(Malformed)));
    }
}
