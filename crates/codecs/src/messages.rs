//! The messages of values that are depthloom's own: a row of scores and a point of a learning curve.

use depthloom_graphs::values::CurvePoint;
use depthloom_scores::{Metric, PixelSet, ScoreRow};

use crate::wire_format::{Content, Fields, put_bytes, put_number, put_varint};

/// `depthloom.Score`: one row of scores.
///
/// Fields `frame` 1, `set` 2, `pixels` 3, `zone` 12 (empty: the complete image), `truth` 13, `valid` 14, `log_mean` 15,
/// and the [catalogue](Metric)'s, as optional doubles: a metric that was not requested, or of no pixel, is absent.
/// Older recordings hold the first eight scores and none of 12 to 15.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoreMessage {
    /// The frame's id.
    pub frame: String,
    /// The row.
    pub row: ScoreRow,
}

/// `zone` of a `depthloom.Score`.
pub(crate) const ZONE: u32 = 12;
pub(crate) const TRUTH: u32 = 13;
pub(crate) const VALID: u32 = 14;
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
        put_number(&mut out, VALID, row.valid);
        let scores = row.scores.iter().map(|(metric, value)| (metric.field, *value));
        for (field, value) in row.log_mean.map(|mean| (LOG_MEAN, mean)).into_iter().chain(scores) {
            // Zero is written too: what is left out would come back as absent.
            put_varint(&mut out, u64::from(field) << 3 | 1);
            out.extend_from_slice(&value.to_le_bytes());
        }
        out
    }

    /// Reads a message.
    pub fn decode(message: &[u8]) -> Result<Self, String> {
        let malformed = |what: &dyn std::fmt::Display| format!("a message is not a row of metrics: {what}");
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
                (VALID, Content::Varint(count)) => row.valid = count,
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

/// `depthloom.Number`: a number of a frame. Always present, as in [`CurvePointMessage`].
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct NumberMessage {
    /// Field `value`.
    #[prost(double, optional, tag = "1")]
    pub value: Option<f64>,
}

/// `depthloom.CurvePoint`: one point of a learning curve.
///
/// Loss and learning rate are always there: the presence is declared because zero, which an undeclared field leaves
/// out, would come back without its sign.
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
