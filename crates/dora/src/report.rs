//! Messages about a part besides its values: whether it can start, and what it did on each frame. Their text is JSON.

use std::collections::BTreeMap;

use depthloom_graphs::plan::{NodeId, NodeRef, RunId};
use depthloom_graphs::{Fault, Frame, Key};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::mailbox::Arrived;

/// What a part did on a frame, or for its aggregate values.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Report {
    /// The key of a source's frame.
    pub key: Option<Key>,
    /// The ports without a value.
    pub absent: Vec<String>,
    /// Messages and counts.
    pub warnings: Vec<(String, u64)>,
    /// The failure and its remedy.
    pub failed: Option<(String, Option<String>)>,
}

impl Report {
    pub(crate) fn failed(fault: &Fault) -> Self {
        Self { failed: Some((fault.chain(), fault.remedy_text().map(str::to_owned))), ..Self::default() }
    }

    pub(crate) fn text(&self) -> String {
        json!(self).to_string()
    }
}

/// Whether a part can start.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Readiness {
    /// Of the engine, if it decides the results.
    pub fingerprint: Option<Key>,
    /// Of a source.
    pub warnings: Vec<String>,
    /// With remedies.
    pub missing: Vec<(String, Option<String>)>,
}

impl Readiness {
    pub(crate) fn text(&self) -> String {
        json!(self).to_string()
    }
}

/// Reads a [`Report`] or a [`Readiness`].
pub(crate) fn read<T: DeserializeOwned>(arrived: &Arrived) -> Result<T, Fault> {
    serde_json::from_value(arrived.json()?)
        .map_err(|error| Fault::new(format!("the message at `{}` is malformed", arrived.input)).because(error))
}

/// Fingerprints by node.
pub(crate) type Engines = BTreeMap<NodeRef, Key>;

pub(crate) fn engines_text(engines: &Engines) -> String {
    let listed: Vec<(RunId, NodeId, &Key)> = engines.iter().map(|(id, key)| (id.run, id.node, key)).collect();
    json!(listed).to_string()
}

pub(crate) fn engines(arrived: &Arrived) -> Result<Engines, Fault> {
    let listed: Vec<(RunId, NodeId, Key)> = read(arrived)?;
    Ok(listed.into_iter().map(|(run, node, key)| (NodeRef { run, node }, key)).collect())
}

pub(crate) fn frames_text(frames: &[Frame]) -> String {
    let listed: Vec<(&str, u64, u64)> = frames.iter().map(|frame| (&*frame.id, frame.index, frame.time_ns)).collect();
    json!(listed).to_string()
}

pub(crate) fn frames(arrived: &Arrived) -> Result<Vec<Frame>, Fault> {
    let listed: Vec<(String, u64, u64)> = read(arrived)?;
    Ok(listed.into_iter().map(|(id, index, time_ns)| Frame { id: id.into(), index, time_ns }).collect())
}
