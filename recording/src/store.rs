//! A recording as a store: values by key.

use std::collections::BTreeMap;
use std::sync::Arc;

use depthloom_graphs::contracts::{Fault, Store, Stored};
use depthloom_graphs::values::Artifact;
use depthloom_graphs::{Key, Value, ValueType};

use crate::condition::Condition;
use crate::error::RecordingError;
use crate::plan::RecordedOutput;
use crate::recording::{RecordedContent, RecordedOnce, Recording};

/// What a key names: all values that a source or a node gave on a frame, or a once-value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum KeyedPlace {
    /// The values of a run's source (`node: None`) or node on a frame.
    Frame { run: usize, position: usize, node: Option<usize> },
    /// The once-values of a node.
    Once { run: usize, node: usize },
}

impl Recording {
    /// What the recording has of the values that a key names, by output port: all ports of a node share its key. `None` if it does not
    /// know the key. See [`Store::get`].
    ///
    /// # Errors
    /// If the recording cannot be read.
    pub fn values_of(&self, key: &Key) -> Result<Option<Vec<Stored>>, RecordingError> {
        let places = self.by_key.get_or_init(|| self.keyed_places());
        match places.get(key) {
            None => Ok(None),
            Some(KeyedPlace::Once { run, node }) => self.once_values_of(*run, *node).map(Some),
            Some(KeyedPlace::Frame { run, position, node }) => self.frame_values_of(*run, *position, *node).map(Some),
        }
    }

    fn frame_values_of(&self, run: usize, position: usize, node: Option<usize>) -> Result<Vec<Stored>, RecordingError> {
        // Of the frames between, only scores are kept.
        let is_whole = (position as u64).is_multiple_of(self.plan().every.max(1));
        let is_kept = |output: &&RecordedOutput| is_whole || output.value_type() == Some(ValueType::Scores);
        let outputs = self.outputs_of(run, node).filter(|output| output.recorded && !output.once).filter(is_kept);
        let outputs: Vec<&RecordedOutput> = outputs.collect();
        let topics: Vec<&str> = outputs.iter().map(|output| output.topic.as_str()).collect();
        let values = self.reader(run, &topics)?.read(position)?;
        let stored = |(output, value): (&&RecordedOutput, _)| Stored { port: output.port.clone(), value };
        Ok(outputs.iter().zip(values).map(stored).collect())
    }

    fn once_values_of(&self, run: usize, node: usize) -> Result<Vec<Stored>, RecordingError> {
        let mut stored = Vec::new();
        for (port, output) in self.outputs_of(run, Some(node)).enumerate() {
            let once = self.once_values().iter().find(|once| (once.run, once.node, once.port) == (run, node, port));
            let value = once.map(|once| self.once_value(once)).transpose()?;
            // Of a node's once-values each has a record of its own: one that is not there may have been cut off.
            let is_known = value.is_some() || *self.condition() == Condition::Whole;
            if output.recorded && output.once && is_known {
                stored.push(Stored { port: output.port.clone(), value });
            }
        }
        Ok(stored)
    }

    /// The planned outputs of a source (`None`) or node.
    fn outputs_of(&self, run: usize, node: Option<usize>) -> impl Iterator<Item = &RecordedOutput> {
        let planned = &self.plan().runs[run];
        let outputs = match node {
            None => Some(&planned.source.outputs),
            Some(node) => planned.nodes.get(node).map(|node| &node.outputs),
        };
        outputs.into_iter().flatten()
    }

    /// Reads a once-value.
    ///
    /// # Errors
    /// If the recording cannot be read.
    pub fn once_value(&self, once: &RecordedOnce) -> Result<Value, RecordingError> {
        Ok(match &once.content {
            RecordedContent::Messages { topic, count } => self.curve(topic, *count)?.into(),
            RecordedContent::Attachment { media_type, name, hash } => {
                let artifact = Arc::new(Artifact::new(media_type.clone(), self.attachment(name)?));
                if artifact.hash != *hash {
                    let what = format!("attachment `{name}` is another than the one of its once-value");
                    return Err(RecordingError::Content { path: self.path().to_owned(), what });
                }
                match ValueType::from_name(&once.value_type) {
                    Some(ValueType::Model) => Value::Model(artifact),
                    _ => Value::Samples(artifact),
                }
            }
        })
    }

    fn keyed_places(&self) -> BTreeMap<Key, KeyedPlace> {
        let mut places = BTreeMap::new();
        for run in 0..self.plan().runs.len() {
            for (position, frame) in self.frames(run).iter().enumerate() {
                let of_nodes = frame.keys.iter().map(|of| (of.key, Some(of.node)));
                let of_source = frame.source_key.map(|key| (key, None));
                for (key, node) in of_source.into_iter().chain(of_nodes) {
                    places.entry(key).or_insert(KeyedPlace::Frame { run, position, node });
                }
            }
        }
        let once = self.once_values().iter();
        places.extend(once.map(|once| (once.key, KeyedPlace::Once { run: once.run, node: once.node })));
        places
    }
}

impl Store for Recording {
    fn get(&self, key: &Key) -> Result<Option<Vec<Stored>>, Fault> {
        self.values_of(key).map_err(|error| {
            let fault = Fault::new(error.to_string());
            match error.remedy() {
                Some(remedy) => fault.remedy(remedy).because(error),
                None => fault.because(error),
            }
        })
    }
}
