//! Figures for papers: of a stated size in millimetres, as SVG, PNG or PDF, with the numbers that they show.
//!
//! Their numbers are those of [`analyse`](crate::analyse()), [`compare`](crate::compare()), the table and the report.

mod asked;
mod difference;
mod errors;
mod maps;
mod parameter;
mod scores;
mod spreads;

use std::path::PathBuf;

use clap::ValueEnum;
use depthloom_figures::Drawing;
pub use depthloom_figures::{Layout, Size};
use depthloom_figures::{Sheet, learning_curves as drawn_curves};
use depthloom_recording::Recording;
use depthloom_scores::PixelSet;

use self::asked::Watch;
use self::scores::with_scores;
use crate::curves::{LearningCurve, learning_curves, table_of_points};
use crate::error::{AnalysisError, caught};
use crate::estimates::Estimate;
use crate::input::frame_choice::FrameChoice;
use crate::query::{Bins, Gross, Inquiry, SampleSet, Unit, is_any};
use crate::statistics::Resampling;
use crate::tables::RowKey;

/// A bin of fewer pixels is thin by default.
pub(crate) const THIN: u64 = 100;
/// The most panels that can be read.
const MAX_PANELS: usize = 17;
/// The sides of a page, millimetres.
const A4_WIDE_MM: f64 = 210.0;
const A4_MM: f64 = 297.0;

/// What a figure shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FigureKind {
    /// The paper's: median, 25 to 75 % and 5 to 95 % of the absolute error by true distance.
    ErrorVsDistance,
    /// How much farther off one estimate is than another, by distance, and where one hands over to the other.
    Difference,
    /// How often errors of which size are.
    Histogram,
    /// The share of pixels whose error is below what.
    Cdf,
    /// A score on every frame: a strip an estimate.
    Frames,
    /// A score against a parameter of `matrix:`: a line for one, a heat map for two.
    Parameter,
    /// Errors by the weight that was given to them.
    Reliability,
    /// Losses by step of learning.
    Learning,
    /// Frames as the paper shows them: image, stereo, mono, fused, weight, difference of errors, truth.
    Panels,
}

impl FigureKind {
    /// Whether it reads samples, which must be written first.
    #[must_use]
    pub const fn is_of_samples(self) -> bool {
        matches!(self, Self::ErrorVsDistance | Self::Difference | Self::Histogram | Self::Cdf | Self::Reliability)
    }
}

/// What of runs a figure shows, and how.
#[derive(Clone, Debug)]
pub struct FigureRequest {
    /// What it shows.
    pub kind: FigureKind,
    /// Its size.
    pub size: Size,
    /// Words above it; empty: none, since a paper has a caption.
    pub title: String,
    /// Only estimates whose label or name is one of these patterns, with commas between.
    pub estimates: Option<String>,
    /// Only what these variants have, and what all share; patterns with commas between.
    pub variants: Option<String>,
    /// Only these stages; patterns with commas between.
    pub stages: Option<String>,
    /// The pixels of errors; `None`: those valid in all estimates, and beside them the valid ones of each.
    pub set: Option<SampleSet>,
    /// The pixels of scores, of `frames` and `parameter`; `None`: every pixel with ground truth, where those were
    /// scored.
    pub scored_set: Option<PixelSet>,
    /// What errors are by, where the kind does not say: [`By::parse`](crate::By::parse).
    pub by: Option<String>,
    /// The bins, as `analyse` takes them.
    pub bins: Option<Bins>,
    /// The unit of errors.
    pub unit: Unit,
    /// A panel per variant, or one for all.
    pub layout: Layout,
    /// A bin of fewer pixels is drawn faint, and sets no axis.
    pub thin: u64,
    /// The end of the errors' axis.
    pub most: Option<f64>,
    /// Which score; `None`: the first error that was scored.
    pub score: Option<String>,
    /// Which axes of the matrix.
    pub axes: Vec<String>,
    /// Which frames; `None`: a few, evenly apart.
    pub frames: Option<FrameChoice>,
    /// How frames are resampled for a band around differences.
    pub resampling: Resampling,
    /// The most pixels per inch of a picture of a map.
    pub dpi: f64,
}

impl FigureRequest {
    /// The query of samples without bins and percentiles.
    fn inquiry(&self) -> Inquiry {
        let sets = vec![self.set.unwrap_or(SampleSet::Common)];
        Inquiry { sets, unit: self.unit, gross: Gross::OfTruth(0.25), ..Inquiry::default() }
    }

    fn wants(&self, estimate: &Estimate) -> bool {
        self.wants_those(&estimate.lead, &[&estimate.label, &estimate.name])
    }

    fn wants_those(&self, lead: &RowKey, names: &[&str]) -> bool {
        let is = |patterns: &Option<String>, texts: &[&str]| {
            patterns.as_deref().is_none_or(|patterns| is_any(patterns, texts))
        };
        is(&self.stages, &[&lead.stage])
            && is(&self.estimates, names)
            && lead.variant.as_deref().is_none_or(|variant| is(&self.variants, &[variant]))
    }

    /// A sheet of the requested size as a figure.
    fn figure(&self, sheet: Sheet, about: String, data: Vec<u8>) -> Result<Figure, AnalysisError> {
        if self.kind != FigureKind::Panels && sheet.panels.len() > MAX_PANELS {
            let what = format!("{} panels are more than {MAX_PANELS}", sheet.panels.len());
            let help = "choose some with --variant or --estimates, or draw all on one with `--layout overlaid`";
            return Err(AnalysisError::asked(what, help.to_owned()));
        }
        let drawing = Sheet { size: self.size, title: self.title.clone(), ..sheet }.drawing();
        let help = || "ask for another --width or --height".to_owned();
        let drawing = drawing.map_err(|what| AnalysisError::asked(what, help()))?;
        Ok(Figure { drawing, about, data, notes: Vec::new() })
    }
}

/// A run that a figure shows.
#[derive(Debug)]
pub struct FigureRun<'a> {
    /// Its name.
    pub called: &'a str,
    /// Its recording.
    pub recording: &'a Recording,
    /// Its samples, where the kind [reads them](FigureKind::is_of_samples).
    pub samples: Option<PathBuf>,
}

/// A figure, drawn.
#[derive(Clone, Debug)]
pub struct Figure {
    /// What is on it.
    pub drawing: Drawing,
    /// What it shows, over which pixels: the beginning of a caption, without a full stop.
    pub about: String,
    /// The numbers that it shows, as CSV.
    pub data: Vec<u8>,
    /// Remarks beside its caption.
    pub notes: Vec<String>,
}

/// Draws a figure of runs. `progress` is called with the samples read so far and their number.
///
/// # Errors
/// [`AnalysisError::Request`] if what is requested is not there, or does not fit the size; if a recording or samples
/// cannot be read; [`AnalysisError::Stopped`] once `stop` says so.
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
        FigureKind::Learning => learning(only(runs)?, request),
        FigureKind::Panels => maps::panels(only(runs)?, request, stop),
    })?;
    let (_, height_mm) = figure.drawing.size_mm();
    let is_for_a_page = request.size.width_mm <= A4_WIDE_MM && request.size.height_mm.is_none();
    if is_for_a_page && height_mm > A4_MM {
        let help = "show less of it, or make it narrower";
        figure.notes.push(format!("it is {height_mm:.0} mm high, more than a page of A4 has ({A4_MM:.0} mm): {help}"));
    }
    Ok(figure)
}

fn only<'r, 'a>(runs: &'r [FigureRun<'a>]) -> Result<&'r FigureRun<'a>, AnalysisError> {
    if let [only] = runs {
        return Ok(only);
    }
    let help = "draw one of each; `error-vs-distance`, `difference`, `histogram`, `cdf` and `reliability` take several";
    Err(AnalysisError::asked("this kind of figure is of one run".to_owned(), help.to_owned()))
}

fn learning(run: &FigureRun<'_>, request: &FigureRequest) -> Result<Figure, AnalysisError> {
    let mut curves = learning_curves(run.recording)?;
    curves.retain(|curve| request.wants_those(&curve.lead, &[&curve.node]));
    if curves.is_empty() {
        let (what, help) = ("there is no learning curve", "stages with a node `learn/ssl` have one");
        return Err(AnalysisError::asked(what.to_owned(), help.to_owned()));
    }
    let sheet = drawn_curves(curves.iter().map(|curve| (curve.label.as_str(), &curve.curve)));
    let about = "Learning curves: mean loss since the last point, and validation on samples held out".to_owned();
    let mut figure = request.figure(sheet, about, table_of_points(&curves).csv())?;
    let single = curves.iter().filter(|curve| curve.curve.points.len() == 1);
    let note = |curve: &LearningCurve| {
        format!("{} has one point only, so no line is drawn; `--csv` writes the point", curve.label)
    };
    figure.notes.extend(single.map(note));
    Ok(figure)
}
