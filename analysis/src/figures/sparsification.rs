//! Sparsification error curves: how much worse a predicted uncertainty ranks pixels than their true errors do.

use depthloom_figures::{Axis, compared_curves};
use depthloom_graphs::Value;
use depthloom_graphs::counted;
use depthloom_graphs::plan::FrameIndex;
use depthloom_scores::{ScoredPixels, SparsificationCurves, Uncertainty, UncertaintyKind};

use super::{Figure, FigureRequest, FigureRun};
use crate::error::{AnalysisError, listed};
use crate::estimates::{Estimate, PredictedUncertainty, estimates};
use crate::tables::{Rows, Table};
use crate::titles::Titles;

/// A point of an estimate's curves, means over frames, as shares of the error of all pixels.
struct Point<'e> {
    estimate: &'e Estimate,
    removed_percent: f64,
    predicted: f64,
    oracle: f64,
}

/// The difference of the two curves of each estimate with an uncertainty. The area below a line is the mean of `ause`.
pub(super) fn sparsification(
    run: &FigureRun<'_>,
    request: &FigureRequest,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, AnalysisError> {
    let all = estimates(run.recording.plan())?;
    let selected: Vec<(&Estimate, &PredictedUncertainty)> = all
        .iter()
        .filter(|estimate| request.selects(estimate))
        .filter_map(|estimate| Some((estimate, estimate.uncertainty.as_ref()?)))
        .collect();
    if selected.is_empty() {
        let labels = listed(all.iter().map(|estimate| estimate.label.as_str()));
        let what = "no selected estimate has a `deviation` or a `confidence`".to_owned();
        let help = format!("name one under `score: estimates:`; available estimates: {labels}");
        return Err(AnalysisError::request(what, help));
    }
    let titles = Titles::new([run.recording.plan()]);
    let (mut points, mut lines, mut frames) = (Vec::new(), Vec::new(), 0);
    for (estimate, uncertainty) in selected {
        let (mean, count) = mean_curves(run, estimate, uncertainty, stop)?;
        frames = frames.max(count);
        let steps = mean.len() as f64;
        let mut line = Vec::with_capacity(mean.len() + 1);
        for (step, (predicted, oracle)) in mean.into_iter().enumerate() {
            let removed_percent = 100.0 * step as f64 / steps;
            points.push(Point { estimate, removed_percent, predicted, oracle });
            line.push((removed_percent, predicted - oracle));
        }
        line.push((100.0, 0.0));
        let (name, variant) = (estimate.name.clone(), estimate.row_key.variant.clone());
        lines.push((titles.place(name, String::new(), variant), line));
    }
    let high = lines.iter().flat_map(|(_, line)| line).map(|(_, error)| *error).fold(1e-9, f64::max);
    let x = Axis::new(0.0, 100.0, "removed pixels, %");
    let y = Axis::new(0.0, request.y_max.unwrap_or(high * 1.05), "sparsification error");
    let sheet = compared_curves(&lines, request.layout, (&x, &y), false);
    let about = format!(
        "Sparsification error, as a share of the error of all pixels: pixels removed by predicted uncertainty minus \
         pixels removed by true error, mean over {}; the area below a line is its AUSE",
        counted(frames as u64, "frame")
    );
    request.figure(sheet, about, table(&points).csv())
}

fn table(points: &[Point<'_>]) -> Table {
    let rows = Rows(points);
    Table::new(vec![
        rows.text("stage", |point| &point.estimate.row_key.stage),
        rows.text("variant", |point| point.estimate.row_key.variant.as_ref()),
        rows.text("estimate", |point| &point.estimate.name),
        rows.number("removed_percent", |point| point.removed_percent),
        rows.number("predicted", |point| point.predicted),
        rows.number("oracle", |point| point.oracle),
    ])
}

/// The curves of an estimate, mean over the frames that have pixels and errors, and the number of these frames.
fn mean_curves(
    run: &FigureRun<'_>,
    estimate: &Estimate,
    uncertainty: &PredictedUncertainty,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Vec<(f64, f64)>, usize), AnalysisError> {
    let unrecorded = || {
        let what = format!("the maps of {} were not recorded", estimate.label);
        let topics = [&estimate.scored_output, &estimate.truth_output, &Some(uncertainty.output.clone())];
        let topics = listed(topics.into_iter().flatten().map(|topic| topic.trim_start_matches('/')));
        AnalysisError::request(what, format!("record {topics} (`record:` in the experiment), and run again"))
    };
    let Some(compared) = estimate.compared() else { return Err(unrecorded()) };
    let topics = [compared.estimate_topic, compared.truth_topic, uncertainty.output.as_str()];
    let mut reader = run.recording.reader(estimate.run, &topics).map_err(|_| unrecorded())?;
    let mut sums = vec![(0.0, 0.0); uncertainty.sparsification.steps as usize];
    let mut count = 0;
    for position in FrameIndex::all(run.recording.frames(estimate.run).len()) {
        if stop() {
            return Err(AnalysisError::Stopped);
        }
        let values = reader.read(position)?;
        let [Some(depth), Some(truth), Some(unsure)] = &values[..] else { continue };
        let Some(curves) = curves(depth, truth, unsure, compared.settings, uncertainty) else { continue };
        let Some(&whole) = curves.predicted.first().filter(|whole| **whole > 0.0) else { continue };
        count += 1;
        for (sum, (predicted, oracle)) in sums.iter_mut().zip(curves.predicted.iter().zip(&curves.oracle)) {
            sum.0 += predicted / whole;
            sum.1 += oracle / whole;
        }
    }
    if count == 0 {
        let what = format!("no frame of {} has an estimate with an uncertainty and ground truth", estimate.label);
        return Err(AnalysisError::request(what, "select other estimates with `--estimates`".to_owned()));
    }
    let mean = |(predicted, oracle): (f64, f64)| (predicted / f64::from(count), oracle / f64::from(count));
    Ok((sums.into_iter().map(mean).collect(), count as usize))
}

/// The curves of a frame; `None` if the maps do not fit, or no pixel is scored.
fn curves(
    depth: &Value,
    truth: &Value,
    unsure: &Value,
    settings: &depthloom_scores::Settings,
    uncertainty: &PredictedUncertainty,
) -> Option<SparsificationCurves> {
    let truth = truth.metres()?;
    let map = match (uncertainty.kind, unsure) {
        (UncertaintyKind::Confidence, Value::Weight(weight)) => Uncertainty::Confidence(weight.share.as_raw()),
        (UncertaintyKind::Deviation, deviation) => Uncertainty::Deviation(deviation.metres()?.as_raw()),
        _ => return None,
    };
    let estimate = depth.depth_estimate()?.with_uncertainty(Some(map));
    let (Uncertainty::Deviation(own) | Uncertainty::Confidence(own)) = map;
    if [estimate.metres.len(), own.len()] != [truth.as_raw().len(); 2] {
        return None;
    }
    let (width, height) = truth.dimensions();
    let pixels = ScoredPixels::new(truth, width as usize, height as usize, settings);
    let pixels = pixels.uncertain(estimate, pixels.alignment(estimate, settings), settings);
    SparsificationCurves::new(&pixels, uncertainty.sparsification)
}
