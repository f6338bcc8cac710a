//! The sizes of a recording's topics, without decompressing a value: from the message indexes after every chunk.

use std::collections::BTreeMap;

use depthloom_mcap::records::MessageIndex;
use depthloom_mcap::{Records, op, read_all};

use crate::error::RecordingError;
use crate::read::index::ChunkEntry;
use crate::read::recording::Recording;

/// A topic of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicSize {
    /// Its name.
    pub topic: String,
    /// The schema of its messages; for images with two schemas, the one that is used.
    pub schema: String,
    /// The number of messages.
    pub messages: u64,
    /// Their size without compression, bytes.
    pub raw_bytes: u64,
    /// Their size in the file. The size of a chunk with several topics is divided in proportion to their raw bytes.
    pub stored_bytes: u64,
}

impl Recording {
    /// The size of the file, bytes.
    #[must_use]
    pub const fn file_bytes(&self) -> u64 {
        self.file.size
    }

    /// The topics with messages, by name. Other content of the file (attachments, indexes, schemas) is not included.
    ///
    /// Ends early if `stop` returns true, which is called once per chunk.
    ///
    /// # Errors
    /// If the file cannot be read, or an index of messages is damaged. Message indexes have no checksum, so the counts
    /// are compared with those in the summary.
    pub fn topic_sizes(&self, stop: &(dyn Fn() -> bool + Sync)) -> Result<Vec<TopicSize>, RecordingError> {
        let mut by_channel: BTreeMap<u16, RawSizes> = BTreeMap::new();
        let mut bytes = Vec::new();
        for chunk in self.index.chunks.iter().take_while(|_| !stop()) {
            self.add_chunk(chunk, &mut bytes, &mut by_channel)?;
        }
        let counts = by_channel.iter().map(|(channel, sizes)| (*channel, sizes.messages));
        if !self.index.message_counts.is_empty() && !stop() && !counts.eq(self.index.message_counts.clone()) {
            let damage = self.damage(stop);
            let offset = damage.first().map_or(0, |damage| damage.offset);
            return Err(self.file.damaged(offset, "the message indexes contradict the counts in the summary").into());
        }
        let mut topics: BTreeMap<&str, TopicSize> = BTreeMap::new();
        for (channel, sizes) in by_channel {
            let Some(entry) = self.index.channels.get(&channel) else { continue };
            let topic = topics.entry(&entry.topic).or_insert_with(|| TopicSize {
                topic: entry.topic.clone(),
                schema: self.index.schema_of(entry).unwrap_or_default().to_owned(),
                messages: 0,
                raw_bytes: 0,
                stored_bytes: 0,
            });
            topic.messages += sizes.messages;
            topic.raw_bytes += sizes.raw;
            topic.stored_bytes += sizes.stored;
        }
        Ok(topics.into_values().collect())
    }

    fn add_chunk(
        &self,
        chunk: &ChunkEntry,
        bytes: &mut Vec<u8>,
        by_channel: &mut BTreeMap<u16, RawSizes>,
    ) -> Result<(), RecordingError> {
        let damaged = || self.file.damaged(chunk.start, "a chunk and its message indexes contradict each other");
        let header = chunk.header(&self.file)?.ok_or_else(damaged)?;
        let (raw, stored) = (header.uncompressed_size, header.compressed_size.min(chunk.length));
        let indexes = chunk.start + chunk.length;
        self.file.read_range(bytes, indexes, chunk.end.saturating_sub(indexes))?;
        let mut messages: Vec<(u64, u16)> = Vec::new();
        for record in Records::new(bytes) {
            let Ok((_, op::MESSAGE_INDEX, body)) = record else { return Err(damaged().into()) };
            let MessageIndex { channel_id, records } = read_all(body).ok_or_else(damaged)?;
            messages.extend(records.iter().map(|entry| (entry.offset, channel_id)));
        }
        if let ([], [channel]) = (messages.as_slice(), &*chunk.channels) {
            // A commit whose message index was cut off is complete without it.
            messages.push((0, *channel));
        }
        messages.sort_unstable();
        let ends = messages.iter().skip(1).map(|(offset, _)| *offset).chain([raw]);
        let share = |to: u64| (u128::from(stored) * u128::from(to) / u128::from(raw.max(1))) as u64;
        for (&(from, channel), to) in messages.iter().zip(ends) {
            if from > to || to > raw {
                return Err(damaged().into());
            }
            let sizes = by_channel.entry(channel).or_default();
            sizes.messages += 1;
            sizes.raw += to - from;
            sizes.stored += share(to) - share(from);
        }
        Ok(())
    }
}

#[derive(Default)]
struct RawSizes {
    messages: u64,
    raw: u64,
    stored: u64,
}
