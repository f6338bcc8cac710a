//! The message that commits a frame of a recording.

use depthloom_graphs::Key;
use depthloom_graphs::contracts::{Commit, Drops, Failure, LiveCommit, NodeWarning, Slot, SlotKey};
use depthloom_graphs::plan::{NodeId, PortId};

/// `depthloom.Commit`: completes a frame. Everything between it and the previous commit belongs to the frame.
///
/// The CRC-32 is of all bytes of the file before the chunk of this record, so that an unfinished file is checked up to
/// it. A node that is neither under `keys` nor under `failures` did not run on the frame.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct CommitMessage {
    #[prost(uint32, tag = "1")]
    pub(crate) run: u32,
    #[prost(string, tag = "2")]
    pub(crate) frame: String,
    #[prost(uint64, tag = "3")]
    pub(crate) index: u64,
    #[prost(string, tag = "4")]
    pub(crate) source_key: String,
    #[prost(message, repeated, tag = "5")]
    pub(crate) keys: Vec<NodeKeyMessage>,
    #[prost(message, repeated, tag = "6")]
    pub(crate) failures: Vec<FailureMessage>,
    #[prost(fixed32, tag = "7")]
    pub(crate) crc32_before: u32,
    #[prost(message, repeated, tag = "8")]
    pub(crate) warnings: Vec<WarningMessage>,
    /// `None` in recordings that do not state it.
    #[prost(message, optional, tag = "9")]
    pub(crate) absent: Option<AbsentMessage>,
    /// Of a live run.
    #[prost(message, optional, tag = "10")]
    pub(crate) live: Option<LiveMessage>,
}

/// `depthloom.Live`: what a live run knows of a frame: the frames dropped since the previous one by cause, and the time
/// from its capture until all its values were there.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub(crate) struct LiveMessage {
    #[prost(uint64, tag = "1")]
    pub(crate) dropped_graph: u64,
    #[prost(uint64, tag = "2")]
    pub(crate) dropped_recording: u64,
    #[prost(uint64, tag = "3")]
    pub(crate) dropped_source: u64,
    #[prost(uint64, tag = "4")]
    pub(crate) latency_ns: u64,
}

/// `depthloom.Absent`: the output ports without a value although their node ran.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct AbsentMessage {
    #[prost(message, repeated, tag = "1")]
    pub(crate) ports: Vec<AbsentPortMessage>,
}

/// `depthloom.AbsentPort`: an output port; without `node`, of the source.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct AbsentPortMessage {
    #[prost(uint32, optional, tag = "1")]
    pub(crate) node: Option<u32>,
    #[prost(uint32, tag = "2")]
    pub(crate) port: u32,
}

/// `depthloom.Warning`: a warning of a node on a frame; without `node`, of the source.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct WarningMessage {
    #[prost(uint32, optional, tag = "1")]
    pub(crate) node: Option<u32>,
    #[prost(string, tag = "2")]
    pub(crate) what: String,
    /// The number of affected things; 0 if it cannot be counted.
    #[prost(uint64, tag = "3")]
    pub(crate) count: u64,
}

/// `depthloom.NodeKey`: the key that all values of a node share on a frame.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct NodeKeyMessage {
    #[prost(uint32, tag = "1")]
    pub(crate) node: u32,
    #[prost(string, tag = "2")]
    pub(crate) key: String,
}

/// `depthloom.Failure`: a node that failed on a frame; without `node`, the source.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct FailureMessage {
    #[prost(uint32, optional, tag = "1")]
    pub(crate) node: Option<u32>,
    #[prost(string, tag = "2")]
    pub(crate) what: String,
}

impl CommitMessage {
    pub(crate) fn new(commit: &Commit<'_>, crc32_before: u32) -> Self {
        let keys = commit.keys.iter();
        let failures = commit.failures.iter();
        Self {
            run: commit.run.0 as u32,
            frame: commit.frame.id.to_string(),
            index: commit.frame.index,
            source_key: commit.source_key.map_or_else(String::new, |key| key.to_string()),
            keys: keys.map(|slot| NodeKeyMessage { node: slot.node.0 as u32, key: slot.key.to_string() }).collect(),
            failures: failures
                .map(|failure| FailureMessage {
                    node: failure.node.map(|node| node.0 as u32),
                    what: failure.what.clone(),
                })
                .collect(),
            crc32_before,
            absent: Some(AbsentMessage {
                ports: commit
                    .absent
                    .iter()
                    .map(|slot| match *slot {
                        Slot::Source { port } => AbsentPortMessage { node: None, port: port.0 as u32 },
                        Slot::Node { node, port } => {
                            AbsentPortMessage { node: Some(node.0 as u32), port: port.0 as u32 }
                        }
                    })
                    .collect(),
            }),
            warnings: commit
                .warnings
                .iter()
                .map(|warning| WarningMessage {
                    node: warning.node.map(|node| node.0 as u32),
                    what: warning.what.clone(),
                    count: warning.count,
                })
                .collect(),
            live: commit.live.map(|LiveCommit { drops, latency_ns }| LiveMessage {
                dropped_graph: drops.graph,
                dropped_recording: drops.recording,
                dropped_source: drops.source,
                latency_ns,
            }),
        }
    }

    pub(crate) fn live(&self) -> Option<LiveCommit> {
        self.live.map(|live| LiveCommit {
            drops: Drops { graph: live.dropped_graph, recording: live.dropped_recording, source: live.dropped_source },
            latency_ns: live.latency_ns,
        })
    }

    /// The outputs without a value although their source or node ran; `None` if the recording does not state it.
    pub(crate) fn absent(&self) -> Option<Vec<Slot>> {
        let slot = |absent: &AbsentPortMessage| {
            let port = PortId(absent.port as usize);
            absent.node.map_or(Slot::Source { port }, |node| Slot::Node { node: NodeId(node as usize), port })
        };
        Some(self.absent.as_ref()?.ports.iter().map(slot).collect())
    }

    pub(crate) fn warnings(&self) -> Vec<NodeWarning> {
        let warnings = self.warnings.iter();
        warnings
            .map(|warning| NodeWarning {
                node: warning.node.map(|node| NodeId(node as usize)),
                what: warning.what.clone(),
                count: warning.count,
            })
            .collect()
    }

    /// The key of the source's values, if the source succeeded; `None` if the text is not a key.
    pub(crate) fn source_key(&self) -> Option<Option<Key>> {
        if self.source_key.is_empty() { Some(None) } else { Key::parse(&self.source_key).map(Some) }
    }

    /// The keys of the nodes' values; `None` if one is not a key.
    pub(crate) fn keys(&self) -> Option<Vec<SlotKey>> {
        self.keys.iter().map(|of| Some(SlotKey { node: NodeId(of.node as usize), key: Key::parse(&of.key)? })).collect()
    }

    pub(crate) fn failures(&self) -> Vec<Failure> {
        let failures = self.failures.iter();
        failures
            .map(|failure| Failure { node: failure.node.map(|node| NodeId(node as usize)), what: failure.what.clone() })
            .collect()
    }
}
