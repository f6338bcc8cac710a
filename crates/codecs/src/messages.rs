//! The messages that are depthloom's own: a row of scores, a point of a learning curve, and the record that commits a frame.

use depthloom_graphs::Key;
use depthloom_graphs::contracts::{Commit, Failure, Slot, SlotKey, Warned};
use depthloom_graphs::values::CurvePoint;
use depthloom_scores::{Metric, PixelSet, ScoreRow};

use crate::wire_format::{Content, Fields, put_bytes, put_number, put_varint};

/// `depthloom.Score`: one row of scores.
///
/// Fields `frame` 1, `set` 2, `pixels` 3, `zone` 12 (empty: the whole image), `truth` 13, `answered` 14, `log_mean` 15, and the
/// [catalogue](Metric)'s, as doubles whose absence can be told: a score that was not asked for, or of no pixel, is absent. Recordings of
/// before hold the first eight scores and none of 12 to 15.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoreMessage {
    /// The frame's id.
    pub frame: String,
    /// The row.
    pub row: ScoreRow,
}

/// `zone` of a `depthloom.Score`.
pub(crate) const ZONE: u32 = 12;
/// `truth` of a `depthloom.Score`.
pub(crate) const TRUTH: u32 = 13;
/// `answered` of a `depthloom.Score`.
pub(crate) const ANSWERED: u32 = 14;
/// `log_mean` of a `depthloom.Score`.
pub(crate) const LOG_MEAN: u32 = 15;

impl ScoreMessage {
    /// The message of a frame's row.
    #[must_use]
    pub fn encoded(frame: &str, row: &ScoreRow) -> Vec<u8> {
        let mut out = Vec::with_capacity(64 + 12 * row.scores.len());
        put_bytes(&mut out, 1, frame.as_bytes());
        put_bytes(&mut out, 2, row.set.name().as_bytes());
        put_number(&mut out, 3, row.pixels);
        put_bytes(&mut out, ZONE, row.zone.as_bytes());
        put_number(&mut out, TRUTH, row.truth);
        put_number(&mut out, ANSWERED, row.answered);
        let scores = row.scores.iter().map(|(metric, value)| (metric.field, *value));
        for (field, value) in row.log_mean.map(|mean| (LOG_MEAN, mean)).into_iter().chain(scores) {
            // Zero is written too: what is left out would come back as absent.
            put_varint(&mut out, u64::from(field) << 3 | 1);
            out.extend_from_slice(&value.to_le_bytes());
        }
        out
    }

    /// Reads a message.
    ///
    /// # Errors
    /// What is wrong with it, as a lower-case fragment.
    pub fn decode(message: &[u8]) -> Result<Self, String> {
        let malformed = |what: &dyn std::fmt::Display| format!("a message is no score: {what}");
        let text = |content: Content<'_>| {
            std::str::from_utf8(content.bytes()).map(str::to_owned).map_err(|error| malformed(&error))
        };
        let (mut frame, mut set) = (String::new(), String::new());
        let mut row = ScoreRow::new(PixelSet::All, "");
        for field in Fields(message) {
            match field.map_err(|error| malformed(&error))? {
                (1, content) => frame = text(content)?,
                (2, content) => set = text(content)?,
                (3, Content::Varint(count)) => row.pixels = count,
                (ZONE, content) => row.zone = text(content)?,
                (TRUTH, Content::Varint(count)) => row.truth = count,
                (ANSWERED, Content::Varint(count)) => row.answered = count,
                (LOG_MEAN, Content::Fixed64(bits)) => row.log_mean = Some(f64::from_bits(bits)),
                (field, Content::Fixed64(bits)) => {
                    if let Some(metric) = Metric::of_field(field) {
                        row = row.with(metric, f64::from_bits(bits));
                    }
                }
                _ => {}
            }
        }
        row.set = PixelSet::named(&set).ok_or_else(|| format!("a score is of the unknown pixel set `{set}`"))?;
        row.scores.sort_by_key(|(metric, _)| metric.place());
        row.scores.dedup_by_key(|(metric, _)| metric.name);
        Ok(Self { frame, row })
    }
}

/// `depthloom.CurvePoint`: one point of a learning curve.
///
/// Loss and learning rate are always there: the presence is declared because zero, which an undeclared field leaves out, would
/// come back without its sign.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct CurvePointMessage {
    /// Field `step`.
    #[prost(uint64, tag = "1")]
    pub step: u64,
    /// Field `loss`.
    #[prost(double, optional, tag = "2")]
    pub loss: Option<f64>,
    /// Field `validation`.
    #[prost(double, optional, tag = "3")]
    pub validation: Option<f64>,
    /// Field `learning_rate`.
    #[prost(double, optional, tag = "4")]
    pub learning_rate: Option<f64>,
}

impl CurvePointMessage {
    /// The message of a point.
    #[must_use]
    pub const fn new(point: &CurvePoint) -> Self {
        let CurvePoint { step, loss, validation, learning_rate } = *point;
        Self { step, loss: Some(loss), validation, learning_rate: Some(learning_rate) }
    }

    /// The point; `None` if it has no loss or no learning rate.
    #[must_use]
    pub fn point(&self) -> Option<CurvePoint> {
        let (loss, learning_rate) = (self.loss?, self.learning_rate?);
        Some(CurvePoint { step: self.step, loss, validation: self.validation, learning_rate })
    }
}

/// `depthloom.Commit`: closes a frame; what stands before it and after the last one belongs to the frame.
///
/// The CRC-32 is of all bytes of the file before the chunk that holds the record, so that a file that ends early is checked up to it.
/// A node that is neither under `keys` nor under `failures` did not fire on the frame.
#[derive(Clone, PartialEq, prost::Message)]
pub struct CommitMessage {
    /// Field `run`.
    #[prost(uint32, tag = "1")]
    pub run: u32,
    /// Field `frame`.
    #[prost(string, tag = "2")]
    pub frame: String,
    /// Field `index`.
    #[prost(uint64, tag = "3")]
    pub index: u64,
    /// Field `source_key`.
    #[prost(string, tag = "4")]
    pub source_key: String,
    /// Field `keys`.
    #[prost(message, repeated, tag = "5")]
    pub keys: Vec<NodeKeyMessage>,
    /// Field `failures`.
    #[prost(message, repeated, tag = "6")]
    pub failures: Vec<FailureMessage>,
    /// Field `crc32_before`.
    #[prost(fixed32, tag = "7")]
    pub crc32_before: u32,
    /// Field `warnings`.
    #[prost(message, repeated, tag = "8")]
    pub warnings: Vec<WarningMessage>,
    /// Field `absent`: missing in recordings that do not say it.
    #[prost(message, optional, tag = "9")]
    pub absent: Option<AbsentMessage>,
}

/// `depthloom.Absent`: the output ports that gave nothing although their node fired.
#[derive(Clone, PartialEq, prost::Message)]
pub struct AbsentMessage {
    /// Field `ports`.
    #[prost(message, repeated, tag = "1")]
    pub ports: Vec<AbsentPortMessage>,
}

/// `depthloom.AbsentPort`: an output port; without `node`, of the source.
#[derive(Clone, PartialEq, prost::Message)]
pub struct AbsentPortMessage {
    /// Field `node`.
    #[prost(uint32, optional, tag = "1")]
    pub node: Option<u32>,
    /// Field `port`.
    #[prost(uint32, tag = "2")]
    pub port: u32,
}

/// `depthloom.Warning`: what a node told of on a frame without failing; without `node`, the source.
#[derive(Clone, PartialEq, prost::Message)]
pub struct WarningMessage {
    /// Field `node`.
    #[prost(uint32, optional, tag = "1")]
    pub node: Option<u32>,
    /// Field `what`.
    #[prost(string, tag = "2")]
    pub what: String,
    /// Field `count`: how many of the thing there were; 0 if it is none to be counted.
    #[prost(uint64, tag = "3")]
    pub count: u64,
}

/// `depthloom.NodeKey`: the key that all values of a node share on a frame.
#[derive(Clone, PartialEq, prost::Message)]
pub struct NodeKeyMessage {
    /// Field `node`.
    #[prost(uint32, tag = "1")]
    pub node: u32,
    /// Field `key`.
    #[prost(string, tag = "2")]
    pub key: String,
}

/// `depthloom.Failure`: a node that failed on a frame; without `node`, the source.
#[derive(Clone, PartialEq, prost::Message)]
pub struct FailureMessage {
    /// Field `node`.
    #[prost(uint32, optional, tag = "1")]
    pub node: Option<u32>,
    /// Field `what`.
    #[prost(string, tag = "2")]
    pub what: String,
}

impl CommitMessage {
    /// The message of a commit.
    #[must_use]
    pub fn new(commit: &Commit<'_>, crc32_before: u32) -> Self {
        let keys = commit.keys.iter();
        let failures = commit.failures.iter();
        Self {
            run: commit.run as u32,
            frame: commit.frame.id.to_string(),
            index: commit.frame.index,
            source_key: commit.source_key.map_or_else(String::new, |key| key.to_string()),
            keys: keys.map(|of| NodeKeyMessage { node: of.node as u32, key: of.key.to_string() }).collect(),
            failures: failures
                .map(|failure| FailureMessage {
                    node: failure.node.map(|node| node as u32),
                    what: failure.what.clone(),
                })
                .collect(),
            crc32_before,
            absent: Some(AbsentMessage {
                ports: commit
                    .absent
                    .iter()
                    .map(|slot| match *slot {
                        Slot::Source { port } => AbsentPortMessage { node: None, port: port as u32 },
                        Slot::Node { node, port } => AbsentPortMessage { node: Some(node as u32), port: port as u32 },
                    })
                    .collect(),
            }),
            warnings: commit
                .warnings
                .iter()
                .map(|of| WarningMessage {
                    node: of.node.map(|node| node as u32),
                    what: of.what.clone(),
                    count: of.count,
                })
                .collect(),
        }
    }

    /// The outputs that gave nothing although their source or node fired; `None` if the recording does not say it.
    #[must_use]
    pub fn absent(&self) -> Option<Vec<Slot>> {
        let slot = |of: &AbsentPortMessage| match of.node {
            None => Slot::Source { port: of.port as usize },
            Some(node) => Slot::Node { node: node as usize, port: of.port as usize },
        };
        Some(self.absent.as_ref()?.ports.iter().map(slot).collect())
    }

    /// What was told of.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warned> {
        let warnings = self.warnings.iter();
        warnings
            .map(|of| Warned { node: of.node.map(|node| node as usize), what: of.what.clone(), count: of.count })
            .collect()
    }

    /// The key of the source's values, if it gave any; `None` if what stands there is no key.
    #[must_use]
    pub fn source_key(&self) -> Option<Option<Key>> {
        if self.source_key.is_empty() { Some(None) } else { Key::parse(&self.source_key).map(Some) }
    }

    /// The keys of the nodes' values; `None` if one is none.
    #[must_use]
    pub fn keys(&self) -> Option<Vec<SlotKey>> {
        self.keys.iter().map(|of| Some(SlotKey { node: of.node as usize, key: Key::parse(&of.key)? })).collect()
    }

    /// The failures.
    #[must_use]
    pub fn failures(&self) -> Vec<Failure> {
        let failures = self.failures.iter();
        failures.map(|of| Failure { node: of.node.map(|node| node as usize), what: of.what.clone() }).collect()
    }
}
