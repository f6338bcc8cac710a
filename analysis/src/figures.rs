//! Figures for papers, with a given size in millimetres, as SVG, PNG or PDF, and with their data as CSV.
//!
//! The numbers equal those of [`analyse`](crate::analyse()), [`compare`](crate::compare()), the table and the report.

mod difference;
mod error_bins;
mod errors;
mod maps;
mod parameter;
mod scores;
mod sparsification;
mod spreads;

use std::path::PathBuf;

use clap::ValueEnum;
use depthloom_figures::Drawing;
pub use depthloom_figures::{Layout, Size};
use depthloom_figures::{Sheet, learning_curves as drawn_curves};
use depthloom_recording::Recording;
use depthloom_scores::PixelSet;

use self::error_bins::Watch;
use self::scores::with_scores;
use crate::curves::{LearningCurve, learning_curves, table_of_points};
use crate::error::{AnalysisError, caught};
use crate::estimates::Estimate;
use crate::input::condition::recording_notes;
use crate::input::frame_choice::FrameChoice;
use crate::query::{Bins, Inquiry, Outlier, SampleSet, Unit, is_any};
use crate::statistics::Resampling;
use crate::tables::RowKey;

/// The default minimum number of pixels: bins with fewer are drawn faint.
pub(crate) const MIN_COUNT: u64 = 100;
/// The maximum number of readable panels.
const MAX_PANELS: usize = 17;
/// The width and height of an A4 page, millimetres.
const A4_WIDE_MM: f64 = 210.0;
const A4_MM: f64 = 297.0;

/// The kind of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FigureKind {
    /// Median, 25 to 75 % and 5 to 95 % of the absolute error by ground-truth distance, as in the paper.
    ErrorVsDistance,
    /// Difference of the errors of two estimates by distance, and the distance at which the better one changes.
    Difference,
    /// Error histogram.
    Histogram,
    /// Cumulative error distribution.
    Cdf,
    /// A metric on every frame: one strip per estimate, one dot per frame.
    Frames,
    /// A metric against parameters of `matrix:`: a line for one parameter, a heat map for two.
    Parameter,
    /// Errors by the confidence that was assigned to them.
    Reliability,
    /// How much worse a predicted uncertainty ranks pixels than their true errors do; the area is AUSE.
    Sparsification,
    /// Training and validation loss by step.
    Learning,
    /// Frames as in the paper: image, stereo, mono, fused, confidence, difference of errors, ground truth.
    Panels,
}

impl FigureKind {
    /// Whether the kind reads samples, which must be written first.
    #[must_use]
    pub const fn needs_samples(self) -> bool {
        matches!(self, Self::ErrorVsDistance | Self::Difference | Self::Histogram | Self::Cdf | Self::Reliability)
    }
}

/// The contents and the layout of a figure.
#[derive(Clone, Debug)]
pub struct FigureRequest {
    /// The kind.
    pub kind: FigureKind,
    /// Its size.
    pub size: Size,
    /// The title above the figure; empty by default, because papers have captions.
    pub title: String,
    /// Only estimates whose label or name matches one of these patterns, separated by commas.
    pub estimates: Option<String>,
    /// Only these variants, and everything that all variants share; patterns separated by commas.
    pub variants: Option<String>,
    /// Only these stages; patterns separated by commas.
    pub stages: Option<String>,
    /// The pixel set of errors. `None`: the pixels that are valid in all estimates, and additionally the valid pixels
    /// of each.
    pub set: Option<SampleSet>,
    /// The pixel set of scores, for `frames` and `parameter`. `None`: every pixel with ground truth, if those were
    /// scored.
    pub scored_set: Option<PixelSet>,
    /// The quantity that errors are binned by, if the kind does not define it: [`By::parse`](crate::By::parse).
    pub by: Option<String>,
    /// The bins, as in `analyse`.
    pub bins: Option<Bins>,
    /// The unit of errors.
    pub unit: Unit,
    /// One panel per variant, or one for all.
    pub layout: Layout,
    /// Bins with fewer pixels are drawn faint and do not set the range of axes.
    pub min_count: u64,
    /// The end of the error axis.
    pub y_max: Option<f64>,
    /// The metric; `None`: the first error that was scored.
    pub score: Option<String>,
    /// The axes of the matrix.
    pub axes: Vec<String>,
    /// The frames; `None`: a few, evenly spaced.
    pub frames: Option<FrameChoice>,
    /// The resampling of frames for the band around differences.
    pub resampling: Resampling,
    /// The maximum resolution of maps, pixels per inch.
    pub dpi: f64,
}

impl FigureRequest {
    /// The query of samples without bins and percentiles.
    fn inquiry(&self) -> Inquiry {
        let sets = vec![self.set.unwrap_or(SampleSet::Common)];
        Inquiry { sets, unit: self.unit, outlier: Outlier::OfTruth(0.25), ..Inquiry::default() }
    }

    fn selects(&self, estimate: &Estimate) -> bool {
        self.selects_names(&estimate.row_key, &[&estimate.label, &estimate.name])
    }

    fn selects_names(&self, row_key: &RowKey, names: &[&str]) -> bool {
        let matches = |patterns: &Option<String>, texts: &[&str]| {
            patterns.as_deref().is_none_or(|patterns| is_any(patterns, texts))
        };
        matches(&self.stages, &[&row_key.stage])
            && matches(&self.estimates, names)
            && row_key.variant.as_deref().is_none_or(|variant| matches(&self.variants, &[variant]))
    }

    /// A sheet of the requested size as a figure.
    fn figure(&self, sheet: Sheet, about: String, data: Vec<u8>) -> Result<Figure, AnalysisError> {
        if self.kind != FigureKind::Panels && sheet.panels.len() > MAX_PANELS {
            let what = format!("the figure would have {} panels, but the maximum is {MAX_PANELS}", sheet.panels.len());
            let help =
                "select some with `--variant` or `--estimates`, or draw all in one panel with `--layout overlaid`";
            return Err(AnalysisError::request(what, help.to_owned()));
        }
        let drawing = Sheet { size: self.size, title: self.title.clone(), ..sheet }.drawing();
        let help = || "change `--width` or `--height`".to_owned();
        let drawing = drawing.map_err(|what| AnalysisError::request(what, help()))?;
        Ok(Figure { drawing, about, data, notes: Vec::new() })
    }
}

/// A run shown in a figure.
#[derive(Debug)]
pub struct FigureRun<'a> {
    /// Its name.
    pub called: &'a str,
    /// Its recording.
    pub recording: &'a Recording,
    /// Its samples, if the kind [needs them](FigureKind::needs_samples).
    pub samples: Option<PathBuf>,
}

/// A figure, drawn.
#[derive(Clone, Debug)]
pub struct Figure {
    /// The drawing.
    pub drawing: Drawing,
    /// Describes the contents and the pixels: the beginning of a caption, without a full stop.
    pub about: String,
    /// The data of the figure, as CSV.
    pub data: Vec<u8>,
    /// Notes besides the caption.
    pub notes: Vec<String>,
}

/// Draws a figure of runs. `progress` is called with the number of samples read so far, and their total.
///
/// # Errors
/// [`AnalysisError::Request`] if requested data does not exist or does not fit the size; if a recording or samples
/// cannot be read; [`AnalysisError::Stopped`] once `stop` returns true.
pub fn figure(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    progress: &(dyn Fn(u64, u64) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, AnalysisError> {
    let watch = Watch { progress, stop };
    let mut figure = caught(|| match request.kind {
        FigureKind::ErrorVsDistance | FigureKind::Reliability => spreads::spreads(runs, request, &watch),
        FigureKind::Histogram => errors::histogram(runs, request, &watch),
        FigureKind::Cdf => errors::cdf(runs, request, &watch),
        FigureKind::Difference => difference::difference(runs, request, stop),
        FigureKind::Frames => with_scores(only(runs)?, request, stop, |scores| scores::frames(scores, request)),
        FigureKind::Parameter => {
            with_scores(only(runs)?, request, stop, |scores| parameter::parameter(scores, request))
        }
        FigureKind::Sparsification => sparsification::sparsification(only(runs)?, request, stop),
        FigureKind::Learning => learning(only(runs)?, request),
        FigureKind::Panels => maps::panels(only(runs)?, request, stop),
    })?;
    if request.kind != FigureKind::Learning {
        for run in runs {
            let prefix = if runs.len() > 1 { format!("{}: ", run.called) } else { String::new() };
            let notes = recording_notes(run.recording).into_iter().map(|note| format!("{prefix}{note}"));
            let new: Vec<String> = notes.filter(|note| !figure.notes.contains(note)).collect();
            figure.notes.extend(new);
        }
    }
    let (_, height_mm) = figure.drawing.size_mm();
    let is_for_a_page = request.size.width_mm <= A4_WIDE_MM && request.size.height_mm.is_none();
    if is_for_a_page && height_mm > A4_MM {
        let help = "show less, or reduce `--width`";
        figure
            .notes
            .push(format!("the figure is {height_mm:.0} mm high, more than an A4 page ({A4_MM:.0} mm): {help}"));
    }
    Ok(figure)
}

fn only<'r, 'a>(runs: &'r [FigureRun<'a>]) -> Result<&'r FigureRun<'a>, AnalysisError> {
    if let [only] = runs {
        return Ok(only);
    }
    let help = "draw one figure per run; only `error-vs-distance`, `difference`, `histogram`, `cdf` and `reliability` accept several runs";
    Err(AnalysisError::request("this kind of figure shows a single run".to_owned(), help.to_owned()))
}

fn learning(run: &FigureRun<'_>, request: &FigureRequest) -> Result<Figure, AnalysisError> {
    let mut curves = learning_curves(run.recording)?;
    curves.retain(|curve| request.selects_names(&curve.row_key, &[&curve.node]));
    if curves.is_empty() {
        let (what, help) = ("no learning curve was recorded", "stages with a node `learn/ssl` record one");
        return Err(AnalysisError::request(what.to_owned(), help.to_owned()));
    }
    let sheet = drawn_curves(curves.iter().map(|curve| (curve.label.as_str(), &curve.curve)));
    let about =
        "Learning curves: mean training loss since the last point, and validation loss on held-out samples".to_owned();
    let mut figure = request.figure(sheet, about, table_of_points(&curves).csv())?;
    let single = curves.iter().filter(|curve| curve.curve.points.len() == 1);
    let note = |curve: &LearningCurve| {
        format!("{} has only one point, so no line is drawn; `--csv` writes the point", curve.label)
    };
    figure.notes.extend(single.map(note));
    Ok(figure)
}
