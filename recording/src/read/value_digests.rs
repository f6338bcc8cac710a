//! Digests of the stored values of a topic. A later run uses them as keys of what it computes from these values.

use depthloom_graphs::Key;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{FrameIndex, RunId};

use crate::error::RecordingError;
use crate::read::index::ChunkEntry;
use crate::read::recording::{RecordedFrame, Recording};

impl Recording {
    /// A digest of a topic's value on each of a stage run's [frames](Recording::frames): of the cache key that it is
    /// stored under, and of size and checksum of its chunk. `None` where the topic has no value, or shares a chunk with
    /// other topics.
    ///
    /// Only the headers of chunks are read. A reader of a value compares its bytes with the checksum.
    ///
    /// # Errors
    /// If the run has no such topic, or the file cannot be read.
    pub fn value_digests(&self, run: RunId, topic: &str) -> Result<Vec<Option<Key>>, RecordingError> {
        let found = (run.0 < self.plan().runs.len()).then(|| self.plan().find(run, topic)).flatten();
        let (slot, output) = found.ok_or_else(|| RecordingError::Missing {
            path: self.path().to_owned(),
            what: format!("topic {topic} of stage run {run}"),
        })?;
        let channels: Vec<u16> = self.channels_of(&output.topic).collect();
        let digest = |(position, frame): (FrameIndex, &RecordedFrame)| {
            let chunk = channels.iter().find_map(|channel| Some((*channel, self.chunk_of(run, position, *channel)?)));
            let own_chunk = chunk.filter(|(channel, chunk)| *chunk.channels == [*channel]);
            match (own_chunk, frame.key_of(slot)) {
                (Some((_, chunk)), Some(key)) => self.chunk_digest(chunk, &key),
                _ => Ok(None),
            }
        };
        FrameIndex::enumerate(self.frames(run)).map(digest).collect()
    }

    fn chunk_digest(&self, chunk: &ChunkEntry, key: &Key) -> Result<Option<Key>, RecordingError> {
        // In MCAP, a checksum of 0 stands for a missing one.
        let header = chunk.header(&self.file)?.filter(|header| header.uncompressed_crc != 0);
        Ok(header.map(|header| {
            let digest = Key::digest("depthloom value").key(key).number(header.uncompressed_size);
            digest.number(u64::from(header.uncompressed_crc)).finish()
        }))
    }
}

impl RecordedFrame {
    /// The cache key of the values of a source or a node on the frame.
    fn key_of(&self, slot: Slot) -> Option<Key> {
        match slot {
            Slot::Source { .. } => self.source_key,
            Slot::Node { node, .. } => self.keys.iter().find(|of| of.node == node).map(|of| of.key),
        }
    }
}
