//! Recorded learning curves: the losses of trained networks.

use depthloom_graphs::Value;
use depthloom_graphs::plan::{NodeId, RunId};
use depthloom_graphs::values::{Curve, CurvePoint};
use depthloom_recording::{RecordedPlan, Recording};
use schemars::JsonSchema;
use serde::Serialize;

use crate::error::AnalysisError;
use crate::tables::{RowKey, RowKeys, Rows, Table, key_columns};

/// The end of a learning curve.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct CurveEnd {
    stage: String,
    variant: Option<String>,
    node: String,
    points: u64,
    step: Option<u64>,
    loss: Option<f64>,
    /// The last measured validation loss.
    validation: Option<f64>,
}

/// A learning curve with its names.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LearningCurve {
    /// Its topic without the parts that all curves share: `learn/train`, or `learn/variant/train`.
    pub(crate) label: String,
    /// The stage, and the variant if not all variants share the node.
    pub(crate) row_key: RowKey,
    /// The node.
    pub(crate) node: String,
    pub(crate) curve: Curve,
}

/// All learning curves of a recording, in the order they were recorded.
pub(crate) fn learning_curves(recording: &Recording) -> Result<Vec<LearningCurve>, AnalysisError> {
    let mut curves = Vec::new();
    for once in recording.aggregate_values() {
        let node = recording.plan().runs.get(once.run.0).and_then(|run| run.nodes.get(once.node.0));
        let Some(output) = node.and_then(|node| node.outputs.get(once.port.0)) else { continue };
        if once.value_type != "curve" {
            continue;
        }
        if let Value::Curve(curve) = recording.aggregate_value(once)? {
            let topic = output.topic.trim_start_matches('/');
            let label = topic.strip_suffix("/curve").unwrap_or(topic).to_owned();
            curves.push(LearningCurve { label, ..learning_curve(recording.plan(), once.run, once.node, &curve) });
        }
    }
    Ok(curves)
}

/// The learning curve of a node, without a label.
pub(crate) fn learning_curve(plan: &RecordedPlan, run: RunId, node: NodeId, curve: &Curve) -> LearningCurve {
    let (run, row_keys) = (&plan.runs[run], RowKeys::new(plan));
    let node = &run.nodes[node];
    LearningCurve {
        label: String::new(),
        row_key: row_keys.for_variants(&run.stage, &node.variants),
        node: node.name.clone(),
        curve: curve.clone(),
    }
}

/// The figure of a report as SVG; equal numbers give equal bytes.
pub(crate) fn figure(curves: &[LearningCurve]) -> String {
    let series: Vec<_> = curves.iter().map(|curve| (curve.label.as_str(), &curve.curve)).collect();
    let sheet = depthloom_figures::learning_curves(series);
    depthloom_figures::Sheet { title: "Learning curves".to_owned(), ..sheet }.drawing().unwrap_or_default().svg()
}

/// The table of `learning_curves.csv`: key columns, `step, loss, validation, learning_rate`. A validation loss that was
/// not measured is null.
pub(crate) fn table_of_points(curves: &[LearningCurve]) -> Table {
    let points: Vec<(&LearningCurve, &CurvePoint)> =
        curves.iter().flat_map(|curve| curve.curve.points.iter().map(move |point| (curve, point))).collect();
    let rows = Rows(&points);
    let mut columns =
        key_columns(&points, |(curve, _)| &curve.row_key, vec![rows.key("node", |(curve, _)| &curve.node)]);
    columns.extend([
        rows.count("step", |(_, point)| point.step),
        rows.number("loss", |(_, point)| point.loss),
        rows.number("validation", |(_, point)| point.validation),
        rows.number("learning_rate", |(_, point)| point.learning_rate),
    ]);
    Table::new(columns)
}

impl LearningCurve {
    /// The end of the curve: last step, loss, and the last measured validation loss.
    pub(crate) fn end(&self) -> CurveEnd {
        let points = &self.curve.points;
        let last = points.last();
        CurveEnd {
            stage: self.row_key.stage.clone(),
            variant: self.row_key.variant.clone(),
            node: self.node.clone(),
            points: points.len() as u64,
            step: last.map(|point| point.step),
            loss: last.map(|point| point.loss),
            validation: points.iter().rev().find_map(|point| point.validation),
        }
    }
}
