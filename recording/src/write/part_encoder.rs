//! Encodes the parts of frames: the workers' half of a recording, which needs no file.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use depthloom_codecs::decode::nothing_found;
use depthloom_graphs::contracts::{Commit, ErrorMessage, Slot, Store, StoredValue, stored_values};
use depthloom_graphs::plan::{FrameIndex, PartId, RunId};
use depthloom_graphs::{Frame, Key, Value};
use prost::Message;

use crate::LARGEST_CHUNK;
use crate::commit_message::CommitMessage;
use crate::error::RecordingError;
use crate::reuse::earlier_runs::EarlierRuns;
use crate::reuse::stored_bytes::{CopyTarget, StoredBytes};
use crate::write::buffer_pool::PartPools;
use crate::write::compression::put_port_value;
use crate::write::layout::{Class, FileLayout, PortLayout, RunLayout};
use crate::write::part::{Messages as _, Part, PartBuilder, Unkept};
use crate::write::viewer::at_the_time_shown;

/// Encodes the parts of a plan's frames.
pub(crate) struct PartEncoder {
    /// The file or folder that the parts are for, which errors name.
    destination: PathBuf,
    pub(crate) layout: FileLayout,
    every: u64,
    /// By stage run and part; the commit records' pools come last.
    pools: Vec<Vec<PartPools>>,
    earlier: Option<Arc<EarlierRuns>>,
}

impl PartEncoder {
    pub(crate) fn new(destination: PathBuf, layout: FileLayout, every: u64) -> Self {
        let pools_of = |run: &RunLayout| (0..=run.parts).map(|_| PartPools::default()).collect();
        let pools = layout.runs.iter().map(pools_of).collect();
        Self { destination, layout, every: every.max(1), pools, earlier: None }
    }

    pub(crate) fn set_earlier(&mut self, earlier: Arc<EarlierRuns>) {
        self.earlier = Some(earlier).filter(|earlier| !earlier.is_empty());
    }

    pub(crate) fn store(&self) -> Option<&dyn Store> {
        self.earlier.as_deref().map(|earlier| earlier as &dyn Store)
    }

    /// Whether the values of a frame at that position are recorded.
    pub(crate) const fn has_values(&self, position: FrameIndex) -> bool {
        (position.0 as u64).is_multiple_of(self.every)
    }

    pub(crate) fn parts(&self, run: RunId) -> usize {
        self.layout.runs[run].parts
    }

    pub(crate) fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        Some(self.layout.runs[run].port(slot)?.part)
    }

    pub(crate) fn encode(
        &self,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Part, ErrorMessage> {
        let frame = &at_the_time_shown(position, frame);
        let mut builder = PartBuilder::new(frame, &self.pools[run][part]);
        for (slot, value) in values {
            self.add(&mut builder, run, (position, frame), (*slot, value), values)?;
        }
        Ok(builder.finish())
    }

    pub(crate) fn encode_stored(
        &self,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
        stored: &[StoredValue<'_>],
    ) -> Result<Part, ErrorMessage> {
        let frame = &at_the_time_shown(position, frame);
        let target = CopyTarget { layout: &self.layout.runs[run], channels: &self.layout.channels, frame, stored };
        let recorded = stored.iter().filter(|stored| self.keeps(run, stored.slot, position));
        let found = recorded
            .map(|stored| (stored, self.earlier.as_ref().and_then(|earlier| earlier.stored_bytes(&target, stored))));
        let (copied, others): (Vec<_>, Vec<_>) = found.partition(|(_, bytes)| bytes.is_some());
        let others = match &self.earlier {
            Some(earlier) => stored_values(earlier.as_ref(), others.into_iter().map(|(stored, _)| stored))?,
            None => Vec::new(),
        };
        // The inputs of points are needed as values, also if they are stored.
        let made = values.iter().chain(&others).filter_map(|(slot, _)| self.layout.runs[run].port(*slot));
        let needed: BTreeSet<Slot> = made.flat_map(PortLayout::needed).collect();
        let mut inputs: Vec<(Slot, Value)> =
            values.iter().chain(&others).filter(|(slot, _)| needed.contains(slot)).cloned().collect();
        if let Some(earlier) = &self.earlier {
            let missing = copied.iter().map(|(stored, _)| *stored).filter(|stored| needed.contains(&stored.slot));
            inputs.extend(stored_values(earlier.as_ref(), missing)?);
        }
        // In plan order, which is the order of slots.
        let mut all: Vec<(Slot, Content<'_>)> =
            values.iter().chain(&others).map(|(slot, value)| (*slot, Content::Value(value))).collect();
        all.extend(
            copied.into_iter().filter_map(|(stored, bytes)| Some((stored.slot, Content::Stored(stored.key, bytes?)))),
        );
        all.sort_by_key(|(slot, _)| *slot);
        let mut builder = PartBuilder::new(frame, &self.pools[run][part]);
        for (slot, content) in all {
            match content {
                Content::Value(value) => self.add(&mut builder, run, (position, frame), (slot, value), &inputs)?,
                Content::Stored(key, bytes) => {
                    bytes.copy(&key, &mut builder)?.map_err(|why| self.unkept(frame, why))?;
                }
            }
        }
        Ok(builder.finish())
    }

    pub(crate) fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        let port = self.layout.runs[run].port(slot);
        port.is_some_and(|port| self.has_values(position) || port.class == Class::Rows)
    }

    /// The part with the commit record of a frame; `crc32_before` is that of all bytes before it.
    pub(crate) fn commit_part(&self, commit: &Commit<'_>, frame: &Frame, crc32_before: u32) -> Part {
        let layout = &self.layout.runs[commit.run];
        let message = CommitMessage::new(commit, crc32_before).encode_to_vec();
        let mut closing = PartBuilder::new(frame, &self.pools[commit.run][layout.parts]);
        closing.small(layout.commit_channel, &message).expect("a commit record is small");
        closing.finish()
    }

    /// Takes the buffers of a frame's parts for later ones.
    pub(crate) fn recycle(&self, run: RunId, parts: Vec<Part>) {
        parts.into_iter().zip(&self.pools[run]).for_each(|(part, pools)| pools.bytes.put(part.bytes));
    }

    pub(crate) fn recycle_commit(&self, run: RunId, part: Part) {
        self.pools[run][self.layout.runs[run].parts].bytes.put(part.bytes);
    }

    /// Adds a value to a part, if it is recorded on this frame.
    fn add(
        &self,
        part: &mut PartBuilder<'_>,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        (slot, value): (Slot, &Value),
        others: &[(Slot, Value)],
    ) -> Result<(), ErrorMessage> {
        let Some(port) = self.layout.runs[run].port(slot) else { return Ok(()) };
        let refused = refusal(value);
        if let Some(what) = refused {
            let (frame, topic) = (frame.id.to_string(), port.topic.to_string());
            return Err(RecordingError::Value { frame, topic, what }.into());
        }
        if self.keeps(run, slot, position) {
            let put = put_port_value(part, frame, port, value);
            let put = put.and_then(|()| {
                port.companions.iter().try_for_each(|companion| companion.put(part, frame, value, others))
            });
            put.map_err(|why| self.unkept(frame, why))?;
        }
        Ok(())
    }

    fn unkept(&self, frame: &Frame, why: Unkept) -> ErrorMessage {
        match why {
            Unkept::TooLarge { channel, bytes } => {
                let topic = self.layout.channels[usize::from(channel) - 1].topic.clone();
                RecordingError::Value { frame: frame.id.to_string(), topic, what: too_large(bytes) }.into()
            }
            Unkept::Compression(error) => {
                let what = format!("failed to compress frame {} for {}", frame.id, self.destination.display());
                ErrorMessage::new(what).because(error)
            }
        }
    }
}

/// A value of a part: in memory, or as stored bytes of an earlier run.
enum Content<'a> {
    Value(&'a Value),
    Stored(Key, StoredBytes<'a>),
}

/// Why a value cannot be the message of a frame; `None` if it can.
pub(crate) fn refusal(value: &Value) -> Option<String> {
    match value {
        Value::Samples(_) | Value::Model(_) | Value::Reliability(_) | Value::Curve(_) => {
            Some(format!("a value of type {} came with a frame", value.value_type()))
        }
        Value::Disparity(disparity) if nothing_found(disparity.min_disparity_px).is_none() => {
            Some(format!("disparities from {} px on do not fit into 16 bits", disparity.min_disparity_px))
        }
        _ => None,
    }
}

pub(crate) fn too_large(bytes: u64) -> String {
    format!("{bytes} bytes are more than the {LARGEST_CHUNK} that a recording can store as one message")
}
