//! A recording as a store: values by key.

use std::collections::BTreeMap;
use std::sync::Arc;

use depthloom_graphs::contracts::{Fault, Store};
use depthloom_graphs::values::Artifact;
use depthloom_graphs::{Key, Value};

use crate::error::RecordingError;
use crate::plan::RecordedOutput;
use crate::recording::{RecordedContent, RecordedOnce, Recording};

/// What a key names: all values that a source or a node gave on a frame, or a once-value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum KeyedPlace {
    /// The values of a run's source (`node: None`) or node on a frame.
    Frame { run: usize, position: usize, node: Option<usize> },
    /// The once-values of a node, by the place of one of them among [`Recording::once_values`].
    Once(usize),
}

impl Recording {
    /// The values that a key names, by output port: all ports of a node share its key. Ports that were not recorded, or
    /// gave nothing, are left out; `None` if the recording does not know the key.
    ///
    /// # Errors
    /// If the recording cannot be read.
    pub fn values_of(&self, key: &Key) -> Result<Option<Vec<(&str, Value)>>, RecordingError> {
        let places = self.by_key.get_or_init(|| self.keyed_places());
        let (run, position, node) = match places.get(key) {
            None => return Ok(None),
            Some(KeyedPlace::Once(place)) => return self.once_values_of_node(*place).map(Some),
            Some(KeyedPlace::Frame { run, position, node }) => (*run, *position, *node),
        };
        let planned = &self.plan().runs[run];
        let outputs = match node {
            None => Some(&planned.source.outputs),
            Some(node) => planned.nodes.get(node).map(|node| &node.outputs),
        };
        let outputs: Vec<&RecordedOutput> =
            outputs.into_iter().flatten().filter(|output| output.recorded && !output.once).collect();
        let topics: Vec<&str> = outputs.iter().map(|output| output.topic.as_str()).collect();
        let values = self.reader(run, &topics)?.read(position)?;
        let named = outputs.iter().zip(values);
        Ok(Some(named.filter_map(|(output, value)| Some((output.port.as_str(), value?))).collect()))
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
                if once.value_type == "model" { Value::Model(artifact) } else { Value::Samples(artifact) }
            }
        })
    }

    /// The once-values of the node that gave the one at that place, by output port.
    fn once_values_of_node(&self, place: usize) -> Result<Vec<(&str, Value)>, RecordingError> {
        let RecordedOnce { run, node, .. } = self.once_values()[place];
        let planned = self.plan().runs[run].nodes.get(node);
        let port_of = |port: usize| match planned.and_then(|node| node.outputs.get(port)) {
            Some(output) => output.port.as_str(),
            None => "",
        };
        let of_node = self.once_values().iter().filter(|once| (once.run, once.node) == (run, node));
        of_node.map(|once| Ok((port_of(once.port), self.once_value(once)?))).collect()
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
        let once = self.once_values().iter().enumerate();
        places.extend(once.map(|(place, once)| (once.key, KeyedPlace::Once(place))));
        places
    }
}

impl Store for Recording {
    /// The value of a key that names exactly one; where a node has several output ports, ask [`Recording::values_of`].
    fn get(&self, key: &Key) -> Result<Option<Value>, Fault> {
        let values = self.values_of(key).map_err(|error| {
            let fault = Fault::new(error.to_string());
            match error.remedy() {
                Some(remedy) => fault.remedy(remedy).because(error),
                None => fault.because(error),
            }
        })?;
        match values.as_deref() {
            None | Some([]) => Ok(None),
            Some([(_, value)]) => Ok(Some(value.clone())),
            Some(several) => {
                let ports: Vec<&str> = several.iter().map(|(port, _)| *port).collect();
                Err(Fault::new(format!("key {key} names the values of several ports: {}", ports.join(", "))))
            }
        }
    }
}
