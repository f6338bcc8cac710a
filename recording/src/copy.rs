//! Chunks taken over from another recording as the bytes they are.

use std::collections::BTreeMap;

use crc32fast::Hasher;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::{Frame, Key};
use mcap::records::op;

use crate::chunk::Part;
use crate::earlier::{EarlierRun, EarlierRuns};
use crate::error::RecordingError;
use crate::layout::{ChannelLayout, PortLayout, RunLayout};
use crate::parse::{self, RECORD_HEADER, Records};
use crate::record::ChunkPlace;
use crate::recording::{RecordedFrame, Recording};
use crate::store::KeyedPlace;

/// What a part of a frame is to be.
pub(crate) struct Wanted<'a> {
    pub(crate) layout: &'a RunLayout,
    /// All channels of the recording that is written; a channel's id is its index plus one.
    pub(crate) channels: &'a [ChannelLayout],
    pub(crate) frame: &'a Frame,
    /// The values, all there are, with the keys of what made them.
    pub(crate) values: Vec<(Slot, Key)>,
}

impl EarlierRuns {
    /// A part of a frame, if one recording has all its values of the same frame in chunks of their own, under the same channels: then
    /// its bytes are those that encoding the values would give. `bytes` is where they are put.
    pub(crate) fn copied(&self, wanted: &Wanted<'_>, bytes: &mut Vec<u8>) -> Result<Option<Part>, RecordingError> {
        let Some((run, frame)) = self.frame_of(wanted) else { return Ok(None) };
        let ports: Option<Vec<&PortLayout>> = wanted.values.iter().map(|(slot, _)| wanted.layout.port(*slot)).collect();
        let Some(ports) = ports else { return Ok(None) };
        let recording = &run.recording;
        // What a port's messages may be, in the order in which they are written.
        let of_port = |port: &PortLayout| [Some(port.channel), port.compressed_channel, port.view_channel];
        let own: BTreeMap<u16, usize> = ports
            .iter()
            .enumerate()
            .flat_map(|(index, port)| of_port(port).into_iter().flatten().map(move |channel| (channel, index)))
            .collect();
        let chunks = frame.chunks(&recording.index);
        let chunks: Vec<_> =
            chunks.iter().filter(|chunk| chunk.channels.iter().any(|channel| own.contains_key(channel))).collect();
        let mut found: Vec<u16> = chunks.iter().flat_map(|chunk| chunk.channels.iter().copied()).collect();
        found.sort_unstable();
        let is_own = |channel: &u16| own.contains_key(channel) && is_same(recording, wanted.channels, *channel);
        if !found.iter().all(is_own) || found.windows(2).any(|pair| pair[0] == pair[1]) {
            return Ok(None);
        }
        let has = |channel: u16| found.binary_search(&channel).is_ok();
        let mut messages = Vec::with_capacity(found.len());
        for port in &ports {
            let value = match (has(port.channel), port.compressed_channel.filter(|channel| has(*channel))) {
                (true, None) => port.channel,
                (false, Some(compressed)) => compressed,
                _ => return Ok(None),
            };
            messages.push(value);
            if let Some(view) = port.view_channel {
                if !has(view) {
                    return Ok(None);
                }
                messages.push(view);
            }
        }
        bytes.clear();
        let mut places = Vec::with_capacity(chunks.len());
        let mut stored = Vec::new();
        for chunk in chunks {
            recording.file.read_range(&mut stored, chunk.start, chunk.end - chunk.start)?;
            let contradicts = || recording.file.damaged(chunk.start, "a chunk and its indexes contradict each other");
            let (place, counts) = placed(&stored, bytes.len() as u64).ok_or_else(contradicts)?;
            if counts.iter().any(|(_, count)| *count != 1) {
                return Ok(None);
            }
            places.push(place);
            bytes.extend_from_slice(&stored);
        }
        let mut crc = Hasher::new();
        crc.update(bytes);
        run.take();
        Ok(Some(Part { bytes: std::mem::take(bytes), crc, chunks: places, messages, compress_ns: 0 }))
    }

    /// The one frame of one recording that has all the values, if there is one, and it is the same to viewers.
    fn frame_of(&self, wanted: &Wanted<'_>) -> Option<(&EarlierRun, &RecordedFrame)> {
        let mut of_all = None;
        for (slot, key) in &wanted.values {
            // A topic ends with the port's name.
            let port = wanted.layout.port(*slot)?.topic.rsplit('/').next()?;
            let (run, place) = self.locate(key, port)?;
            let KeyedPlace::Frame { run: stage, position, .. } = place else { return None };
            let (first, at) = *of_all.get_or_insert((run, (stage, position)));
            if !std::ptr::eq(first, run) || at != (stage, position) {
                return None;
            }
        }
        let (run, (stage, position)) = of_all?;
        let outputs = &run.recording.plan().runs[stage].source.outputs;
        let ports = outputs.iter().map(|output| (output.port.clone(), output.value_type()));
        // The frame ids of messages follow from the source's ports.
        let has_same_cameras = ports.eq(wanted.layout.source_ports.iter().map(|(name, of)| (name.clone(), Some(*of))));
        let frame = &run.recording.frames(stage)[position];
        let is_same_frame =
            (&frame.id, frame.index, frame.time_ns) == (&wanted.frame.id, wanted.frame.index, wanted.frame.time_ns);
        (has_same_cameras && is_same_frame).then_some((run, frame))
    }
}

/// Whether a channel is in a recording what it is in the one that is written.
fn is_same(recording: &Recording, channels: &[ChannelLayout], id: u16) -> bool {
    let wanted = &channels[usize::from(id) - 1];
    let found = recording.index.channels.get(&id);
    found.is_some_and(|found| {
        found.topic == wanted.topic && recording.index.schema_of(found) == Some(wanted.schema.name())
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
