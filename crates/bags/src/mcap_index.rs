//! What an MCAP file says it holds: by the summary at its end, or by a look at every record where there is none.

use std::collections::BTreeMap;

use depthloom_graphs::Fault;
use mcap::records::{ChunkIndex, Record, op};

use crate::chunks::{RECORD_HEADER, record_header};
use crate::file::PositionedFile;
use crate::record;
use crate::scan::{self, Known};

/// How every MCAP file begins and ends.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// The most bytes of the summary.
const MOST_SUMMARY: u64 = 256 << 20;

/// What is said of a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    pub topic: String,
    /// The schema's name; empty where there is none.
    pub message_type: String,
    /// `cdr`, `protobuf`, `json`.
    pub encoding: String,
}

/// A message outside of chunks.
#[derive(Clone, Copy, Debug)]
pub struct Loose {
    pub channel: u16,
    pub log_ns: u64,
    /// Where its bytes start, and how many they are.
    pub offset: u64,
    pub length: u64,
}

/// A message within a chunk that no message index tells of.
#[derive(Clone, Copy, Debug)]
pub struct Unindexed {
    pub chunk: usize,
    pub channel: u16,
    pub log_ns: u64,
    pub offset: u64,
}

/// What a file holds.
#[derive(Default)]
pub struct Index {
    pub channels: BTreeMap<u16, Channel>,
    pub chunks: Vec<ChunkIndex>,
    pub loose: Vec<Loose>,
    pub unindexed: Vec<Unindexed>,
    /// What is to be said of the file, and is no failure.
    pub warning: Option<Warning>,
}

/// What is to be said of a file that is read all the same.
pub struct Warning {
    /// With the file's name.
    pub text: String,
    /// Whether messages were lost.
    pub is_loss: bool,
}

impl Index {
    /// Reads the summary; of a file that has none, looks at every record.
    pub fn of(file: &PositionedFile) -> Result<Self, Fault> {
        let why = match summary(file) {
            Ok(Some(index)) => return scan::completed(file, index),
            // Written without chunks, or without an index: nothing is wrong with it.
            Ok(None) => None,
            Err(error) => Some(error),
        };
        let mut index = scan::scan(file)?;
        if let Some(why) = why.filter(|_| index.warning.is_none()) {
            let text = format!(
                "{}: its index cannot be read ({why}), and every record was looked at: `mcap recover` writes the file anew",
                file.name()
            );
            index.warning = Some(Warning { text, is_loss: false });
        }
        scan::completed(file, index)
    }
}

/// The index as the summary has it; `None` where there is none, or it does not tell of all messages.
fn summary(file: &PositionedFile) -> Result<Option<Index>, String> {
    const FOOTER: u64 = (RECORD_HEADER + 20 + MAGIC.len()) as u64;
    let told = |fault: Fault| fault.chain();
    let end = file.size.checked_sub(FOOTER).filter(|end| *end >= MAGIC.len() as u64).ok_or("it is too short")?;
    let footer = file.range(end, FOOTER, FOOTER).map_err(told)?;
    if !footer.ends_with(MAGIC) {
        let mark = file.size - MAGIC.len() as u64;
        return Err(format!("its last 8 bytes, from byte {mark}, are not the mark that every MCAP file ends with"));
    }
    let start = match (record_header(&footer), footer[RECORD_HEADER..].first_chunk()) {
        (Some((op::FOOTER, 20)), Some(start)) => u64::from_le_bytes(*start),
        _ => return Err("there is no footer".to_owned()),
    };
    if start == 0 {
        return Ok(None);
    }
    let length = end.checked_sub(start).ok_or("it is said to begin behind its end")?;
    let records = file.range(start, length, MOST_SUMMARY).map_err(told)?;
    let mut index = Index::default();
    let (mut known, mut stats, mut rest) = (Known::default(), None, &records[..]);
    while !rest.is_empty() {
        let (opcode, length) = record_header(rest).ok_or("a record is cut off")?;
        let length = usize::try_from(length).ok().filter(|length| *length <= rest.len() - RECORD_HEADER);
        let (body, behind) = rest[RECORD_HEADER..].split_at(length.ok_or("a record is longer than all of them")?);
        rest = behind;
        let is_of_use = matches!(opcode, op::SCHEMA | op::CHANNEL | op::CHUNK_INDEX | op::STATISTICS);
        match is_of_use.then(|| record::parse(opcode, body).ok_or("a record is malformed")).transpose()? {
            Some(Record::ChunkIndex(chunk)) => index.chunks.push(chunk),
            Some(Record::Statistics(of)) => stats = Some(of),
            Some(record) => known.take(record),
            None => {}
        }
    }
    // Without statistics, a file without chunks may hold messages outside of them.
    let tells_all = match &stats {
        Some(stats) => {
            index.chunks.len() as u64 >= u64::from(stats.chunk_count)
                && (stats.chunk_count > 0 || stats.message_count == 0)
        }
        None => !index.chunks.is_empty(),
    };
    index.channels = known.channels().collect();
    Ok(tells_all.then_some(index))
}
