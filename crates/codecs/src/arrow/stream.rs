//! Streams of messages: a schema, then record batches.

use std::io::{self, Read, Write};

use super::batch::Batch;
use super::row::framed;
use super::types::{RECORD_BATCH, SCHEMA, Schema, read_message};

/// The most bytes that a message's description may have, and its values.
const MOST_HEAD: u32 = 1 << 20;
const MOST_BODY: i64 = 4 << 30;

/// Why a stream could not be read on.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// The reader failed.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// It ended in the middle of a message.
    #[error("the stream ended within a message")]
    Cut,
    /// The first bytes are not those of a stream: text, most likely.
    #[error("it is not an Arrow stream: it begins with {0:?} instead of a message")]
    Text(String),
    /// The bytes are not a valid stream.
    #[error("{0}")]
    Malformed(String),
}

/// Writes the message that opens a stream.
pub fn write_schema(schema: &Schema, out: &mut impl Write) -> io::Result<()> {
    out.write_all(&framed(&schema.encode()))?;
    out.flush()
}

struct Message {
    head: Vec<u8>,
    body: Vec<u8>,
}

/// A stream that is read, message by message.
pub struct StreamReader<R> {
    reader: R,
}

impl<R: Read> StreamReader<R> {
    /// A stream from its beginning.
    pub const fn new(reader: R) -> Self {
        Self { reader }
    }

    /// The schema, which comes first; `None` if the stream ends before it.
    pub fn schema(&mut self) -> Result<Option<Schema>, StreamError> {
        let Some(Message { head, .. }) = self.message(SCHEMA)? else { return Ok(None) };
        let (_, header, _) = read_message(&head).map_err(StreamError::Malformed)?;
        Schema::decode(&header).map(Some).map_err(StreamError::Malformed)
    }

    /// The next batch; `None` at the end of the stream.
    pub fn batch(&mut self, schema: &Schema) -> Result<Option<Batch>, StreamError> {
        let Some(Message { head, body }) = self.message(RECORD_BATCH)? else { return Ok(None) };
        let (_, header, _) = read_message(&head).map_err(StreamError::Malformed)?;
        Batch::decode(schema, &header, body).map(Some).map_err(StreamError::Malformed)
    }

    /// The description and the values of the next message, which must be of this kind.
    fn message(&mut self, wanted: u8) -> Result<Option<Message>, StreamError> {
        let malformed = |what: String| Err(StreamError::Malformed(what));
        let Some(lead) = self.lead()? else { return Ok(None) };
        let [marker, length] = lead;
        if marker != u32::MAX {
            let bytes = marker.to_le_bytes();
            return Err(StreamError::Text(String::from_utf8_lossy(&bytes).into_owned()));
        }
        if length == 0 {
            return Ok(None);
        }
        if length > MOST_HEAD {
            return malformed(format!("the description of a message is {length} bytes long, more than {MOST_HEAD}"));
        }
        let head = self.exactly(u64::from(length))?;
        let (kind, _, body) = read_message(&head).map_err(StreamError::Malformed)?;
        if kind != wanted {
            let name = |kind: u8| match kind {
                SCHEMA => "a schema".to_owned(),
                2 => "a dictionary".to_owned(),
                RECORD_BATCH => "a record batch".to_owned(),
                other => format!("a message of type {other}"),
            };
            return malformed(format!("{} came instead of {}", name(kind), name(wanted)));
        }
        if !(0..=MOST_BODY).contains(&body) {
            return malformed(format!("a message states {body} bytes of values; at most {MOST_BODY} are supported"));
        }
        let body = self.exactly(body as u64)?;
        Ok(Some(Message { head, body }))
    }

    /// Marker and length of a message; `None` at the end of the stream.
    fn lead(&mut self) -> Result<Option<[u32; 2]>, StreamError> {
        let (mut bytes, mut there) = ([0; 8], 0);
        while there < bytes.len() {
            match self.reader.read(&mut bytes[there..]) {
                Ok(0) if there == 0 => return Ok(None),
                Ok(0) => return Err(StreamError::Cut),
                Ok(read) => there += read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
            // Other text may end before eight bytes, or never.
            if there >= 4 && bytes[..4] != [0xff; 4] {
                break;
            }
        }
        let number = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        Ok(Some([number(0), number(4)]))
    }

    /// `count` bytes. Memory is allocated as they arrive: `count` is not trusted.
    fn exactly(&mut self, count: u64) -> Result<Vec<u8>, StreamError> {
        const AT_ONCE: u64 = 64 << 20;
        let mut bytes = Vec::with_capacity(count.min(AT_ONCE) as usize);
        (&mut self.reader).take(count).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < count { Err(StreamError::Cut) } else { Ok(bytes) }
    }
}
