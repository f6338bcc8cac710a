//! The content of an MCAP file, by the summary at its end.

use std::collections::BTreeMap;

use depthloom_graphs::Fault;
use depthloom_mcap::records::{self, ChunkIndex, SchemaHeader, Statistics};
use depthloom_mcap::{
    FOOTER, FileEnd, FileError, MAGIC_LENGTH, PositionedFile, each_summary_record, file_end, op, read,
};

use super::message::{Channel, Warning};

const MOST_SUMMARY: u64 = 256 << 20;

#[derive(Clone, Copy, Debug)]
pub(super) struct Unindexed {
    pub channel: u16,
    pub log_ns: u64,
    pub place: super::message::Place,
}

#[derive(Default)]
pub(super) struct Index {
    pub channels: BTreeMap<u16, Channel>,
    pub chunks: Vec<ChunkIndex>,
    pub unindexed: Vec<Unindexed>,
    pub warning: Option<Warning>,
}

#[derive(Default)]
pub(super) struct KnownRecords {
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (u16, Channel)>,
}

impl KnownRecords {
    /// Takes note of a record that is a schema or a channel; `None` if it is malformed.
    pub(super) fn add(&mut self, opcode: u8, body: &[u8]) -> Option<()> {
        match opcode {
            op::SCHEMA => {
                let (schema, _) = read::<SchemaHeader>(body)?;
                self.schemas.insert(schema.id, schema.name);
            }
            op::CHANNEL => {
                let (records::Channel { id, schema_id, topic, message_encoding: encoding, .. }, _) = read(body)?;
                self.channels.insert(id, (schema_id, Channel { topic, message_type: String::new(), encoding }));
            }
            _ => {}
        }
        Some(())
    }

    pub(super) fn has(&self, channel: u16) -> bool {
        self.channels.contains_key(&channel)
    }

    pub(super) fn channels(self) -> impl Iterator<Item = (u16, Channel)> {
        let Self { schemas, channels } = self;
        channels.into_iter().map(move |(id, (schema, channel))| {
            let message_type = schemas.get(&schema).cloned().unwrap_or_default();
            (id, Channel { message_type, ..channel })
        })
    }
}

/// The index from the summary; `None` if it is missing or does not name all messages. An error is a
/// fragment without the path.
pub(super) fn summary(file: &PositionedFile) -> Result<Option<Index>, String> {
    let reason = |error: FileError| match error {
        FileError::Damaged { offset, what, .. } => format!("at byte {offset}, {what}"),
        other => Fault::from(other).chain(),
    };
    let FileEnd { offset: end, footer, has_magic } = file_end(file).map_err(reason)?.ok_or("it is too short")?;
    if !has_magic {
        let mark = file.size - MAGIC_LENGTH;
        return Err(format!("its last 8 bytes, from byte {mark}, are not the mark that every MCAP file ends with"));
    }
    let start = footer.ok_or("there is no footer")?.summary_start;
    if start == 0 {
        return Ok(None);
    }
    match end.checked_sub(start) {
        None => return Err("it starts after its end".to_owned()),
        Some(length) if length > MOST_SUMMARY => return Err(format!("it is longer than {MOST_SUMMARY} bytes")),
        Some(_) => {}
    }
    let (mut index, mut known, mut statistics) = (Index::default(), KnownRecords::default(), None);
    each_summary_record(file, (start, file.size - FOOTER), |at, opcode, body| {
        let noted = match opcode {
            op::CHUNK_INDEX => read(body).map(|(chunk, _)| index.chunks.push(chunk)),
            op::STATISTICS => read::<Statistics>(body).map(|(counts, _)| statistics = Some(counts)),
            _ => known.add(opcode, body),
        };
        noted.ok_or_else(|| file.damaged(at, "a record of the summary is malformed"))
    })
    .map_err(reason)?;
    // Without statistics, a file without chunks may hold messages outside of them.
    let names_all = match &statistics {
        Some(counts) => {
            index.chunks.len() as u64 >= u64::from(counts.chunk_count)
                && (counts.chunk_count > 0 || counts.message_count == 0)
        }
        None => !index.chunks.is_empty(),
    };
    index.channels = known.channels().collect();
    Ok(names_all.then_some(index))
}
