//! The recorded frames of a stage run as a source; its ports are topics.

use std::sync::Arc;

use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::{Context, Fault, Frame, Key, Outputs, Source, SourceOutputs};
use depthloom_recording::Recording;

/// The frames of a stage run with values, and for each the values of some topics.
pub(crate) struct RecordedFrames {
    recording: Arc<Recording>,
    run: RunId,
    topics: Vec<&'static str>,
    frames: Vec<Frame>,
    /// By frame, its position in the recorded stage.
    positions: Vec<FrameIndex>,
}

impl RecordedFrames {
    /// The frames of a stage run; empty if there are no topics to read.
    pub(crate) fn new(recording: Arc<Recording>, run: RunId, topics: Vec<&'static str>) -> Self {
        let every = usize::try_from(recording.plan().every).unwrap_or(usize::MAX).max(1);
        let all = if topics.is_empty() { 0 } else { recording.frames(run).len() };
        // On the frames between, only scores are recorded.
        let positions: Vec<FrameIndex> = FrameIndex::all(all).step_by(every).collect();
        let frames = positions.iter().map(|position| &recording.frames(run)[*position]);
        let frames = frames.map(|of| Frame { id: of.id.clone(), index: of.index, time_ns: of.time_ns }).collect();
        Self { recording, run, topics, frames, positions }
    }
}

impl Source for RecordedFrames {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        Ok(Key::build("recorded").number(self.run.0 as u64).number(self.positions[position].0 as u64).finish())
    }

    fn read(&self, position: FrameIndex, _: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let unreadable = |error: depthloom_recording::RecordingError| Fault::new(error.to_string());
        let mut reader = self.recording.reader(self.run, &self.topics).map_err(unreadable)?;
        let values = reader.read(self.positions[position]).map_err(unreadable)?;
        let present = self.topics.iter().zip(values).filter_map(|(topic, value)| Some((topic, value?)));
        let outputs = present.fold(Outputs::none(), |outputs, (topic, value)| outputs.with(topic, value));
        Ok(SourceOutputs { outputs, key: self.key(position)? })
    }
}
