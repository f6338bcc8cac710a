//! MCAP records, read from untrusted bytes and written into a buffer.
//!
//! The types and their coding are those of the crate `mcap`. It reserves as much memory for a text as its length
//! states, so the lengths of a record are compared with its bytes first.

use std::io::Cursor;

use binrw::{BinRead, BinWrite};
use mcap::records::{self, op};

use Field::{Counted, Fixed, Texts};

/// How many bytes opcode and length of a record have.
pub const RECORD_HEADER: u64 = 9;
/// How many bytes of a message come before its data.
pub const MESSAGE_HEADER: u64 = 22;

/// A field of a record, as far as it must be stepped over.
#[derive(Clone, Copy, Debug)]
pub enum Field {
    /// A fixed number of bytes.
    Fixed(usize),
    /// Four bytes with the number of the bytes that follow: a text, or a map without texts.
    Counted,
    /// Likewise, of pairs of texts.
    Texts,
}

/// A kind of record, or of what a record begins with.
pub trait RecordLayout: for<'a> BinRead<Args<'a> = ()> + for<'a> BinWrite<Args<'a> = ()> {
    /// Its opcode.
    const OPCODE: u8;
    /// Its fields.
    const FIELDS: &'static [Field];
}

macro_rules! layouts {
    ($($record:ident $opcode:ident $fields:expr;)*) => {
        $(impl RecordLayout for records::$record {
            const OPCODE: u8 = op::$opcode;
            const FIELDS: &'static [Field] = &$fields;
        })*
    };
}

layouts! {
    Header HEADER [Counted, Counted];
    Footer FOOTER [Fixed(20)];
    SchemaHeader SCHEMA [Fixed(2), Counted, Counted];
    Channel CHANNEL [Fixed(4), Counted, Counted, Texts];
    ChunkHeader CHUNK [Fixed(28), Counted, Fixed(8)];
    MessageIndex MESSAGE_INDEX [Fixed(2), Counted];
    ChunkIndex CHUNK_INDEX [Fixed(32), Counted, Fixed(8), Counted, Fixed(16)];
    AttachmentHeader ATTACHMENT [Fixed(16), Counted, Counted];
    AttachmentIndex ATTACHMENT_INDEX [Fixed(40), Counted, Counted];
    Statistics STATISTICS [Fixed(42), Counted];
    Metadata METADATA [Counted, Texts];
    MetadataIndex METADATA_INDEX [Fixed(16), Counted];
    SummaryOffset SUMMARY_OFFSET [Fixed(17)];
    DataEnd DATA_END [Fixed(4)];
}

/// The record that a body begins with, and the bytes after it; `None` if the body is not of that kind or ends before.
#[must_use]
pub fn read<R: RecordLayout>(body: &[u8]) -> Option<(R, &[u8])> {
    let mut rest = body;
    for field in R::FIELDS {
        match field {
            Fixed(length) => rest = rest.get(*length..)?,
            Counted => drop(counted(&mut rest)?),
            Texts => {
                let mut texts = counted(&mut rest)?;
                while !texts.is_empty() {
                    counted(&mut texts)?;
                }
            }
        }
    }
    let record = R::read_le(&mut Cursor::new(&body[..body.len() - rest.len()])).ok()?;
    Some((record, rest))
}

/// The record of a body, if nothing follows it.
#[must_use]
pub fn read_all<R: RecordLayout>(body: &[u8]) -> Option<R> {
    read(body).filter(|(_, rest)| rest.is_empty()).map(|(record, _)| record)
}

/// Steps over bytes that follow their own length.
pub fn counted<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let (length, tail) = rest.split_first_chunk()?;
    let (content, tail) = tail.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    *rest = tail;
    Some(content)
}

/// Opcode and length of a record.
#[must_use]
pub fn record_header(bytes: &[u8]) -> Option<(u8, u64)> {
    let [opcode, length @ ..] = *bytes.first_chunk::<{ RECORD_HEADER as usize }>()?;
    Some((opcode, u64::from_le_bytes(length)))
}

/// A message within a chunk.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// Its channel.
    pub channel: u16,
    /// When it was recorded, nanoseconds.
    pub time_ns: u64,
    /// Its data.
    pub data: &'a [u8],
}

/// The message of a body.
#[must_use]
pub fn message(body: &[u8]) -> Option<Message<'_>> {
    let ([c0, c1, _, _, _, _, times @ ..], data) = body.split_first_chunk::<{ MESSAGE_HEADER as usize }>()?;
    let time_ns = u64::from_le_bytes(*times.first_chunk()?);
    Some(Message { channel: u16::from_le_bytes([*c0, *c1]), time_ns, data })
}

/// The records in a stretch of bytes: offset, opcode, body. A record that is cut gives its offset as an error.
pub struct Records<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Records<'a> {
    /// The records in bytes.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }
}

impl<'a> Iterator for Records<'a> {
    type Item = Result<(u64, u8, &'a [u8]), u64>;

    fn next(&mut self) -> Option<Self::Item> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return None;
        }
        let at = self.at as u64;
        let whole = record_header(rest).and_then(|(opcode, length)| {
            let body = rest[RECORD_HEADER as usize..].get(..usize::try_from(length).ok()?)?;
            Some((at, opcode, body))
        });
        self.at += whole.map_or(rest.len(), |(_, _, body)| RECORD_HEADER as usize + body.len());
        Some(whole.ok_or(at))
    }
}

/// The body of the record that bytes begin with, if it is of that kind.
#[must_use]
pub fn body_of(opcode: u8, bytes: &[u8]) -> Option<&[u8]> {
    match Records::new(bytes).next() {
        Some(Ok((_, found, body))) if found == opcode => Some(body),
        _ => None,
    }
}

/// Appends a record whose body `body` appends.
pub fn put_record(out: &mut Vec<u8>, opcode: u8, body: impl FnOnce(&mut Vec<u8>)) {
    out.push(opcode);
    let length_at = out.len();
    out.extend_from_slice(&[0; 8]);
    body(out);
    let length = (out.len() - length_at - 8) as u64;
    out[length_at..length_at + 8].copy_from_slice(&length.to_le_bytes());
}

/// Appends what a record of a kind has, without its opcode and length.
///
/// # Panics
/// If a text, or a map, has 4 GiB or more.
pub fn put_fields<R: RecordLayout>(out: &mut Vec<u8>, record: &R) {
    let mut at_end = Cursor::new(&mut *out);
    at_end.set_position(at_end.get_ref().len() as u64);
    record.write_le(&mut at_end).expect("a buffer takes all that is written to it");
}

/// Appends a record.
///
/// # Panics
/// If a text, or a map, has 4 GiB or more.
pub fn put<R: RecordLayout>(out: &mut Vec<u8>, record: &R) {
    put_record(out, R::OPCODE, |out| put_fields(out, record));
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn a_record_is_read_as_it_was_written_and_nothing_shorter() {
        let metadata = BTreeMap::from([("key".to_owned(), "value".to_owned()), ("other".to_owned(), String::new())]);
        let metadata = records::Metadata { name: "depthloom".to_owned(), metadata };
        let mut record = vec![7];
        put(&mut record, &metadata);
        let body = body_of(op::METADATA, &record[1..]).unwrap();
        assert_eq!(read_all(body), Some(metadata));
        assert_eq!(read_all::<records::Metadata>(&body[..body.len() - 1]), None);
        let longer = [body, &[0]].concat();
        assert!(read_all::<records::Metadata>(&longer).is_none());
        assert!(matches!(read::<records::Metadata>(&longer), Some((_, [0]))));
        let counts = BTreeMap::from([(1, 2), (3, 4)]);
        let statistics = records::Statistics { chunk_count: 5, channel_message_counts: counts, ..Default::default() };
        record.clear();
        put(&mut record, &statistics);
        assert_eq!(read_all(body_of(op::STATISTICS, &record).unwrap()), Some(statistics));
    }

    #[test]
    fn a_text_longer_than_its_record_is_refused_before_allocation() {
        let schema =
            records::SchemaHeader { id: 7, name: "std_msgs/msg/String".to_owned(), encoding: "ros2msg".to_owned() };
        let mut body = Vec::new();
        put_fields(&mut body, &schema);
        assert_eq!(read_all(&body), Some(schema));
        body[2..6].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(read_all::<records::SchemaHeader>(&body), None);
        let metadata = BTreeMap::from([("a".to_owned(), "b".to_owned())]);
        let (topic, message_encoding) = ("/chatter".to_owned(), "cdr".to_owned());
        let channel = records::Channel { id: 1, schema_id: 7, topic, message_encoding, metadata };
        let mut body = Vec::new();
        put_fields(&mut body, &channel);
        assert_eq!(read_all(&body), Some(channel));
        let last = body.len() - 5;
        body[last..last + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(read_all::<records::Channel>(&body), None);
    }

    #[test]
    fn a_record_that_is_cut_ends_the_records() {
        let mut bytes = Vec::new();
        put_record(&mut bytes, op::MESSAGE, |out| out.extend_from_slice(&[1; 30]));
        put_record(&mut bytes, op::DATA_END, |out| out.extend_from_slice(&[0; 4]));
        let records: Vec<_> = Records::new(&bytes[..bytes.len() - 1]).collect();
        assert!(matches!(records[..], [Ok((0, op::MESSAGE, _)), Err(39)]), "{records:?}");
        assert_eq!(message(body_of(op::MESSAGE, &bytes).unwrap()).unwrap().data, [1; 8]);
    }
}
