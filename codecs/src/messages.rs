//! The messages that are depthloom's own: a row of scores, a point of a learning curve, and the record that commits a frame.

use depthloom_graphs::Key;
use depthloom_graphs::contracts::{Commit, Failure, SlotKey};
use depthloom_graphs::values::CurvePoint;
use depthloom_scores::{PixelSet, ScoreRow};

/// `depthloom.Score`: one row of scores; a score that is NaN is absent.
#[derive(Clone, PartialEq, prost::Message)]
pub struct ScoreMessage {
    /// Field `frame`.
    #[prost(string, tag = "1")]
    pub frame: String,
    /// Field `set`.
    #[prost(string, tag = "2")]
    pub set: String,
    /// Field `pixels`.
    #[prost(uint64, tag = "3")]
    pub pixels: u64,
    /// Field `a1`.
    #[prost(double, optional, tag = "4")]
    pub a1: Option<f64>,
    /// Field `a2`.
    #[prost(double, optional, tag = "5")]
    pub a2: Option<f64>,
    /// Field `a3`.
    #[prost(double, optional, tag = "6")]
    pub a3: Option<f64>,
    /// Field `abs_rel`.
    #[prost(double, optional, tag = "7")]
    pub abs_rel: Option<f64>,
    /// Field `sq_rel`.
    #[prost(double, optional, tag = "8")]
    pub sq_rel: Option<f64>,
    /// Field `rmse`.
    #[prost(double, optional, tag = "9")]
    pub rmse: Option<f64>,
    /// Field `rmse_log`.
    #[prost(double, optional, tag = "10")]
    pub rmse_log: Option<f64>,
    /// Field `silog`.
    #[prost(double, optional, tag = "11")]
    pub silog: Option<f64>,
}

impl ScoreMessage {
    /// The message of a frame's row.
    #[must_use]
    pub fn new(frame: &str, row: &ScoreRow) -> Self {
        let [a1, a2, a3, abs_rel, sq_rel, rmse, rmse_log, silog] =
            row.scores().map(|score| (!score.is_nan()).then_some(score));
        let (frame, set, pixels) = (frame.to_owned(), row.set.name().to_owned(), row.pixels);
        Self { frame, set, pixels, a1, a2, a3, abs_rel, sq_rel, rmse, rmse_log, silog }
    }

    /// The row; `None` if the pixel set is unknown.
    #[must_use]
    pub fn row(&self) -> Option<ScoreRow> {
        let set = [PixelSet::All, PixelSet::Answered].into_iter().find(|set| set.name() == self.set)?;
        let or_nan = |score: Option<f64>| score.unwrap_or(f64::NAN);
        Some(ScoreRow {
            set,
            pixels: self.pixels,
            a1: or_nan(self.a1),
            a2: or_nan(self.a2),
            a3: or_nan(self.a3),
            abs_rel: or_nan(self.abs_rel),
            sq_rel: or_nan(self.sq_rel),
            rmse: or_nan(self.rmse),
            rmse_log: or_nan(self.rmse_log),
            silog: or_nan(self.silog),
        })
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
        }
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
