//! What the files of either storage have in common: messages, channels, warnings.

/// A message of a bag: where it is stored, and when it was recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message {
    pub(crate) file: usize,
    /// When it was recorded, nanoseconds since 1970.
    pub log_ns: u64,
    pub(crate) place: Place,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// In an MCAP file, outside of chunks.
    Bytes {
        offset: u64,
        length: u64,
    },
    /// In an MCAP file: a record of a chunk.
    Chunk {
        chunk: usize,
        channel: u16,
        offset: u64,
    },
    Row(i64),
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Channel {
    pub topic: String,
    /// The schema's name; empty without a schema.
    pub message_type: String,
    /// `cdr`, `protobuf`, `json`.
    pub encoding: String,
}

pub(crate) struct Warning {
    /// With the file's name.
    pub text: String,
    pub is_loss: bool,
}
