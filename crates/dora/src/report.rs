//! What there is to say of a part besides its values: that it can begin, and of each frame and of its once-values what it did.

use std::collections::BTreeMap;

use depthloom_graphs::plan::{NodeId, NodeRef, RunId};
use depthloom_graphs::{Fault, Frame, Key};
use serde_json::{Value as Json, json};

use crate::mailbox::Arrived;

/// What a part did on a frame, or when it gave its once-values.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Report {
    /// Of a source, the key of what it read.
    pub key: Option<Key>,
    /// The ports that have no value.
    pub absent: Vec<String>,
    /// What it told of without failing, and of how many things.
    pub warnings: Vec<(String, u64)>,
    /// What it failed of, and what can be done about it.
    pub failed: Option<(String, Option<String>)>,
}

impl Report {
    /// That it failed.
    pub(crate) fn failed(fault: &Fault) -> Self {
        Self { failed: Some((fault.chain(), fault.remedy_text().map(str::to_owned))), ..Self::default() }
    }

    /// As a text.
    pub(crate) fn text(&self) -> String {
        let Self { key, absent, warnings, failed } = self;
        json!({ "key": key.map(|key| key.to_string()), "absent": absent, "warnings": warnings, "failed": failed })
            .to_string()
    }

    /// Reads one.
    pub(crate) fn read(arrived: &Arrived) -> Result<Self, Fault> {
        let json = arrived.json()?;
        let wrong = || Fault::new(format!("what came at `{}` is no report", arrived.input));
        let of = |name: &str| json.get(name).cloned().unwrap_or_default();
        let texts = |of: Json| serde_json::from_value(of).map_err(|_| wrong());
        Ok(Self {
            key: json.get("key").and_then(Json::as_str).and_then(Key::parse),
            absent: texts(of("absent"))?,
            warnings: serde_json::from_value(of("warnings")).map_err(|_| wrong())?,
            failed: serde_json::from_value(of("failed")).map_err(|_| wrong())?,
        })
    }
}

/// That a part can begin, or why not.
#[derive(Debug, Default)]
pub(crate) struct Readiness {
    /// The fingerprint of the engine that a node runs in, if that decides its results.
    pub fingerprint: Option<Key>,
    /// What a source has to say of its data.
    pub warnings: Vec<String>,
    /// What is missing where it would run, each with its remedy.
    pub missing: Vec<(String, Option<String>)>,
}

impl Readiness {
    /// As a text.
    pub(crate) fn text(&self) -> String {
        let Self { fingerprint, warnings, missing } = self;
        let fingerprint = fingerprint.map(|key| key.to_string());
        json!({ "fingerprint": fingerprint, "warnings": warnings, "missing": missing }).to_string()
    }

    /// Reads one.
    pub(crate) fn read(arrived: &Arrived) -> Result<Self, Fault> {
        let json = arrived.json()?;
        let wrong = |_| Fault::new(format!("what came at `{}` is no report", arrived.input));
        let of = |name: &str| json.get(name).cloned().unwrap_or_default();
        Ok(Self {
            fingerprint: json.get("fingerprint").and_then(Json::as_str).and_then(Key::parse),
            warnings: serde_json::from_value(of("warnings")).map_err(wrong)?,
            missing: serde_json::from_value(of("missing")).map_err(wrong)?,
        })
    }
}

/// Fingerprints by node.
pub(crate) type Engines = BTreeMap<NodeRef, Key>;

/// Fingerprints as a text.
pub(crate) fn engines_text(engines: &Engines) -> String {
    let listed: Vec<_> =
        engines.iter().map(|(NodeRef { run, node }, key)| json!([run, node, key.to_string()])).collect();
    json!(listed).to_string()
}

/// Reads them.
pub(crate) fn engines(arrived: &Arrived) -> Result<Engines, Fault> {
    let wrong = || Fault::new(format!("what came at `{}` is no list of engines", arrived.input));
    let listed: Vec<(RunId, NodeId, String)> = serde_json::from_value(arrived.json()?).map_err(|_| wrong())?;
    listed
        .into_iter()
        .map(|(run, node, key)| Ok((NodeRef { run, node }, Key::parse(&key).ok_or_else(wrong)?)))
        .collect()
}

/// The frames of a stage as a text.
pub(crate) fn frames_text(frames: &[Frame]) -> String {
    let frames: Vec<_> = frames.iter().map(|of| json!([&*of.id, of.index, of.time_ns])).collect();
    json!(frames).to_string()
}

/// Reads them.
pub(crate) fn frames(arrived: &Arrived) -> Result<Vec<Frame>, Fault> {
    let wrong = |_| Fault::new(format!("what came at `{}` is no list of frames", arrived.input));
    let listed: Vec<(String, u64, u64)> = serde_json::from_value(arrived.json()?).map_err(wrong)?;
    Ok(listed.into_iter().map(|(id, index, time_ns)| Frame { id: id.into(), index, time_ns }).collect())
}
