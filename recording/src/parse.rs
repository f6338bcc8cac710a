//! MCAP records out of bytes that may be anything. <https://mcap.dev/spec>
//!
//! Strict: a record whose lengths do not add up to its own is none. Nothing is allocated for a length before the bytes are there.

use std::collections::BTreeMap;

use crate::write::layout::TOPIC_IN_PLAN;

/// Opcode and length of a record.
pub(crate) const RECORD_HEADER: u64 = 9;

/// What is left of a record's body.
struct Body<'a>(&'a [u8]);

impl<'a> Body<'a> {
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (array, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*array)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes behind their own length.
    fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()? as usize;
        let (bytes, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(bytes)
    }

    fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }

    fn text_map(&mut self) -> Option<BTreeMap<String, String>> {
        let mut entries = Body(self.bytes()?);
        let mut map = BTreeMap::new();
        while !entries.0.is_empty() {
            let (key, value) = (entries.text()?, entries.text()?);
            if map.insert(key.to_owned(), value.to_owned()).is_some() {
                return None;
            }
        }
        Some(map)
    }

    /// The value, if nothing is left.
    fn end<T>(&self, value: T) -> Option<T> {
        self.0.is_empty().then_some(value)
    }
}

/// Id and name of a schema.
pub(crate) fn schema(body: &[u8]) -> Option<(u16, String)> {
    let mut body = Body(body);
    let (id, name, _encoding, _data) = (body.u16()?, body.text()?, body.text()?, body.bytes()?);
    body.end((id, name.to_owned()))
}

/// A channel.
#[derive(Clone, Debug)]
pub(crate) struct ChannelEntry {
    pub(crate) schema: u16,
    /// The topic of the plan.
    pub(crate) topic: String,
    /// The topic in the file: another one where viewers would not find the camera of an image by the plan's.
    pub(crate) written_topic: String,
    /// Whether all it says of itself is its stage: a commit's channel, and no other.
    pub(crate) is_of_a_stage: bool,
}

impl ChannelEntry {
    /// The channel of a topic that says this of itself.
    pub(crate) fn new(schema: u16, written_topic: &str, metadata: &BTreeMap<String, String>) -> Self {
        let topic = metadata.get(TOPIC_IN_PLAN).map_or(written_topic, String::as_str).to_owned();
        let is_of_a_stage = metadata.len() == 1 && metadata.contains_key("stage");
        Self { schema, topic, written_topic: written_topic.to_owned(), is_of_a_stage }
    }
}

/// A channel and its id.
pub(crate) fn channel(body: &[u8]) -> Option<(u16, ChannelEntry)> {
    let mut body = Body(body);
    let (id, schema, topic) = (body.u16()?, body.u16()?, body.text()?);
    let (_encoding, metadata) = (body.text()?, body.text_map()?);
    body.end((id, ChannelEntry::new(schema, topic, &metadata)))
}

/// Name and content of a metadata record.
pub(crate) fn metadata(body: &[u8]) -> Option<(String, BTreeMap<String, String>)> {
    let mut body = Body(body);
    let (name, values) = (body.text()?.to_owned(), body.text_map()?);
    body.end((name, values))
}

/// How many bytes a metadata record has by what its head says.
pub(crate) fn metadata_length(head: &[u8]) -> Option<u64> {
    let mut body = Body(head);
    let (name, map) = (body.text()?, body.u32()?);
    Some(8 + name.len() as u64 + u64::from(map))
}

/// The channel of a message index.
pub(crate) fn message_index_channel(head: &[u8], length: u64) -> Option<u16> {
    let mut body = Body(head);
    let (channel, entries) = (body.u16()?, body.u32()?);
    (entries % 16 == 0 && length == 6 + u64::from(entries)).then_some(channel)
}

/// The channel of a message index, and where in its chunk each of the messages starts.
pub(crate) fn message_index(body: &[u8]) -> Option<(u16, impl Iterator<Item = u64> + '_)> {
    let mut body = Body(body);
    let (channel, entries) = (body.u16()?, body.bytes()?);
    let entries = entries.as_chunks::<16>();
    let offsets = entries.0.iter().map(|[_, _, _, _, _, _, _, _, offset @ ..]| u64::from_le_bytes(*offset));
    body.end(()).filter(|()| entries.1.is_empty()).map(|()| (channel, offsets))
}

/// What stands before a chunk's records.
pub(crate) struct ChunkHead<'a> {
    /// The first and last time of its messages, nanoseconds.
    pub(crate) times_ns: (u64, u64),
    pub(crate) uncompressed_size: u64,
    pub(crate) crc: u32,
    pub(crate) compression: &'a str,
    /// How many bytes its records have as they lie.
    pub(crate) stored: u64,
    /// How many bytes of the body come before the records.
    pub(crate) length: usize,
    /// How many bytes the body has by what the head says.
    pub(crate) body_length: Option<u64>,
}

impl ChunkHead<'_> {
    /// The most bytes that the head of a chunk has which depthloom wrote.
    pub(crate) const LONGEST: u64 = 8 + 8 + 8 + 4 + 4 + "zstd".len() as u64 + 8;
}

/// The head of a chunk; `head` holds at least its beginning.
pub(crate) fn chunk_head(head: &[u8]) -> Option<ChunkHead<'_>> {
    let mut body = Body(head);
    let times_ns = (body.u64()?, body.u64()?);
    let (uncompressed_size, crc, compression, stored) = (body.u64()?, body.u32()?, body.text()?, body.u64()?);
    let length = head.len() - body.0.len();
    let body_length = stored.checked_add(length as u64);
    Some(ChunkHead { times_ns, uncompressed_size, crc, compression, stored, length, body_length })
}

/// What stands before an attachment's content.
pub(crate) struct AttachmentHead {
    pub(crate) name: String,
    pub(crate) media_type: String,
    pub(crate) size: u64,
    /// How many bytes of the body come before the content; a checksum of four bytes follows the content.
    pub(crate) length: usize,
    /// How many bytes the body has by what the head says.
    pub(crate) body_length: Option<u64>,
}

/// The head of an attachment; `head` holds at least its beginning.
pub(crate) fn attachment_head(head: &[u8]) -> Option<AttachmentHead> {
    let mut body = Body(head);
    let (_log_ns, _create_ns) = (body.u64()?, body.u64()?);
    let (name, media_type, size) = (body.text()?.to_owned(), body.text()?.to_owned(), body.u64()?);
    let length = head.len() - body.0.len();
    let body_length = size.checked_add(length as u64 + 4);
    Some(AttachmentHead { name, media_type, size, length, body_length })
}

/// A message within a chunk.
pub(crate) struct ChunkMessage<'a> {
    pub(crate) channel: u16,
    pub(crate) time_ns: u64,
    pub(crate) data: &'a [u8],
}

/// A message.
pub(crate) fn message(body: &[u8]) -> Option<ChunkMessage<'_>> {
    let mut body = Body(body);
    let (channel, _sequence, time_ns, _publish_ns) = (body.u16()?, body.u32()?, body.u64()?, body.u64()?);
    Some(ChunkMessage { channel, time_ns, data: body.0 })
}

/// The records in a stretch of bytes: offset, opcode, body. A record that is cut gives its offset as an error.
pub(crate) struct Records<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Records<'a> {
    pub(crate) const fn new(bytes: &'a [u8]) -> Self {
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
        let parsed = rest.split_first_chunk::<{ RECORD_HEADER as usize }>().and_then(|(header, rest)| {
            let [opcode, length @ ..] = *header;
            let length = usize::try_from(u64::from_le_bytes(length)).ok()?;
            Some((opcode, rest.get(..length)?))
        });
        let Some((opcode, body)) = parsed else {
            self.at = self.bytes.len();
            return Some(Err(at));
        };
        self.at += RECORD_HEADER as usize + body.len();
        Some(Ok((at, opcode, body)))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use crate::record::{put_attachment, put_channel, put_metadata, put_schema};

    /// The body of the only record in `record`.
    fn body(record: &[u8]) -> &[u8] {
        super::Records::new(record).next().unwrap().unwrap().2
    }

    #[test]
    fn what_is_written_is_read_and_nothing_shorter_or_longer() {
        let map = BTreeMap::from([("key".to_owned(), "value".to_owned()), ("other".to_owned(), String::new())]);
        let mut record = Vec::new();
        put_metadata(&mut record, "depthloom", &map);
        assert_eq!(super::metadata(body(&record)), Some(("depthloom".to_owned(), map.clone())));
        assert_eq!(super::metadata_length(body(&record)), Some(body(&record).len() as u64));
        assert_eq!(super::metadata(&body(&record)[..20]), None);
        assert_eq!(super::metadata(&[body(&record), &[0]].concat()), None);

        record.clear();
        put_channel(&mut record, 3, 2, "/topic", &map);
        let (id, channel) = super::channel(body(&record)).unwrap();
        assert_eq!((id, channel.schema, channel.topic.as_str()), (3, 2, "/topic"));

        record.clear();
        put_schema(&mut record, 7, "name", b"data");
        assert_eq!(super::schema(body(&record)), Some((7, "name".to_owned())));

        record.clear();
        put_attachment(&mut record, "note", "text/plain", b"content");
        let head = super::attachment_head(body(&record)).unwrap();
        assert_eq!((head.name.as_str(), head.media_type.as_str(), head.size), ("note", "text/plain", 7));
        assert_eq!(head.body_length, Some(body(&record).len() as u64));
    }
}
