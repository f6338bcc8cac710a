//! Values copied from another recording as stored bytes.

use depthloom_graphs::contracts::StoredValue;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::{Frame, Key};

use crate::error::RecordingError;
use crate::read::chunk_messages::ChunkBuffers;
use crate::read::index::ChunkEntry;
use crate::read::recording::{Recording, StoredValues};
use crate::reuse::earlier_runs::{EarlierRun, EarlierRuns};
use crate::write::layout::{ChannelLayout, PortLayout, RunLayout};
use crate::write::part::{Messages as _, PartBuilder, Unkept};

pub(crate) struct CopyTarget<'a> {
    pub(crate) layout: &'a RunLayout,
    /// All channels of the recording that is written; a channel's id is its index plus one.
    pub(crate) channels: &'a [ChannelLayout],
    pub(crate) frame: &'a Frame,
    /// The values of the part that are stored in earlier runs.
    pub(crate) stored: &'a [StoredValue<'a>],
}

/// The stored bytes of a value of an earlier run, and the key that they are stored under.
pub(crate) struct StoredBytes<'a> {
    run: &'a EarlierRun,
    key: Key,
    /// The chunks of its messages, in the order of writing.
    chunks: Vec<CheckedChunk<'a>>,
    /// Whether its messages share a chunk with others.
    shares: bool,
}

/// A chunk of a frame whose bytes were checked.
struct CheckedChunk<'a> {
    channel: u16,
    chunk: &'a ChunkEntry,
    /// The CRC-32 of the chunk and its message indexes, as stored.
    crc: u32,
}

impl EarlierRuns {
    /// The bytes stored under the key of a value, if they equal the encoding of the value in this recording: the frame
    /// and the labels (topic, channel, camera) must be the same. Labels never decide which bytes are found.
    pub(crate) fn stored_bytes<'a>(
        &'a self,
        target: &CopyTarget<'_>,
        stored: &StoredValue<'_>,
    ) -> Option<StoredBytes<'a>> {
        let port = target.layout.port(stored.slot)?;
        let (run, place) = self.locate(&stored.key, stored.port)?;
        let StoredValues::Frame { run: stage, position, .. } = place.values() else { return None };
        let recording = &run.recording;
        let value = recording.value_chunk(place, stored.port)?;
        let is_of_this_port = value.topic == &*port.topic
            && [Some(port.channel), port.other_channel].contains(&Some(value.channel))
            && is_made_of_known_values(target, port, recording.frames(stage)[position].source_key);
        if !is_of_this_port
            || !has_same_cameras(recording, stage, target)
            || !is_same_frame(recording, stage, position, target.frame)
        {
            return None;
        }
        let frame_chunks = recording.frames(stage)[position].chunks(&recording.index);
        let checksums = self.checksums(run, stage, position)?;
        let shares = target.channels[usize::from(value.channel) - 1].schema.is_small();
        let copied = |channel: u16, chunk: &'a ChunkEntry| {
            let is_apart = shares || *chunk.channels == [channel];
            let place = frame_chunks.iter().position(|of_frame| of_frame.start == chunk.start)?;
            let checked = CheckedChunk { channel, chunk, crc: checksums[place] };
            (is_apart && has_same_label(recording, target.channels, channel)).then_some(checked)
        };
        let companions = port
            .companions
            .iter()
            .map(|companion| copied(companion.channel, recording.chunk_of(stage, position, companion.channel)?));
        let chunks: Option<Vec<_>> = std::iter::once(copied(value.channel, value.chunk)).chain(companions).collect();
        Some(StoredBytes { run, key: place.key(), chunks: chunks?, shares })
    }
}

/// Whether the companion messages of a value follow from its key and from recorded values of the same source frame:
/// points also depend on the source's calibration and image.
fn is_made_of_known_values(target: &CopyTarget<'_>, port: &PortLayout, source_key: Option<Key>) -> bool {
    port.needed().all(|slot| {
        let key = target.stored.iter().find(|stored| stored.slot == slot).map(|stored| stored.key);
        key.is_some() && key == source_key
    })
}

/// Whether the names of coordinate frames in a stage's messages are the same. They follow from the prefix of its
/// topics, from the ports of its source, and from the source's name if it has no image.
fn has_same_cameras(recording: &Recording, stage: RunId, target: &CopyTarget<'_>) -> bool {
    let run = &recording.plan().runs[stage];
    let source = &run.source;
    let ports = source.outputs.iter().map(|output| (output.port.as_str(), output.value_type()));
    run.prefix == target.layout.prefix
        && source.name == *target.layout.source_name
        && ports.eq(target.layout.source_ports.iter().map(|(name, value_type)| (name.as_str(), Some(*value_type))))
}

fn is_same_frame(recording: &Recording, stage: RunId, position: FrameIndex, target: &Frame) -> bool {
    let frame = &recording.frames(stage)[position];
    (&frame.id, frame.index, frame.time_ns) == (&target.id, target.index, target.time_ns)
}

/// Whether a channel has the same topic and schema in a recording as in the one that is written.
fn has_same_label(recording: &Recording, channels: &[ChannelLayout], id: u16) -> bool {
    let target = &channels[usize::from(id) - 1];
    let found = recording.index.channels.get(&id);
    found.is_some_and(|found| {
        found.written_topic == target.topic && recording.index.schema_of(found) == Some(target.schema.name())
    })
}

impl StoredBytes<'_> {
    /// Adds the value to a part: a chunk of its own as stored; messages of a shared chunk are added to the part's.
    pub(crate) fn copy(&self, key: &Key, part: &mut PartBuilder<'_>) -> Result<Result<(), Unkept>, RecordingError> {
        let file = &self.run.recording.file;
        if self.key != *key {
            let what = format!("the bytes of key {} were requested for key {key}", self.key);
            return Err(RecordingError::Content { path: file.path.clone(), what });
        }
        self.run.mark_reused();
        for CheckedChunk { channel, chunk, crc } in &self.chunks {
            if !self.shares {
                let length = chunk.end - chunk.start;
                match part.copied(*channel, *crc, |bytes| file.append_range(bytes, chunk.start, length))? {
                    Ok(()) => continue,
                    Err(what) => return Err(file.damaged(chunk.start, what).into()),
                }
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
