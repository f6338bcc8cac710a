//! A part of a frame as chunks: framed, checked and compressed by the worker that has its values.
//!
//! A part of a frame has three chunks: messages that hardly shrink lie uncompressed in one, those that do in a second, and the
//! depths for looking at in a third; more only where one would grow past what readers take. Whether a message shrinks is measured on a few of its own bytes, so that it depends on
//! the message alone.

use std::io::Cursor;

use crc32fast::Hasher;
use depthloom_graphs::Frame;
use mcap::records::op;
use rustix::time::{ClockId, clock_gettime};

use crate::compression;
use crate::pool::PartPools;
use crate::record::{ChunkPlace, put_message, put_message_index};
use crate::unpack::LARGEST_CHUNK;

/// A message is compressed if a sample of it shrinks to less than this share.
///
/// On KITTI frames zstd brings maps made of fixed-point disparities to 0.19-0.37 and a ground plane to 0.001, fused maps to
/// 0.5-0.73, weights and a network's depths to 0.79-0.84: compressing the latter costs more time than writing them.
const WORTH_COMPRESSING: f64 = 0.5;
/// Messages below this many bytes are kept as they are.
const SMALL: usize = 1024;
/// Room for what surrounds a message's pixels: record header, times, names.
const FIELDS: usize = 256;
/// The sample: this many windows of this many bytes, evenly spaced.
const WINDOWS: usize = 8;
const WINDOW: usize = 4096;

/// How a message is to be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    /// As it is.
    Plain,
    /// Compressed.
    Compressed,
    /// Compressed, and apart from the others.
    View,
}

/// An encoded part of a frame, or messages outside frames: whole chunks and their message indexes, at offsets from its start.
#[derive(Debug)]
pub struct Part {
    pub(crate) bytes: Vec<u8>,
    pub(crate) crc: Hasher,
    pub(crate) chunks: Vec<ChunkPlace>,
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

/// The records of a chunk being filled.
#[derive(Default)]
struct Lane {
    records: Vec<u8>,
    messages: Vec<Placed>,
}

/// Fills a part with messages.
pub(crate) struct PartBuilder<'a> {
    frame: &'a Frame,
    pools: &'a PartPools,
    /// The uncompressed chunk grows where it will stay, behind room for its header.
    bytes: Vec<u8>,
    plain: Vec<Placed>,
    packed: Lane,
    view: Lane,
    /// What did not fit into these chunks, in more of them: that follow the first, and are all but never there.
    more: Vec<(Packing, Lane)>,
    messages: Vec<u16>,
    largest: u64,
    too_large: Option<Unkept>,
}

/// Opcode, length, times, uncompressed size, checksum, compression, compressed size.
const fn header_length(compression: &str) -> usize {
    1 + 8 + 8 + 8 + 8 + 4 + 4 + compression.len() + 8
}

const PLAIN_HEADER: usize = header_length("");

impl<'a> PartBuilder<'a> {
    pub(crate) fn new(frame: &'a Frame, pools: &'a PartPools) -> Self {
        let mut bytes = pools.bytes.take();
        bytes.resize(PLAIN_HEADER, 0);
        Self {
            frame,
            pools,
            bytes,
            plain: Vec::new(),
            packed: Lane::default(),
            view: Lane::default(),
            more: Vec::new(),
            messages: Vec::new(),
            largest: LARGEST_CHUNK,
            too_large: None,
        }
    }

    /// Adds a message; `size` is about how many bytes `data` appends.
    pub(crate) fn message(&mut self, channel: u16, packing: Packing, size: usize, data: impl FnOnce(&mut Vec<u8>)) {
        let (sequence, time_ns) = (self.frame.index as u32, self.frame.time_ns);
        self.messages.push(channel);
        let (records, messages, header) = match packing {
            Packing::Plain => (&mut self.bytes, &mut self.plain, PLAIN_HEADER),
            Packing::Compressed => (&mut self.packed.records, &mut self.packed.messages, 0),
            Packing::View => (&mut self.view.records, &mut self.view.messages, 0),
        };
        if records.capacity() == 0 {
            *records = self.pools.records.take();
        }
        let start = records.len();
        records.reserve(size + FIELDS);
        put_message(records, channel, sequence, time_ns, data);
        messages.push(Placed { channel, time_ns, offset: (start - header) as u64 });
        if (records.len() - header) as u64 > self.largest {
            let message = records.split_off(start);
            messages.pop();
            self.overflow(packing, Placed { channel, time_ns, offset: 0 }, message);
        }
    }

    /// Keeps a message that its chunk has no room for in another.
    fn overflow(&mut self, packing: Packing, message: Placed, record: Vec<u8>) {
        let bytes = record.len() as u64;
        if bytes > self.largest {
            self.too_large.get_or_insert(Unkept::TooLarge { channel: message.channel, bytes });
            return;
        }
        let last = self.more.iter_mut().rev().find(|(of, _)| *of == packing);
        match last.filter(|(_, lane)| lane.records.len() as u64 + bytes <= self.largest) {
            Some((_, lane)) => {
                lane.messages.push(Placed { offset: lane.records.len() as u64, ..message });
                lane.records.extend_from_slice(&record);
            }
            None => self.more.push((packing, Lane { records: record, messages: vec![message] })),
        }
    }

    /// Compresses, checks and indexes the chunks.
    ///
    /// # Errors
    /// If a message is larger than a chunk may be, or zstd fails.
    pub(crate) fn finish(self) -> Result<Part, Unkept> {
        let Self { pools, mut bytes, plain, packed, view, more, messages, too_large, .. } = self;
        if let Some(too_large) = too_large {
            return Err(too_large);
        }
        let mut crc = Hasher::new();
        let mut chunks = Vec::new();
        let mut compress_ns = 0;
        if plain.is_empty() {
            bytes.clear();
        } else {
            chunks.push(plain_chunk(&mut bytes, &mut crc, &plain));
        }
        for (packing, lane) in [(Packing::Compressed, packed), (Packing::View, view)].into_iter().chain(more) {
            if lane.messages.is_empty() {
                continue;
            }
            let named = if packing == Packing::Plain { "" } else { "zstd" };
            let start = bytes.len();
            let records_start = start + header_length(named);
            let bound = match packing {
                Packing::Plain => lane.records.len(),
                Packing::Compressed | Packing::View => compression::bound(lane.records.len()),
            };
            bytes.reserve(records_start - start + bound);
            bytes.resize(records_start, 0);
            if packing == Packing::Plain {
                bytes.extend_from_slice(&lane.records);
            } else {
                let mut into = Cursor::new(bytes);
                into.set_position(records_start as u64);
                let began = thread_cpu_ns();
                compression::compress(&lane.records, &mut into).map_err(Unkept::Compression)?;
                compress_ns += thread_cpu_ns() - began;
                bytes = into.into_inner();
            }
            let stored = (bytes.len() - records_start) as u64;
            let size = lane.records.len() as u64;
            let times_ns = times_ns(&lane.messages);
            let header = chunk_header(times_ns, size, crc32fast::hash(&lane.records), named, stored);
            bytes[start..records_start].copy_from_slice(&header);
            crc.update(&bytes[start..]);
            let place = place(times_ns, start, bytes.len() - start, named, stored, size);
            chunks.push(indexed(&mut bytes, &mut crc, place, &lane.messages));
            pools.records.put(lane.records);
        }
        Ok(Part { bytes, crc, chunks, messages, compress_ns })
    }
}

/// Messages of one channel outside frames, as one uncompressed chunk: time and content of each.
pub(crate) fn messages_outside_frames(channel: u16, content: impl IntoIterator<Item = (u64, Vec<u8>)>) -> Part {
    let mut bytes = vec![0; PLAIN_HEADER];
    let mut placed = Vec::new();
    for (sequence, (time_ns, data)) in (0_u32..).zip(content) {
        placed.push(Placed { channel, time_ns, offset: (bytes.len() - PLAIN_HEADER) as u64 });
        put_message(&mut bytes, channel, sequence, time_ns, |out| out.extend_from_slice(&data));
    }
    let mut crc = Hasher::new();
    let chunks = if placed.is_empty() { Vec::new() } else { vec![plain_chunk(&mut bytes, &mut crc, &placed)] };
    Part { bytes, crc, chunks, messages: vec![channel; placed.len()], compress_ns: 0 }
}

/// Closes the uncompressed chunk that `bytes` holds behind the room for its header, and appends its message indexes.
fn plain_chunk(bytes: &mut Vec<u8>, crc: &mut Hasher, messages: &[Placed]) -> ChunkPlace {
    let mut records_crc = Hasher::new();
    records_crc.update(&bytes[PLAIN_HEADER..]);
    let size = (bytes.len() - PLAIN_HEADER) as u64;
    let times_ns = times_ns(messages);
    let header = chunk_header(times_ns, size, records_crc.clone().finalize(), "", size);
    bytes[..PLAIN_HEADER].copy_from_slice(&header);
    crc.update(&header);
    crc.combine(&records_crc);
    let place = place(times_ns, 0, bytes.len(), "", size, size);
    indexed(bytes, crc, place, messages)
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

/// How samples of a raster are best kept, measured on a few of them; `put` appends the bytes of a stretch of samples.
///
/// # Errors
/// If zstd fails: a guess would give other bytes than those of a run that measured.
pub(crate) fn measured<T>(samples: &[T], put: impl Fn(&mut Vec<u8>, &[T])) -> Result<Packing, Unkept> {
    let window = WINDOW / size_of::<T>();
    let mut sample = Vec::with_capacity(WINDOWS * WINDOW);
    if samples.len() <= WINDOWS * window {
        put(&mut sample, samples);
    } else {
        let step = (samples.len() - window) / (WINDOWS - 1);
        for at in (0..WINDOWS).map(|number| number * step) {
            put(&mut sample, &samples[at..at + window]);
        }
    }
    let mut packed = Vec::with_capacity(compression::bound(sample.len()));
    let packed = compression::compress(&sample, &mut packed).map_err(Unkept::Compression)?;
    let shrinks = (packed as f64) < WORTH_COMPRESSING * sample.len() as f64;
    Ok(if shrinks && sample.len() >= SMALL { Packing::Compressed } else { Packing::Plain })
}

fn chunk_header(times_ns: (u64, u64), size: u64, crc: u32, compression: &str, compressed: u64) -> Vec<u8> {
    let mut header = Vec::with_capacity(header_length(compression));
    header.push(op::CHUNK);
    let after_length = (header_length(compression) - 9) as u64;
    for number in [after_length + compressed, times_ns.0, times_ns.1, size] {
        header.extend_from_slice(&number.to_le_bytes());
    }
    header.extend_from_slice(&crc.to_le_bytes());
    header.extend_from_slice(&(compression.len() as u32).to_le_bytes());
    header.extend_from_slice(compression.as_bytes());
    header.extend_from_slice(&compressed.to_le_bytes());
    header
}

fn place(
    times_ns: (u64, u64),
    start: usize,
    length: usize,
    compression: &'static str,
    compressed_size: u64,
    uncompressed_size: u64,
) -> ChunkPlace {
    let (start, length) = (start as u64, length as u64);
    let (indexes, indexes_length) = (Vec::new(), 0);
    ChunkPlace { start, length, times_ns, indexes, indexes_length, compression, compressed_size, uncompressed_size }
}

/// Appends the message indexes of a chunk, and notes where they are.
fn indexed(bytes: &mut Vec<u8>, crc: &mut Hasher, mut place: ChunkPlace, messages: &[Placed]) -> ChunkPlace {
    let start = bytes.len();
    let mut channels: Vec<u16> = messages.iter().map(|message| message.channel).collect();
    channels.sort_unstable();
    channels.dedup();
    for channel in channels {
        let of_channel = messages.iter().filter(|message| message.channel == channel);
        let entries: Vec<(u64, u64)> = of_channel.map(|message| (message.time_ns, message.offset)).collect();
        place.indexes.push((channel, bytes.len() as u64));
        put_message_index(bytes, channel, &entries);
    }
    place.indexes_length = (bytes.len() - start) as u64;
    crc.update(&bytes[start..]);
    place
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use depthloom_graphs::Frame;

    use super::{Packing, PartBuilder, Unkept, measured};
    use crate::file::PositionedFile;
    use crate::index::ChunkEntry;
    use crate::pool::PartPools;
    use crate::unpack::ChunkBuffers;

    #[test]
    fn fault_08_what_does_not_fit_into_a_chunk_lies_in_several() {
        const LARGEST: u64 = 5000;
        let (frame, pools) = (Frame::at_10_hz("000000_10", 0), PartPools::default());
        let mut part = PartBuilder { largest: LARGEST, ..PartBuilder::new(&frame, &pools) };
        // In all eleven of each kind, of which two fit into a chunk, and one as large as a chunk can hold.
        let room = LARGEST as usize - 31;
        let sizes = [2000, 2400, 2300, 100, room, 2000, 2000, 2000, 1, 0, 3000];
        let mut expected: BTreeMap<u16, Vec<u8>> = BTreeMap::new();
        for (number, size) in (0_u16..).zip(sizes) {
            for (kind, packing) in (1_u16..).zip([Packing::Plain, Packing::Compressed, Packing::View]) {
                let channel = kind * 100 + number;
                let data = vec![channel as u8; size];
                part.message(channel, packing, size, |out| out.extend_from_slice(&data));
                expected.insert(channel, data);
            }
        }
        let part = part.finish().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("chunks");
        std::fs::write(&path, &part.bytes).unwrap();
        let file = PositionedFile::open(&path).unwrap();
        let mut read: BTreeMap<u16, Vec<u8>> = BTreeMap::new();
        assert!(part.chunks.len() > 12);
        for chunk in &part.chunks {
            assert!(chunk.uncompressed_size <= LARGEST);
            let end = chunk.start + chunk.length + chunk.indexes_length;
            let channels: Vec<u16> = chunk.indexes.iter().map(|(channel, _)| *channel).collect();
            let entry = ChunkEntry { start: chunk.start, length: chunk.length, end, channels: channels.clone().into() };
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
        }
        assert!(read == expected);
        assert_eq!(crc32fast::hash(&part.bytes), part.crc.finalize());
    }

    #[test]
    fn fault_08_a_message_that_no_reader_takes_is_refused_with_its_size() {
        let (frame, pools) = (Frame::at_10_hz("000000_10", 0), PartPools::default());
        for packing in [Packing::Plain, Packing::Compressed, Packing::View] {
            let mut part = PartBuilder { largest: 5000, ..PartBuilder::new(&frame, &pools) };
            part.message(1, packing, 100, |out| out.extend_from_slice(&[0; 100]));
            part.message(2, packing, 4970, |out| out.extend_from_slice(&[0; 4970]));
            let refused = part.finish();
            assert!(matches!(refused, Err(Unkept::TooLarge { channel: 2, bytes: 5001 })), "{refused:?}");
        }
    }

    #[test]
    fn noise_stays_as_it_is_and_repetition_is_compressed() {
        let mut state = 1_u64;
        let noise: Vec<u8> = (0..200_000)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 56) as u8
            })
            .collect();
        let packing = |samples: &[u8]| measured(samples, Vec::extend_from_slice).unwrap();
        assert_eq!(packing(&noise), Packing::Plain);
        assert_eq!(packing(&noise.iter().map(|byte| byte % 2).collect::<Vec<u8>>()), Packing::Compressed);
        assert_eq!(packing(&[0; 100]), Packing::Plain, "too small to matter");
    }
}
