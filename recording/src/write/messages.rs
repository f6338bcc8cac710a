//! Encodes values as the messages of a recording, without a recording: for viewers of a live run.

use std::collections::BTreeMap;

use depthloom_graphs::contracts::{ErrorMessage, Slot};
use depthloom_graphs::plan::{FrameIndex, Plan, RunId};
use depthloom_graphs::{Frame, Value};

use crate::error::RecordingError;
use crate::write::compression::put_port_value;
use crate::write::layout::FileLayout;
use crate::write::part::{Messages, Packing, Unkept};
use crate::write::part_encoder::refusal;
use crate::write::viewer::at_the_time_shown;

/// A channel of a recording.
#[derive(Clone, Debug)]
pub struct MessageChannel<'a> {
    /// Its topic.
    pub topic: &'a str,
    /// The full name of its protobuf message.
    pub schema_name: &'static str,
    /// The serialized `FileDescriptorSet` of the message.
    pub schema: &'static [u8],
    /// What is known of it, by name.
    pub metadata: &'a BTreeMap<String, String>,
}

/// Encodes the values of a plan's frames as messages: the same that a [`Recorder`](crate::Recorder) stores.
pub struct MessageEncoder(FileLayout);

impl MessageEncoder {
    /// The messages of a plan.
    ///
    /// # Errors
    /// If the plan cannot be recorded.
    pub fn new(plan: &Plan) -> Result<Self, RecordingError> {
        FileLayout::new(plan).map(Self)
    }

    /// The channels, whose ids count from 1. Two channels have the same topic if the schema depends on the values.
    pub fn channels(&self) -> impl Iterator<Item = (u16, MessageChannel<'_>)> {
        (1..).zip(self.0.channels.iter().map(|channel| MessageChannel {
            topic: &channel.topic,
            schema_name: channel.schema.name(),
            schema: channel.schema.descriptor_set(),
            metadata: &channel.metadata,
        }))
    }

    /// How many parts a frame of a stage run has at most.
    ///
    /// # Panics
    /// If the plan has no such stage run.
    #[must_use]
    pub fn parts(&self, run: RunId) -> usize {
        self.0.runs[run].parts
    }

    /// The topic of a slot's values in the plan; `None` if they are not recorded with frames.
    ///
    /// # Panics
    /// If the plan has no such stage run.
    #[must_use]
    pub fn topic(&self, run: RunId, slot: Slot) -> Option<&str> {
        Some(&self.0.runs[run].port(slot)?.topic)
    }

    /// The channels of the messages that a slot's values become. Empty if the values are not recorded with frames.
    ///
    /// # Panics
    /// If the plan has no such stage run.
    #[must_use]
    pub fn slot_channels(&self, run: RunId, slot: Slot) -> Vec<u16> {
        let Some(port) = self.0.runs[run].port(slot) else { return Vec::new() };
        let companions = port.companions.iter().map(|companion| companion.channel);
        std::iter::once(port.channel).chain(port.other_channel).chain(companions).collect()
    }

    /// The other slots whose values the messages of a slot are computed from: calibration and image, for points.
    ///
    /// # Panics
    /// If the plan has no such stage run.
    #[must_use]
    pub fn inputs(&self, run: RunId, slot: Slot) -> Vec<Slot> {
        self.0.runs[run].port(slot).map_or_else(Vec::new, |port| port.needed().collect())
    }

    /// Encodes a value of a frame. `others` are the values of [`MessageEncoder::inputs`]. Messages of channels that are
    /// not wanted are not made. `put` takes the channel, the time in nanoseconds, and the message.
    ///
    /// # Errors
    /// If the value cannot be recorded.
    ///
    /// # Panics
    /// If the plan has no such stage run.
    pub fn encode(
        &self,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        (slot, value): (Slot, &Value),
        others: &[(Slot, Value)],
        is_wanted: impl Fn(u16) -> bool,
        put: impl FnMut(u16, u64, &[u8]),
    ) -> Result<(), ErrorMessage> {
        let Some(port) = self.0.runs[run].port(slot) else { return Ok(()) };
        if let Some(what) = refusal(value) {
            return Err(ErrorMessage::new(format!("frame {}, topic {}: {what}", frame.id, port.topic)));
        }
        let frame = &at_the_time_shown(position, frame);
        let mut messages = EachMessage { time_ns: frame.time_ns, buffer: Vec::new(), put };
        let mut encode_all = || {
            if is_wanted(port.channel) || port.other_channel.is_some_and(&is_wanted) {
                put_port_value(&mut messages, frame, port, value)?;
            }
            let mut companions = port.companions.iter().filter(|companion| is_wanted(companion.channel));
            companions.try_for_each(|companion| companion.put(&mut messages, frame, value, others))
        };
        encode_all().map_err(|error| match error {
            Unkept::TooLarge { bytes, .. } => ErrorMessage::new(format!("a message of {bytes} bytes is too large")),
            Unkept::Compression(error) => ErrorMessage::new("failed to compress a map").because(error),
        })
    }
}

/// Passes each message on.
struct EachMessage<F> {
    time_ns: u64,
    buffer: Vec<u8>,
    put: F,
}

impl<F: FnMut(u16, u64, &[u8])> Messages for EachMessage<F> {
    fn small(&mut self, channel: u16, data: &[u8]) -> Result<(), Unkept> {
        (self.put)(channel, self.time_ns, data);
        Ok(())
    }

    fn alone(
        &mut self,
        channel: u16,
        _packing: Packing,
        size: usize,
        data: impl FnOnce(&mut Vec<u8>),
    ) -> Result<(), Unkept> {
        self.buffer.clear();
        self.buffer.reserve(size);
        data(&mut self.buffer);
        (self.put)(channel, self.time_ns, &self.buffer);
        Ok(())
    }
}
