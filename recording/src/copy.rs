//! Values taken over from another recording as the bytes they are.

use depthloom_graphs::Frame;
use depthloom_graphs::contracts::StoredValue;
use mcap::records::op;

use crate::chunk::{PartBuilder, Unkept};
use crate::earlier::{EarlierRun, EarlierRuns};
use crate::error::RecordingError;
use crate::index::ChunkEntry;
use crate::layout::{ChannelLayout, RunLayout};
use crate::parse::{self, RECORD_HEADER, Records};
use crate::record::ChunkPlace;
use crate::recording::Recording;
use crate::store::KeyedPlace;
use crate::unpack::ChunkBuffers;

/// What values are to be part of.
pub(crate) struct Wanted<'a> {
    pub(crate) layout: &'a RunLayout,
    /// All channels of the recording that is written; a channel's id is its index plus one.
    pub(crate) channels: &'a [ChannelLayout],
    pub(crate) frame: &'a Frame,
}

/// A value as it lies in an earlier run.
pub(crate) struct Lying<'a> {
    run: &'a EarlierRun,
    /// Its messages' channels, each with the chunk; in the order in which they are written.
    chunks: Vec<(u16, &'a ChunkEntry)>,
    /// Whether its messages share a chunk with others.
    shares: bool,
}

impl EarlierRuns {
    /// A value, if a recording has it of the same frame, under the same channels: then the bytes there are those that encoding it would give.
    pub(crate) fn lying(&self, wanted: &Wanted<'_>, stored: &StoredValue<'_>) -> Option<Lying<'_>> {
        let port = wanted.layout.port(stored.slot)?;
        let (run, place) = self.locate(&stored.key, stored.port)?;
        let KeyedPlace::Frame { run: stage, position, .. } = place else { return None };
        let recording = &run.recording;
        let outputs = &recording.plan().runs[stage].source.outputs;
        let ports = outputs.iter().map(|output| (output.port.as_str(), output.value_type()));
        // The frame ids of messages follow from the source's ports.
        let has_same_cameras = ports.eq(wanted.layout.source_ports.iter().map(|(name, of)| (name.as_str(), Some(*of))));
        let frame = &recording.frames(stage)[position];
        let is_same_frame =
            (&frame.id, frame.index, frame.time_ns) == (&wanted.frame.id, wanted.frame.index, wanted.frame.time_ns);
        if !recording.is_of_this_format() || !has_same_cameras || !is_same_frame {
            return None;
        }
        // In which of its forms a value is kept is seen by the channel that it used.
        let has = |channel: &u16| find(recording, stage, position, *channel).is_some();
        let value = [Some(port.channel), port.other_channel].into_iter().flatten().find(has)?;
        let shares = wanted.channels[usize::from(value) - 1].schema.is_small();
        let chunk = |channel: u16| {
            let chunk = find(recording, stage, position, channel)?;
            let is_apart = shares || *chunk.channels == [channel];
            (is_apart && is_same(recording, wanted.channels, channel)).then_some((channel, chunk))
        };
        let beside = port.beside.iter().map(|beside| beside.channel);
        let chunks: Option<Vec<_>> = std::iter::once(value).chain(beside).map(chunk).collect();
        Some(Lying { run, chunks: chunks?, shares })
    }
}

/// The chunk of a frame that has messages of a channel.
fn find(recording: &Recording, stage: usize, position: usize, channel: u16) -> Option<&ChunkEntry> {
    let chunks = recording.frames(stage)[position].chunks(&recording.index);
    chunks.iter().find(|chunk| chunk.channels.binary_search(&channel).is_ok())
}

impl Lying<'_> {
    /// Adds the value to a part: a chunk of its own as it lies, messages of a shared one to that of the part.
    ///
    /// # Errors
    /// If the recording cannot be read, or what was there is too much for the part.
    pub(crate) fn copy(&self, part: &mut PartBuilder<'_>) -> Result<Result<(), Unkept>, RecordingError> {
        let file = &self.run.recording.file;
        self.run.take();
        for (channel, chunk) in &self.chunks {
            if !self.shares {
                let contradicts = || file.damaged(chunk.start, "a chunk and its indexes contradict each other");
                let copied =
                    part.copied(*channel, |bytes| file.append_range(bytes, chunk.start, chunk.end - chunk.start));
                copied?.ok_or_else(contradicts)?;
                continue;
            }
            let mut added = Ok(());
            ChunkBuffers::default().each_message(file, chunk, |message| {
                if message.channel == *channel && added.is_ok() {
                    added = part.small(*channel, message.data);
                }
                Ok(())
            })?;
            if added.is_err() {
                return Ok(added);
            }
        }
        Ok(Ok(()))
    }
}

/// Whether a channel is in a recording what it is in the one that is written.
fn is_same(recording: &Recording, channels: &[ChannelLayout], id: u16) -> bool {
    let wanted = &channels[usize::from(id) - 1];
    let found = recording.index.channels.get(&id);
    found.is_some_and(|found| {
        found.written_topic == wanted.topic && recording.index.schema_of(found) == Some(wanted.schema.name())
    })
}

/// A chunk and its message indexes, which start at `offset`; and how many messages it has of each channel. `None` if they are not whole.
pub(crate) fn placed(stored: &[u8], offset: u64) -> Option<(ChunkPlace, Vec<(u16, u64)>)> {
    let mut records = Records::new(stored);
    let Some(Ok((0, op::CHUNK, body))) = records.next() else { return None };
    let head = parse::chunk_head(body).filter(|head| head.body_length == Some(body.len() as u64))?;
    let compression = match head.compression {
        "" => "",
        "zstd" => "zstd",
        _ => return None,
    };
    let length = RECORD_HEADER + body.len() as u64;
    let (mut indexes, mut messages) = (Vec::new(), Vec::new());
    for record in records {
        let Ok((at, op::MESSAGE_INDEX, body)) = record else { return None };
        let channel = parse::message_index_channel(body, body.len() as u64)?;
        indexes.push((channel, offset + at));
        messages.push((channel, (body.len() as u64 - 6) / 16));
    }
    let place = ChunkPlace {
        start: offset,
        length,
        times_ns: head.times_ns,
        indexes,
        indexes_length: stored.len() as u64 - length,
        compression,
        compressed_size: head.stored,
        uncompressed_size: head.uncompressed_size,
    };
    Some((place, messages))
}
