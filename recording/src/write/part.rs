//! A part of a frame as chunks: framed, checked and compressed by the worker that has its values.
//!
//! A raster has a chunk of its own, so that who reads one value reads and decompresses no other, and a run that takes it from an earlier
//! one copies its chunk as it lies. Small messages share an uncompressed chunk behind those. Whether a raster is compressed is measured
//! on a few of its own bytes, so that its chunk depends on it alone.

use std::collections::BTreeMap;
use std::io::Cursor;

use crc32fast::Hasher;
use depthloom_graphs::Frame;
use depthloom_mcap::records::{ChunkHeader, ChunkIndex, MessageIndex, MessageIndexEntry};
use depthloom_mcap::{RECORD_HEADER, Records, op, put, put_fields, put_record, read, read_all};
use rustix::time::{ClockId, clock_gettime};

use crate::LARGEST_CHUNK;
use crate::write::buffer_pool::PartPools;
use depthloom_codecs::compression;

/// Room for what surrounds a message's pixels: record header, times, names.
const FIELDS: usize = 256;
/// How the chunk of a raster is to be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    /// As it is.
    Plain,
    /// Compressed.
    Compressed,
}

impl Packing {
    /// Its name in MCAP.
    const fn name(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Compressed => "zstd",
        }
    }
}

/// An encoded part of a frame, or messages outside frames: whole chunks and their message indexes, at offsets from its start.
#[derive(Debug)]
pub struct Part {
    pub(crate) bytes: Vec<u8>,
    pub(crate) crc: Hasher,
    pub(crate) chunks: Vec<ChunkIndex>,
    /// The channel of each message.
    pub(crate) messages: Vec<u16>,
    /// Processor time that zstd took, nanoseconds.
    pub(crate) compress_ns: u64,
}

/// Why a part cannot be kept.
#[derive(Debug)]
pub(crate) enum Unkept {
    /// A message is too large for a chunk.
    TooLarge {
        /// Its channel.
        channel: u16,
        /// Its size, with what surrounds it in a chunk.
        bytes: u64,
    },
    /// zstd failed, which it does only without memory.
    Compression(std::io::Error),
}

/// A message in the records of a chunk.
#[derive(Clone, Copy)]
struct Placed {
    channel: u16,
    time_ns: u64,
    offset: u64,
}

/// Fills a part with messages.
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

    /// Adds a small message, which shares a chunk with others.
    ///
    /// # Errors
    /// If it is larger than a chunk may be.
    pub(crate) fn small(&mut self, channel: u16, data: &[u8]) -> Result<(), Unkept> {
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

    /// Adds a message with a chunk of its own; `size` is about how many bytes `data` appends.
    ///
    /// # Errors
    /// If it is larger than a chunk may be, or zstd fails.
    pub(crate) fn alone(
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
        let stored = (self.part.bytes.len() - records_start) as u64;
        let header = chunk_header((time_ns, time_ns), uncompressed_size, crc, packing, stored);
        self.part.bytes[start..records_start].copy_from_slice(&header);
        self.part.close(start, uncompressed_size, packing, plain.as_ref(), &[Placed { channel, time_ns, offset: 0 }]);
        Ok(())
    }

    /// Adds a chunk with one message, and its index, as they are stored in a recording: what [`PartBuilder::alone`] made there. `crc` is the CRC-32
    /// of these bytes.
    ///
    /// # Errors
    /// Those of `read`. Inside, in words, if `read` appends other bytes, or bytes that are not such a chunk.
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
            return Ok(Err("a chunk changed while it was reused: run the same again"));
        }
        let place = placed(stored, start as u64).filter(|(_, messages)| *messages == [(channel, 1)]);
        let Some((place, _)) = place else { return Ok(Err("a chunk and its indexes contradict each other")) };
        self.part.crc.combine(&of_stored);
        self.part.chunks.push(place);
        self.part.messages.push(channel);
        Ok(Ok(()))
    }

    /// The part.
    pub(crate) fn finish(mut self) -> Part {
        self.close_shared();
        self.part
    }

    /// Closes the chunk of the messages that share one.
    fn close_shared(&mut self) {
        if self.placed.is_empty() {
            return;
        }
        let start = self.part.bytes.len();
        let size = self.shared.len() as u64;
        let crc = crc32fast::hash(&self.shared);
        self.part.bytes.extend_from_slice(&chunk_header(times_ns(&self.placed), size, crc, Packing::Plain, size));
        self.part.bytes.append(&mut self.shared);
        self.part.close(start, size, Packing::Plain, None, &std::mem::take(&mut self.placed));
    }
}

impl Part {
    /// Appends room for a chunk's header, and records, compressed.
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

    /// Appends the message indexes of the chunk that starts there and ends the bytes, and notes where it is; `records` is what its stored
    /// records are known to give, so that megabytes are not summed twice.
    fn close(
        &mut self,
        start: usize,
        uncompressed_size: u64,
        packing: Packing,
        records: Option<&Hasher>,
        messages: &[Placed],
    ) {
        let end = self.bytes.len();
        let (length, header) = ((end - start) as u64, header_length(packing.name()));
        let (message_start_time, message_end_time) = times_ns(messages);
        let mut place = ChunkIndex {
            message_start_time,
            message_end_time,
            chunk_start_offset: start as u64,
            chunk_length: length,
            message_index_offsets: BTreeMap::new(),
            message_index_length: 0,
            compression: packing.name().to_owned(),
            compressed_size: length - header as u64,
            uncompressed_size,
        };
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
            self.crc.update(&self.bytes[start..start + header]);
            self.crc.combine(records);
            end
        });
        self.crc.update(&self.bytes[summed..]);
        self.chunks.push(place);
    }
}

/// A chunk and its message indexes, which start at `offset`; and how many messages it has of each channel. `None` if they are not whole.
pub(crate) fn placed(stored: &[u8], offset: u64) -> Option<(ChunkIndex, Vec<(u16, u64)>)> {
    let mut records = Records::new(stored);
    let Some(Ok((0, op::CHUNK, body))) = records.next() else { return None };
    let (header, content) = read::<ChunkHeader>(body)?;
    if header.compressed_size != content.len() as u64 || !matches!(&*header.compression, "" | "zstd") {
        return None;
    }
    let length = RECORD_HEADER + body.len() as u64;
    let (mut message_index_offsets, mut messages) = (BTreeMap::new(), Vec::new());
    for record in records {
        let Ok((at, op::MESSAGE_INDEX, body)) = record else { return None };
        let index: MessageIndex = read_all(body)?;
        message_index_offsets.insert(index.channel_id, offset + at);
        messages.push((index.channel_id, index.records.len() as u64));
    }
    let place = ChunkIndex {
        message_start_time: header.message_start_time,
        message_end_time: header.message_end_time,
        chunk_start_offset: offset,
        chunk_length: length,
        message_index_offsets,
        message_index_length: stored.len() as u64 - length,
        compression: header.compression,
        compressed_size: header.compressed_size,
        uncompressed_size: header.uncompressed_size,
    };
    Some((place, messages))
}

/// Appends a message whose data `data` appends.
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
        let size = (part.bytes.len() - PLAIN_HEADER) as u64;
        let crc = crc32fast::hash(&part.bytes[PLAIN_HEADER..]);
        part.bytes[..PLAIN_HEADER].copy_from_slice(&chunk_header(times_ns(&placed), size, crc, Packing::Plain, size));
        part.close(0, size, Packing::Plain, None, &placed);
    }
    part
}

/// The first and last time of messages; zero where there are none.
fn times_ns(messages: &[Placed]) -> (u64, u64) {
    let times = || messages.iter().map(|message| message.time_ns);
    (times().min().unwrap_or(0), times().max().unwrap_or(0))
}

/// The processor time of this thread, nanoseconds.
#[expect(clippy::cast_sign_loss, reason = "a thread's processor time is not negative")]
fn thread_cpu_ns() -> u64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

/// What comes before the stored records of a chunk.
fn chunk_header(times_ns: (u64, u64), size: u64, crc: u32, packing: Packing, stored: u64) -> Vec<u8> {
    let (message_start_time, message_end_time) = times_ns;
    let (compression, mut record) = (packing.name().to_owned(), vec![op::CHUNK; RECORD_HEADER as usize]);
    let (uncompressed_size, uncompressed_crc, compressed_size) = (size, crc, stored);
    put_fields(
        &mut record,
        &ChunkHeader {
            message_start_time,
            message_end_time,
            uncompressed_size,
            uncompressed_crc,
            compression,
            compressed_size,
        },
    );
    let length = record.len() as u64 - RECORD_HEADER + stored;
    record[1..RECORD_HEADER as usize].copy_from_slice(&length.to_le_bytes());
    record
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use depthloom_graphs::Frame;
    use depthloom_mcap::PositionedFile;

    use super::{Packing, PartBuilder, Unkept};
    use crate::read::chunk_messages::ChunkBuffers;
    use crate::read::index::ChunkEntry;
    use crate::write::buffer_pool::PartPools;

    #[test]
    fn fault_08_what_does_not_fit_into_a_chunk_lies_in_several() {
        const LARGEST: u64 = 5000;
        let (frame, pools) = (Frame::at_10_hz("000000_10", 0), PartPools::default());
        let mut part = PartBuilder { largest: LARGEST, ..PartBuilder::new(&frame, &pools) };
        // Small ones, of which two fit into a chunk, one of them as large as a chunk can hold; and as many with chunks of their own.
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
            let taken = buffers.each_message(&file, &entry, |message| {
                seen.push(message.channel);
                assert_eq!(read.insert(message.channel, message.data.to_vec()), None);
                Ok(())
            });
            taken.unwrap();
            seen.sort_unstable();
            assert_eq!(seen, channels);
            assert!(channels.iter().all(|channel| *channel < 200) || channels.len() == 1);
        }
        assert!(read == expected);
        assert_eq!(crc32fast::hash(&part.bytes), part.crc.finalize());
    }

    #[test]
    fn fault_08_a_message_that_no_reader_takes_is_refused_with_its_size() {
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
