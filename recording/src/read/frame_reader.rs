//! Reads the values of some topics, frame by frame.

use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::{Value, ValueType};
use depthloom_mcap::Message;

use crate::error::RecordingError;
use crate::read::chunk_messages::ChunkBuffers;
use crate::read::recording::{RecordedFrame, Recording};
use depthloom_codecs::decode::Gathered;
use depthloom_codecs::schema::Schema;

/// Reads the values of some topics of a stage run, frame by frame.
///
/// Chunks without any of the topics are neither read nor decompressed. The reader reuses its buffers; create one per
/// thread.
#[derive(Debug)]
pub struct FrameReader<'a> {
    recording: &'a Recording,
    run: RunId,
    types: Vec<ValueType>,
    /// Channel, its schema, and the index of its topic in the request.
    channels: Vec<(u16, Schema, usize)>,
    buffers: ChunkBuffers,
    next: FrameIndex,
}

/// A message as it is stored.
#[derive(Clone, Copy, Debug)]
pub struct StoredMessage<'a> {
    /// The topic in the file.
    pub topic: &'a str,
    /// The name of its schema.
    pub schema: &'a str,
    /// When it was recorded, nanoseconds.
    pub time_ns: u64,
    /// Its data.
    pub data: &'a [u8],
}

impl Recording {
    /// A reader of some of a stage run's topics; each topic may be an alias.
    ///
    /// # Errors
    /// If the run has no such topic, or did not record it.
    pub fn reader(&self, run: RunId, topics: &[impl AsRef<str>]) -> Result<FrameReader<'_>, RecordingError> {
        FrameReader::new(self, run, topics)
    }

    /// Passes all messages to `each`, in the order of the file.
    ///
    /// # Errors
    /// If the recording cannot be read, or `each` fails.
    pub fn each_message(
        &self,
        mut each: impl FnMut(StoredMessage<'_>) -> Result<(), String>,
    ) -> Result<(), RecordingError> {
        let mut buffers = ChunkBuffers::default();
        for chunk in &self.index.chunks {
            buffers.each_message(&self.file, chunk, |Message { channel, time_ns, data }| {
                let channel = self.index.channels.get(&channel).ok_or("a message is of an unknown channel")?;
                let schema = self.index.schema_of(channel).unwrap_or_default();
                each(StoredMessage { topic: &channel.written_topic, schema, time_ns, data })
            })?;
        }
        Ok(())
    }
}

impl<'a> FrameReader<'a> {
    fn new(recording: &'a Recording, run: RunId, topics: &[impl AsRef<str>]) -> Result<Self, RecordingError> {
        let plan = recording.plan();
        let Some(planned) = plan.runs.get(run.0) else {
            let (path, what) = (recording.path().to_owned(), format!("stage run {run}"));
            return Err(RecordingError::Missing { path, what });
        };
        let recorded = |topic: &str| {
            let (_, output) = plan.find(run, topic)?;
            let value_type = output.value_type()?;
            (output.recorded && !output.once).then_some((output.topic.as_str(), value_type))
        };
        let mut types = Vec::with_capacity(topics.len());
        let mut channels = Vec::new();
        for (position, topic) in topics.iter().enumerate() {
            let Some((topic, value_type)) = recorded(topic.as_ref()) else {
                let known = plan.outputs(run).filter(|(_, output)| output.recorded && !output.once);
                return Err(RecordingError::UnknownTopic {
                    path: recording.path().to_owned(),
                    prefix: planned.prefix.clone(),
                    topic: topic.as_ref().to_owned(),
                    known: known.map(|(_, output)| output.topic.clone()).collect(),
                });
            };
            types.push(value_type);
            for (id, channel) in recording.index.channels.iter().filter(|(_, channel)| channel.topic == topic) {
                let schema = recording.index.schema_of(channel).and_then(Schema::named);
                let what = || recording.file.damaged(0, format!("channel {id} is of an unknown schema"));
                channels.push((*id, schema.ok_or_else(what)?, position));
            }
        }
        Ok(Self { recording, run, types, channels, buffers: ChunkBuffers::default(), next: FrameIndex(0) })
    }

    /// The values of the frame at that position in [`Recording::frames`], one per topic, in the order in which the
    /// reader was created; `None` where the topic has no value on the frame.
    ///
    /// # Errors
    /// If there is no such frame, or its bytes are damaged.
    pub fn read(&mut self, position: FrameIndex) -> Result<Vec<Option<Value>>, RecordingError> {
        let recording = self.recording;
        let frame = recording.frames(self.run).get(position.0).ok_or_else(|| RecordingError::Missing {
            path: recording.path().to_owned(),
            what: format!("frame at position {position} of run {}", self.run),
        })?;
        let mut gathered: Vec<Gathered> = Vec::new();
        gathered.resize_with(self.types.len(), Gathered::default);
        for chunk in frame.chunks(&recording.index) {
            if !self.channels.iter().any(|(channel, ..)| chunk.channels.binary_search(channel).is_ok()) {
                continue;
            }
            let (channels, types) = (&self.channels, &self.types);
            let read = self.buffers.each_message(&recording.file, chunk, |message| {
                for (_, schema, topic) in channels.iter().filter(|(channel, ..)| *channel == message.channel) {
                    gathered[*topic].take(*schema, types[*topic], message.data)?;
                }
                Ok(())
            });
            let is_read = |id: u16| channels.iter().any(|(channel, ..)| *channel == id);
            read.map_err(|error| {
                RecordingError::from(error).with_content(&recording.frame_content(self.run, position, chunk, is_read))
            })?;
        }
        Ok(gathered.into_iter().map(Gathered::into_value).collect())
    }
}

impl<'a> Iterator for FrameReader<'a> {
    type Item = Result<(&'a RecordedFrame, Vec<Option<Value>>), RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = self.recording.frames(self.run).get(self.next.0)?;
        let values = self.read(self.next);
        self.next.0 += 1;
        Some(values.map(|values| (frame, values)))
    }
}
