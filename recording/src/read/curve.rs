//! Learning curves: messages of a separate topic, outside frames.
//!
//! The points of a curve are one chunk. The record `depthloom.once` after it states their number. If a crash cut the
//! file between the two, that record is missing and the points are ignored.

use depthloom_graphs::values::Curve;
use prost::Message;

use crate::error::RecordingError;
use crate::read::chunk_messages::ChunkBuffers;
use crate::read::damaged_content::DamagedContent;
use crate::read::index::ChunkEntry;
use crate::read::recording::Recording;
use crate::write::part::{Part, messages_outside_frames};
use depthloom_codecs::messages::CurvePointMessage;

/// The time between two steps as shown, nanoseconds: a training has no clock.
const STEP_NS: u64 = 1_000_000;

/// The points of a curve as messages: the first step is one millisecond after the stage's first frame.
pub(crate) fn points_part(channel: u16, first_frame_ns: u64, curve: &Curve) -> Part {
    let message = |point| CurvePointMessage::new(point).encode_to_vec();
    let time_ns = |step: u64| first_frame_ns.saturating_add(step.saturating_mul(STEP_NS));
    messages_outside_frames(channel, curve.points.iter().map(|point| (time_ns(point.step), message(point))))
}

impl Recording {
    /// Reads the learning curve of a topic, which has `count` points according to its record.
    pub(crate) fn curve(&self, topic: &str, count: u64) -> Result<Curve, RecordingError> {
        let of_topic = |chunk: &&ChunkEntry| {
            let [channel] = *chunk.channels else { return false };
            self.index.holds_points(chunk) && self.index.channels.get(&channel).is_some_and(|of| of.topic == topic)
        };
        let mut points = Vec::new();
        let mut buffers = ChunkBuffers::default();
        for chunk in self.index.chunks.iter().filter(of_topic) {
            buffers
                .each_message(&self.file, chunk, |message| {
                    let point = CurvePointMessage::decode(message.data);
                    let point =
                        point.map_err(|error| format!("a message is not a point of a learning curve: {error}"))?;
                    points.push(point.point().ok_or("a point of a learning curve has no loss or no learning rate")?);
                    Ok(())
                })
                .map_err(|error| RecordingError::from(error).with_content(&DamagedContent::Curve(topic.to_owned())))?;
        }
        if points.len() as u64 != count {
            let what = format!("the learning curve {topic} has {} of its {count} points", points.len());
            return Err(self.file.damaged(0, what).into());
        }
        Ok(Curve { points })
    }
}
