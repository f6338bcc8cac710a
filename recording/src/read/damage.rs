//! The damage of a recording: bytes that were changed after they were written.
//!
//! Reading checks what it reads. This module checks all other bytes: commits, metadata records and the end of the data
//! contain the CRC-32 of all bytes before them, and a chunk contains the CRC-32 of its content.

use std::collections::BTreeSet;

use crc32fast::Hasher;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_threads::{Budget, Tiles, core_count, in_order};

use crate::checksum::crc_of;
use crate::read::chunk_messages::ChunkBuffers;
use crate::read::damaged_content::DamagedContent;
use crate::read::index::{ChunkEntry, DATA_END};
use crate::read::recording::Recording;

/// A damaged part of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Where it starts.
    pub offset: u64,
    /// Its number of bytes; at least one of them is damaged.
    pub bytes: u64,
    /// What it contained.
    pub content: DamagedContent,
}

impl Recording {
    /// Checks every byte of a finished file. Returns all damage in the order of the file; what cannot be read is
    /// damaged, too.
    ///
    /// [`Recording::open`] checks every byte of a file that is unfinished or whose summary is damaged: then the result
    /// is empty. Works on all cores. Ends early if `stop` returns true, which is called before each chunk.
    #[must_use]
    pub fn damage(&self, stop: &(dyn Fn() -> bool + Sync)) -> Vec<Damage> {
        let Some(data_end) = self.index.data_end else { return Vec::new() };
        let of_metadata = self.index.metadata.iter().map(|metadata| (metadata.offset, metadata.crc_before));
        let mut sealed: Vec<(u64, u32)> = self.sealed.iter().copied().chain(of_metadata).chain([data_end]).collect();
        sealed.sort_unstable();
        let budget = Budget::new(core_count());
        let _own = budget.permit();
        let starts: Vec<u64> = std::iter::once(0).chain(sealed.iter().map(|(place, _)| *place)).collect();
        let sections = in_order(&budget, sealed.len(), |section| {
            (!stop()).then(|| crc_of(&self.file, starts[section]..starts[section + 1]))
        });
        let mut damage = Vec::new();
        let mut crc = Hasher::new();
        for ((section, from), (place, stated)) in sections.into_iter().zip(starts).zip(sealed) {
            let Some(section) = section else { break };
            let is_read = section.map(|section| crc.combine(&section)).is_ok();
            if !is_read || crc.clone().finalize() != stated {
                // The record of the end may itself be damaged.
                let to = if place == data_end.0 { place + DATA_END } else { place };
                self.find_damage(from, to, &mut damage);
                crc = Hasher::new_with_initial(stated);
            }
        }
        self.find_damaged_chunks(&budget, stop, &mut damage);
        damage
    }

    /// Finds chunks whose content is damaged although their stored bytes have the right checksum: the damage happened
    /// before they were copied here.
    fn find_damaged_chunks(&self, tiles: &dyn Tiles, stop: &(dyn Fn() -> bool + Sync), damage: &mut Vec<Damage>) {
        /// Chunks that are read into the same buffers.
        const AT_ONCE: usize = 16;
        let known: BTreeSet<u64> = damage.iter().map(|damage| damage.offset).collect();
        let chunks = &self.index.chunks;
        let found = in_order(tiles, chunks.len().div_ceil(AT_ONCE), |tile| {
            let mut buffers = ChunkBuffers::default();
            let mut is_damaged = |chunk: &ChunkEntry| {
                !stop() && !known.contains(&chunk.start) && buffers.each_message(&self.file, chunk, |_| Ok(())).is_err()
            };
            let places = AT_ONCE * tile..chunks.len().min(AT_ONCE * (tile + 1));
            places.filter(|place| is_damaged(&chunks[*place])).collect::<Vec<usize>>()
        });
        damage.extend(found.into_iter().flatten().map(|place| self.damaged_chunk(place)));
        damage.sort_by_key(|damage| damage.offset);
    }

    /// Adds the damage between two offsets; at least one byte there is damaged.
    fn find_damage(&self, from: u64, to: u64, damage: &mut Vec<Damage>) {
        let found = damage.len();
        let mut buffers = ChunkBuffers::default();
        for (place, chunk) in self.index.chunks.iter().enumerate() {
            if (from..to).contains(&chunk.start) && buffers.each_message(&self.file, chunk, |_| Ok(())).is_err() {
                damage.push(self.damaged_chunk(place));
            }
        }
        for attachment in &self.index.attachments {
            if (from..to).contains(&attachment.offset) && attachment.read(&self.file).is_err() {
                let content = DamagedContent::Attachment(attachment.name.clone());
                damage.push(Damage { offset: attachment.offset, bytes: attachment.length, content });
            }
        }
        if damage.len() == found {
            damage.push(Damage { offset: from, bytes: to - from, content: DamagedContent::NoValue });
        }
        damage[found..].sort_by_key(|damage| damage.offset);
    }

    /// A damaged chunk, by its index among the chunks.
    fn damaged_chunk(&self, place: usize) -> Damage {
        let chunk = &self.index.chunks[place];
        Damage { offset: chunk.start, bytes: chunk.length, content: self.damaged_content(place, chunk) }
    }

    /// The content of a chunk, by its index among the chunks.
    fn damaged_content(&self, place: usize, chunk: &ChunkEntry) -> DamagedContent {
        for run in RunId::all(self.plan().runs.len()) {
            if let Some(position) = self.frames(run).iter().position(|frame| frame.chunks.contains(&place)) {
                return self.frame_content(run, FrameIndex(position), chunk, |_| true);
            }
        }
        match self.topics(chunk, |_| true).pop() {
            Some(topic) if self.index.holds_points(chunk) => DamagedContent::Curve(topic),
            _ => DamagedContent::NoValue,
        }
    }

    /// The content of a chunk of a frame, limited to some channels.
    pub(crate) fn frame_content(
        &self,
        run: RunId,
        position: FrameIndex,
        chunk: &ChunkEntry,
        is_one: impl Fn(u16) -> bool,
    ) -> DamagedContent {
        DamagedContent::Frame {
            stage: self.plan().runs[run].name().to_owned(),
            position,
            id: self.frames(run)[position].id.clone(),
            topics: self.topics(chunk, is_one),
        }
    }

    fn topics(&self, chunk: &ChunkEntry, is_one: impl Fn(u16) -> bool) -> Vec<String> {
        let channels = chunk.channels.iter().filter(|channel| is_one(**channel));
        let topics = channels.filter_map(|channel| Some(self.index.channels.get(channel)?.topic.clone()));
        let mut topics: Vec<String> = topics.collect();
        // The topic of an image has two channels.
        topics.dedup();
        topics
    }
}
