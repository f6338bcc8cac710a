//! A part of a frame as chunks: encoded, checksummed and compressed by the worker that has its values.
//!
//! A raster has its own chunk, so that a reader of one value reads and decompresses no other, and a run that reuses it
//! copies its chunk unchanged. Small messages share an uncompressed chunk after those. Whether an image is
//! compressed is measured on a few of its own bytes, so that its chunk depends only on it.

use std::io::Cursor;

use crc32fast::Hasher;
use depthloom_graphs::Frame;
use depthloom_mcap::records::{ChunkHeader, ChunkIndex, MessageIndex, MessageIndexEntry};
use depthloom_mcap::{RECORD_HEADER, Records, chunk_index, op, put, put_fields, put_record, read, read_all};
use rustix::time::{ClockId, clock_gettime};

use crate::LARGEST_CHUNK;
use crate::write::buffer_pool::PartPools;
use depthloom_codecs::compression;

/// Space for the fields around a message's pixels: record header, times, names.
const FIELDS: usize = 256;

/// How the chunk of a raster is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    Plain,
    Compressed,
}

impl Packing {
    const fn name(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Compressed => "zstd",
        }
    }
}

/// An encoded part of a frame, or messages outside frames: complete chunks and their message indexes, at offsets from
/// its start.
#[derive(Debug)]
pub struct Part {
    pub(crate) bytes: Vec<u8>,
    pub(crate) crc: Hasher,
    pub(crate) chunks: Vec<ChunkIndex>,
    pub(crate) messages: Vec<u16>,
    /// CPU time of zstd, nanoseconds.
    pub(crate) compress_ns: u64,
}

#[derive(Debug)]
pub(crate) enum Unkept {
    /// A message is too large for a chunk.
    TooLarge {
        channel: u16,
        /// The size of the chunk with this message alone.
        bytes: u64,
    },
    /// zstd failed, which happens only without memory.
    Compression(std::io::Error),
}

/// Takes the messages of a frame's values.
pub(crate) trait Messages {
    /// Adds a small message, which shares a chunk with others.
    fn small(&mut self, channel: u16, data: &[u8]) -> Result<(), Unkept>;

    /// Adds a message with its own chunk; `size` is about the number of bytes that `data` appends.
    fn alone(
        &mut self,
        channel: u16,
        packing: Packing,
        size: usize,
        data: impl FnOnce(&mut Vec<u8>),
    ) -> Result<(), Unkept>;
}

/// A message in the records of a chunk.
#[derive(Clone, Copy)]
struct Placed {
    channel: u16,
    time_ns: u64,
    offset: u64,
}

pub(crate) struct PartBuilder<'a> {
    frame: &'a Frame,
    pools: &'a PartPools,
    part: Part,
    /// The records of the messages that share a chunk.
    shared: Vec<u8>,
    placed: Vec<Placed>,
    largest: u64,
}

/// Opcode, length, times, uncompressed size, checksum, compression, compressed size.
const fn header_length(compression: &str) -> usize {
    1 + 8 + 8 + 8 + 8 + 4 + 4 + compression.len() + 8
}

const PLAIN_HEADER: usize = header_length("");

impl<'a> PartBuilder<'a> {
    pub(crate) fn new(frame: &'a Frame, pools: &'a PartPools) -> Self {
        let (bytes, crc) = (pools.bytes.take(), Hasher::new());
        let part = Part { bytes, crc, chunks: Vec::new(), messages: Vec::new(), compress_ns: 0 };
        Self { frame, pools, part, shared: Vec::new(), placed: Vec::new(), largest: LARGEST_CHUNK }
    }

    /// Adds a chunk with one message, and its index, as stored in a recording by [`PartBuilder::alone`]. `crc` is the
    /// CRC-32 of these bytes. The inner error reports that `read` appended other bytes, or bytes that are not such a
    /// chunk.
    pub(crate) fn copied<E>(
        &mut self,
        channel: u16,
        crc: u32,
        read: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
    ) -> Result<Result<(), &'static str>, E> {
        let start = self.part.bytes.len();
        read(&mut self.part.bytes)?;
        let stored = &self.part.bytes[start..];
        let mut of_stored = Hasher::new();
        of_stored.update(stored);
        if of_stored.clone().finalize() != crc {
            return Ok(Err("a chunk changed while it was reused: repeat the command"));
        }
        let place = placed(stored, start as u64).filter(|(_, messages)| *messages == [(channel, 1)]);
        let Some((place, _)) = place else { return Ok(Err("a chunk and its indexes contradict each other")) };
        self.part.crc.combine(&of_stored);
        self.part.chunks.push(place);
        self.part.messages.push(channel);
        Ok(Ok(()))
    }

    pub(crate) fn finish(mut self) -> Part {
        self.close_shared();
        self.part
    }

    /// Closes the chunk of the small messages.
    fn close_shared(&mut self) {
        if self.placed.is_empty() {
            return;
        }
        let start = self.part.bytes.len();
        let records = (self.shared.len() as u64, crc32fast::hash(&self.shared));
        self.part.bytes.resize(start + PLAIN_HEADER, 0);
        self.part.bytes.append(&mut self.shared);
        self.part.close(start, Packing::Plain, records, None, &std::mem::take(&mut self.placed));
    }
}

impl Messages for PartBuilder<'_> {
    fn small(&mut self, channel: u16, data: &[u8]) -> Result<(), Unkept> {
        let time_ns = self.frame.time_ns;
        let start = self.shared.len();
        put_message(&mut self.shared, channel, self.frame.index as u32, time_ns, |out| out.extend_from_slice(data));
        let bytes = (self.shared.len() - start) as u64;
        if bytes > self.largest {
            return Err(Unkept::TooLarge { channel, bytes });
        }
        self.part.messages.push(channel);
        let mut offset = start as u64;
        if self.shared.len() as u64 > self.largest {
            let message = self.shared.split_off(start);
            self.close_shared();
            self.shared = message;
            offset = 0;
        }
        self.placed.push(Placed { channel, time_ns, offset });
        Ok(())
    }

    fn alone(
        &mut self,
        channel: u16,
        packing: Packing,
        size: usize,
        data: impl FnOnce(&mut Vec<u8>),
    ) -> Result<(), Unkept> {
        let (sequence, time_ns) = (self.frame.index as u32, self.frame.time_ns);
        let (start, header) = (self.part.bytes.len(), header_length(packing.name()));
        let records_start = start + header;
        let (uncompressed_size, crc, plain) = match packing {
            Packing::Plain => {
                let bytes = &mut self.part.bytes;
                bytes.reserve(header + size + FIELDS);
                bytes.resize(records_start, 0);
                put_message(bytes, channel, sequence, time_ns, data);
                let mut crc = Hasher::new();
                crc.update(&bytes[records_start..]);
                ((bytes.len() - records_start) as u64, crc.clone().finalize(), Some(crc))
            }
            Packing::Compressed => {
                let mut records = self.pools.records.take();
                records.reserve(size + FIELDS);
                put_message(&mut records, channel, sequence, time_ns, data);
                if records.len() as u64 <= self.largest {
                    self.part.compress(header, &records)?;
                }
                let known = (records.len() as u64, crc32fast::hash(&records));
                self.pools.records.put(records);
                (known.0, known.1, None)
            }
        };
        if uncompressed_size > self.largest {
            return Err(Unkept::TooLarge { channel, bytes: uncompressed_size });
        }
        self.part.messages.push(channel);
        let message = Placed { channel, time_ns, offset: 0 };
        self.part.close(start, packing, (uncompressed_size, crc), plain.as_ref(), &[message]);
        Ok(())
    }
}

impl Part {
    /// Moves everything out, with a copy of the bytes that has no spare capacity. The buffer stays.
    pub(crate) fn take_exact(&mut self) -> Self {
        Self {
            bytes: self.bytes.as_slice().to_vec(),
            crc: self.crc.clone(),
            chunks: std::mem::take(&mut self.chunks),
            messages: std::mem::take(&mut self.messages),
            compress_ns: self.compress_ns,
        }
    }

    /// About the bytes that it takes in memory.
    pub(crate) fn memory(&self) -> usize {
        // The index of a chunk has a map with one entry or a few.
        const CHUNK: usize = size_of::<ChunkIndex>() + 256;
        size_of::<Self>() + self.bytes.len() + CHUNK * self.chunks.len() + 2 * self.messages.len()
    }

    /// Appends space for a chunk's header, and compressed records.
    fn compress(&mut self, header: usize, records: &[u8]) -> Result<(), Unkept> {
        let records_start = self.bytes.len() + header;
        self.bytes.reserve(header + compression::bound(records.len()));
        self.bytes.resize(records_start, 0);
        let mut into = Cursor::new(std::mem::take(&mut self.bytes));
        into.set_position(records_start as u64);
        let began = thread_cpu_ns();
        compression::compress(records, &mut into).map_err(Unkept::Compression)?;
        self.compress_ns += thread_cpu_ns() - began;
        self.bytes = into.into_inner();
        Ok(())
    }

    /// Closes the chunk from `start` to the end of the bytes: writes its header into the reserved space, appends its
    /// message indexes, and adds it to the list. `records` is the hasher of uncompressed records, so that megabytes are
    /// not hashed twice.
    fn close(
        &mut self,
        start: usize,
        packing: Packing,
        (uncompressed_size, uncompressed_crc): (u64, u32),
        records: Option<&Hasher>,
        messages: &[Placed],
    ) {
        let (end, records_start) = (self.bytes.len(), start + header_length(packing.name()));
        let times = || messages.iter().map(|message| message.time_ns);
        let header = ChunkHeader {
            message_start_time: times().min().unwrap_or(0),
            message_end_time: times().max().unwrap_or(0),
            uncompressed_size,
            uncompressed_crc,
            compression: packing.name().to_owned(),
            compressed_size: (end - records_start) as u64,
        };
        let mut record = vec![op::CHUNK];
        record.extend_from_slice(&((end - start) as u64 - RECORD_HEADER).to_le_bytes());
        put_fields(&mut record, &header);
        self.bytes[start..records_start].copy_from_slice(&record);
        let mut place = chunk_index(header, start as u64, (end - start) as u64);
        let mut channels: Vec<u16> = messages.iter().map(|message| message.channel).collect();
        channels.sort_unstable();
        channels.dedup();
        for channel in channels {
            let of_channel = messages.iter().filter(|message| message.channel == channel);
            let entry = |message: &Placed| MessageIndexEntry { log_time: message.time_ns, offset: message.offset };
            place.message_index_offsets.insert(channel, self.bytes.len() as u64);
            put(&mut self.bytes, &MessageIndex { channel_id: channel, records: of_channel.map(entry).collect() });
        }
        place.message_index_length = (self.bytes.len() - end) as u64;
        let summed = records.map_or(start, |records| {
            self.crc.update(&self.bytes[start..records_start]);
            self.crc.combine(records);
            end
        });
        self.crc.update(&self.bytes[summed..]);
        self.chunks.push(place);
    }
}

/// A chunk and its message indexes, which start at `offset`, and the number of its messages per channel. `None` if they
/// are incomplete.
pub(crate) fn placed(stored: &[u8], offset: u64) -> Option<(ChunkIndex, Vec<(u16, u64)>)> {
    let mut records = Records::new(stored);
    let Some(Ok((0, op::CHUNK, body))) = records.next() else { return None };
    let (header, content) = read::<ChunkHeader>(body)?;
    if header.compressed_size != content.len() as u64 || !matches!(&*header.compression, "" | "zstd") {
        return None;
    }
    let length = RECORD_HEADER + body.len() as u64;
    let (mut place, mut messages) = (chunk_index(header, offset, length), Vec::new());
    for record in records {
        let Ok((at, op::MESSAGE_INDEX, body)) = record else { return None };
        let index: MessageIndex = read_all(body)?;
        place.message_index_offsets.insert(index.channel_id, offset + at);
        messages.push((index.channel_id, index.records.len() as u64));
    }
    place.message_index_length = stored.len() as u64 - length;
    Some((place, messages))
}

/// Appends a message; `data` appends its data.
fn put_message(out: &mut Vec<u8>, channel: u16, sequence: u32, time_ns: u64, data: impl FnOnce(&mut Vec<u8>)) {
    put_record(out, op::MESSAGE, |out| {
        out.extend_from_slice(&channel.to_le_bytes());
        out.extend_from_slice(&sequence.to_le_bytes());
        out.extend_from_slice(&time_ns.to_le_bytes());
        out.extend_from_slice(&time_ns.to_le_bytes());
        data(out);
    });
}

/// Messages of one channel outside frames, as one uncompressed chunk: time and content of each.
pub(crate) fn messages_outside_frames(channel: u16, content: impl IntoIterator<Item = (u64, Vec<u8>)>) -> Part {
    let mut bytes = vec![0; PLAIN_HEADER];
    let mut placed = Vec::new();
    for (sequence, (time_ns, data)) in (0_u32..).zip(content) {
        placed.push(Placed { channel, time_ns, offset: (bytes.len() - PLAIN_HEADER) as u64 });
        put_message(&mut bytes, channel, sequence, time_ns, |out| out.extend_from_slice(&data));
    }
    let messages = vec![channel; placed.len()];
    let mut part = Part { bytes, crc: Hasher::new(), chunks: Vec::new(), messages, compress_ns: 0 };
    if !placed.is_empty() {
        let records = &part.bytes[PLAIN_HEADER..];
        let records = (records.len() as u64, crc32fast::hash(records));
        part.close(0, Packing::Plain, records, None, &placed);
    }
    part
}

/// The CPU time of this thread, nanoseconds.
#[expect(clippy::cast_sign_loss, reason = "a thread's CPU time is not negative")]
fn thread_cpu_ns() -> u64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use depthloom_graphs::Frame;
    use depthloom_mcap::PositionedFile;

    use super::{Messages as _, Packing, PartBuilder, Unkept};
    use crate::read::chunk_messages::ChunkBuffers;
    use crate::read::index::ChunkEntry;
    use crate::write::buffer_pool::PartPools;

    #[test]
    fn fault_08_messages_too_large_for_one_chunk_are_split() {
        const LARGEST: u64 = 5000;
        let (frame, pools) = (Frame::at_10_hz("000000_10", 0), PartPools::default());
        let mut part = PartBuilder { largest: LARGEST, ..PartBuilder::new(&frame, &pools) };
        // Small messages, of which two fit into a chunk, and one that fills a chunk; and as many with their own chunks.
        let room = LARGEST as usize - 31;
        let sizes = [2000, 2400, 2300, 100, room, 2000, 2000, 2000, 1, 0, 3000];
        let mut expected: BTreeMap<u16, Vec<u8>> = BTreeMap::new();
        for (number, size) in (0_u16..).zip(sizes) {
            for (kind, packing) in (1_u16..).zip([None, Some(Packing::Plain), Some(Packing::Compressed)]) {
                let channel = kind * 100 + number;
                let data = vec![channel as u8; size];
                match packing {
                    None => part.small(channel, &data).unwrap(),
                    Some(packing) => part.alone(channel, packing, size, |out| out.extend_from_slice(&data)).unwrap(),
                }
                expected.insert(channel, data);
            }
        }
        let part = part.finish();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("chunks");
        std::fs::write(&path, &part.bytes).unwrap();
        let file = PositionedFile::open(&path).unwrap();
        let mut read: BTreeMap<u16, Vec<u8>> = BTreeMap::new();
        assert!(part.chunks.len() > 2 * sizes.len() + 4);
        for chunk in &part.chunks {
            assert!(chunk.uncompressed_size <= LARGEST);
            let (start, length) = (chunk.chunk_start_offset, chunk.chunk_length);
            let end = start + length + chunk.message_index_length;
            let channels: Vec<u16> = chunk.message_index_offsets.keys().copied().collect();
            let entry = ChunkEntry { start, length, end, channels: channels.clone().into() };
            let mut seen = Vec::new();
            let mut buffers = ChunkBuffers::default();
            let read = buffers.each_message(&file, &entry, |message| {
                seen.push(message.channel);
                assert_eq!(read.insert(message.channel, message.data.to_vec()), None);
                Ok(())
            });
            read.unwrap();
            seen.sort_unstable();
            assert_eq!(seen, channels);
            assert!(channels.iter().all(|channel| *channel < 200) || channels.len() == 1);
        }
        assert!(read == expected);
        assert_eq!(crc32fast::hash(&part.bytes), part.crc.finalize());
    }

    #[test]
    fn fault_08_a_message_that_is_too_large_is_refused_with_its_size() {
        let (frame, pools) = (Frame::at_10_hz("000000_10", 0), PartPools::default());
        for packing in [None, Some(Packing::Plain), Some(Packing::Compressed)] {
            let mut part = PartBuilder { largest: 5000, ..PartBuilder::new(&frame, &pools) };
            let refused = match packing {
                None => part.small(1, &[0; 100]).and_then(|()| part.small(2, &[0; 4970])),
                Some(packing) => part.alone(2, packing, 4970, |out| out.extend_from_slice(&[0; 4970])),
            };
            assert!(matches!(refused, Err(Unkept::TooLarge { channel: 2, bytes: 5001 })), "{refused:?}");
        }
    }
}
