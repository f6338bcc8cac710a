//! Figures for papers: of a stated size in millimetres, as SVG, PNG or PDF, with the numbers that they show.
//!
//! They take their numbers from where [`analyse`](crate::analyse()), [`compare`](crate::compare()), the table and the report take theirs.

mod asked;
mod difference;
mod errors;
mod maps;
mod parameter;
mod scores;
mod spreads;

use std::path::PathBuf;

use clap::ValueEnum;
use depthloom_figures::{Drawing, Sheet};
use depthloom_recording::Recording;
use depthloom_scores::PixelSet;

pub use depthloom_figures::{Layout, Size};

use crate::analyse::{Bins, Gross, Inquiry, SampleSet, Unit};
use crate::curves::{learning_curves, table_of_points};
use crate::error::AnalysisError;
use crate::error::caught;
use crate::frame_choice::FrameChoice;
use crate::statistics::Resampling;
use asked::Watch;

/// A bin of fewer pixels is thin where nothing else is asked for.
pub(crate) const THIN: u64 = 100;
/// More panels than this are not read any more.
const MOST_PANELS: usize = 16;
/// How wide and how high a page is, millimetres.
const A4_WIDE_MM: f64 = 210.0;
const A4_MM: f64 = 297.0;
/// What a figure shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FigureKind {
    /// The paper's: median, 25 to 75 % and 5 to 95 % of the absolute error by true distance.
    ErrorVsDistance,
    /// How much farther off one estimator is than another, by distance, and where one hands over to the other.
    Difference,
    /// How often errors of which size are.
    Histogram,
    /// The share of pixels whose error is below what.
    Cdf,
    /// A score on every frame: a strip an estimator.
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
    /// Whether it is of samples, which are to be made first.
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
    /// Only estimators whose label or name is one of these patterns, with commas between.
    pub estimators: Option<String>,
    /// Only what these variants have, and what all share; patterns with commas between.
    pub variants: Option<String>,
    /// Only these stages; patterns with commas between.
    pub stages: Option<String>,
    /// Over which pixels errors are; `None`: those that all answered, and beside them all that each did.
    pub set: Option<SampleSet>,
    /// Over which pixels scores are, of `frames` and `parameter`; `None`: every true pixel, where those were scored.
    pub scored_set: Option<PixelSet>,
    /// What errors are by, where the kind does not say: [`By::parse`](crate::By::parse).
    pub by: Option<String>,
    /// The bins, as `analyse` takes them.
    pub bins: Option<Bins>,
    /// What errors are in.
    pub unit: Unit,
    /// A panel a variant, or one for all.
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
    /// How many pixels an inch a picture of a map has at most.
    pub dpi: f64,
}

impl FigureRequest {
    /// A figure of a kind with all that is usual.
    #[must_use]
    pub fn new(kind: FigureKind) -> Self {
        Self {
            kind,
            size: Size::default(),
            title: String::new(),
            estimators: None,
            variants: None,
            stages: None,
            set: None,
            scored_set: None,
            by: None,
            bins: None,
            unit: Unit::Metres,
            layout: Layout::default(),
            thin: THIN,
            most: None,
            score: None,
            axes: Vec::new(),
            frames: None,
            resampling: Resampling::default(),
            dpi: 300.0,
        }
    }

    /// What is asked of samples, but for bins and percentiles.
    fn inquiry(&self) -> Inquiry {
        Inquiry {
            sets: vec![self.set.unwrap_or(SampleSet::Common)],
            unit: self.unit,
            gross: Gross::OfTruth(0.25),
            ..Inquiry::default()
        }
    }

    /// That so many panels can be read.
    fn few_panels(&self, panels: usize) -> Result<(), AnalysisError> {
        if panels <= MOST_PANELS {
            return Ok(());
        }
        let what = format!("{panels} panels are more than {MOST_PANELS}");
        let help = "choose some with --variant or --estimators, or draw all on one with `--layout overlaid`";
        Err(AnalysisError::asked(what, help.to_owned()))
    }

    /// A sheet of the size that was asked for, drawn.
    fn sheet(&self, sheet: Sheet) -> Result<Drawing, AnalysisError> {
        let title = self.title.clone();
        let sheet = Sheet { width_pt: self.size.width_pt(), height_pt: self.size.height_pt(), title, ..sheet };
        sheet.drawing().map_err(wrong_size)
    }
}

/// That a figure does not fit its size.
fn wrong_size(what: String) -> AnalysisError {
    AnalysisError::asked(what, "ask for another --width or --height".to_owned())
}

/// A run that a figure is of.
#[derive(Debug)]
pub struct FigureRun<'a> {
    /// What it is called.
    pub called: &'a str,
    /// Its recording.
    pub recording: &'a Recording,
    /// Its samples, where the kind [is of them](FigureKind::is_of_samples).
    pub samples: Option<PathBuf>,
}

/// A figure, drawn.
#[derive(Clone, Debug)]
pub struct Figure {
    drawing: Drawing,
    about: String,
    data: Vec<u8>,
    notes: Vec<String>,
}

impl Figure {
    /// What it shows, over which pixels: the beginning of a caption, without a full stop.
    #[must_use]
    pub fn about(&self) -> &str {
        &self.about
    }

    /// What is to be said of it beside its caption.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Its width and height, millimetres.
    #[must_use]
    pub fn size_mm(&self) -> (f64, f64) {
        self.drawing.size_mm()
    }

    /// As SVG.
    #[must_use]
    pub fn svg(&self) -> Vec<u8> {
        self.drawing.svg().into_bytes()
    }

    /// As PDF of one page.
    #[must_use]
    pub fn pdf(&self) -> Vec<u8> {
        self.drawing.pdf(&self.about)
    }

    /// As PNG of so many pixels an inch.
    ///
    /// # Errors
    /// If these are too many.
    pub fn png(&self, dpi: f64) -> Result<Vec<u8>, AnalysisError> {
        let help = || "ask for fewer pixels with `--dpi`, or for SVG or PDF".to_owned();
        self.drawing.png(dpi).map_err(|what| AnalysisError::asked(what, help()))
    }

    /// The numbers that it shows, as CSV.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        &self.data
    }
}

/// Draws a figure of runs. `progress` is called with the samples read so far and all that will be.
///
/// # Errors
/// [`AnalysisError::Request`] if what is asked for is not there, or does not fit the size; if a recording or samples cannot be read;
/// [`AnalysisError::Stopped`] once `stop` says so.
pub fn figure(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    progress: &(dyn Fn(u64, u64) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, AnalysisError> {
    let watch = Watch { progress, stop };
    let mut figure = caught(|| match request.kind {
        FigureKind::ErrorVsDistance | FigureKind::Reliability => spreads::of_errors(runs, request, &watch),
        FigureKind::Histogram => errors::histogram(runs, request, &watch),
        FigureKind::Cdf => errors::cdf(runs, request, &watch),
        FigureKind::Frames => scores::frames(one_of(runs)?, request, stop),
        FigureKind::Parameter => parameter::parameter(one_of(runs)?, request, stop),
        FigureKind::Learning => learning(one_of(runs)?, request),
        FigureKind::Difference => difference::difference(runs, request, stop),
        FigureKind::Panels => maps::panels(one_of(runs)?, request, stop),
    })?;
    let (_, height_mm) = figure.size_mm();
    let is_for_a_page = request.size.width_mm <= A4_WIDE_MM && request.size.height_mm.is_none();
    if is_for_a_page && height_mm > A4_MM {
        let help = "show less of it, or make it narrower";
        figure.notes.push(format!("it is {height_mm:.0} mm high, more than a page of A4 has ({A4_MM:.0} mm): {help}"));
    }
    Ok(figure)
}

/// The only run.
fn one_of<'r, 'a>(runs: &'r [FigureRun<'a>]) -> Result<&'r FigureRun<'a>, AnalysisError> {
    match runs {
        [one] => Ok(one),
        _ => Err(AnalysisError::asked(
            "this kind of figure is of one run".to_owned(),
            "draw one of each; `error-vs-distance`, `difference`, `histogram`, `cdf` and `reliability` take several"
                .to_owned(),
        )),
    }
}

fn learning(run: &FigureRun<'_>, request: &FigureRequest) -> Result<Figure, AnalysisError> {
    let mut curves = learning_curves(run.recording)?;
    curves.retain(|curve| {
        let is = |patterns: &Option<String>, text: &str| {
            patterns.as_deref().is_none_or(|patterns| crate::analyse::is_any(patterns, &[text]))
        };
        is(&request.stages, &curve.lead.stage)
            && is(&request.estimators, &curve.node)
            && curve.lead.variant.as_deref().is_none_or(|variant| is(&request.variants, variant))
    });
    if curves.is_empty() {
        let (what, help) = ("there is no learning curve", "stages with a node `learn/ssl` have one");
        return Err(AnalysisError::asked(what.to_owned(), help.to_owned()));
    }
    request.few_panels(curves.len())?;
    let series: Vec<_> = curves.iter().map(|of| (of.label.as_str(), &of.curve)).collect();
    let drawing = depthloom_figures::learning_curves(&series, &request.title, request.size).map_err(wrong_size)?;
    let about = "Learning curves: mean loss since the last point, and validation on samples held out".to_owned();
    Ok(Figure { drawing, about, data: table_of_points(&curves).csv(), notes: Vec::new() })
}
