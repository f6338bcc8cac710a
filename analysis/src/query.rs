//! Errors binned by distance, confidence, row, frame or any other column, as queries over [samples](crate::samples).
//!
//! polars reads the file; [sums](sums) and [percentiles](percentiles) are own loops, which a benchmark compares with
//! polars. Both read one row group at a time, so that memory use depends on neither frames nor pixels. The [error
//! against distance](crate::distance) of a report uses these percentiles.

mod bins;
mod job;
mod numbers;
mod percentiles;
mod rows;
mod scan;
mod sums;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

pub use bins::Bins;
pub(crate) use bins::Edges;
use clap::ValueEnum;
use depthloom_graphs::Key;
use depthloom_graphs::key::KeyBuilder;
use depthloom_graphs::language::glob;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::Recording;
pub(crate) use numbers::numbers;
pub(crate) use percentiles::{Memory, OUTSIDE, Pass, Tally, percentiles, place};
pub(crate) use scan::{scan, threads};

use crate::ablation::{Selection, selected_frames};
use crate::error::{AnalysisError, caught};
use crate::input::frame_choice::FrameChoice;
use crate::samples::{Described, DescribedEstimate, Part, SamplesFile};
use crate::tables::COMMON;
use crate::tables::Table;
use job::Job;

/// A query of the errors of samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Inquiry {
    /// The quantity that errors are binned by.
    pub by: By,
    /// The bins; `None`: the default bins of the quantity.
    pub bins: Option<Bins>,
    /// The percentiles, from 0 to 100.
    pub percentiles: Vec<f64>,
    /// Only estimates whose label or name matches; `*` matches any characters, and commas separate several patterns.
    pub estimates: Option<String>,
    /// Only these variants, and everything that all variants share.
    pub variants: Option<String>,
    /// Only these stages.
    pub stages: Option<String>,
    /// The pixel sets, in this order.
    pub sets: Vec<SampleSet>,
    /// The unit of errors.
    pub unit: Unit,
    /// The limit beyond which an error is an outlier.
    pub outlier: Outlier,
    /// The frames of each samples file; `None`: all.
    pub frames: Option<Vec<FramesOfRun>>,
}

impl Default for Inquiry {
    /// By distance in bins of one metre; the five percentiles of the paper's figure; over the valid pixels of each
    /// estimate; in metres; errors beyond a quarter of the distance are outliers.
    fn default() -> Self {
        Self {
            by: By::Distance,
            bins: None,
            percentiles: vec![5.0, 25.0, 50.0, 75.0, 95.0],
            estimates: None,
            variants: None,
            stages: None,
            sets: vec![SampleSet::Valid],
            unit: Unit::Metres,
            outlier: Outlier::OfTruth(0.25),
            frames: None,
        }
    }
}

/// The selected frames of a samples file: stage, position and id, because joined sources may repeat an id.
pub type FramesOfRun = BTreeSet<(String, u32, String)>;

/// The selected frames of a recording, as a query of its samples expects them.
///
/// # Errors
/// If no frame is selected, or a selected frame does not exist.
pub fn frames_of(recording: &Recording, choice: &FrameChoice) -> Result<FramesOfRun, AnalysisError> {
    let selection = Selection { frames: Some(choice.clone()), ..Selection::default() };
    let frames = selected_frames(recording, &selection)?.unwrap_or_default();
    let named = |(run, position): (RunId, FrameIndex)| {
        let id = recording.frames(run)[position.0].id.to_string();
        // Samples name the stage and, if sources differ between variants, the variant.
        (recording.plan().runs[run].name().to_owned(), position.0 as u32, id)
    };
    Ok(frames.into_iter().map(named).collect())
}

/// The quantity that samples are binned by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum By {
    /// The ground-truth distance, metres.
    Distance,
    /// The estimated distance, metres.
    Estimate,
    /// The absolute error of the estimate, in the unit of the query.
    Error,
    /// The confidence recorded for the estimate's variant.
    Weight,
    /// The pixel's row, from the top.
    Row,
    /// The pixel's column, from the left.
    Column,
    /// The frame: one bin per frame.
    Frame,
    /// A column of the samples.
    Named(String),
}

impl By {
    /// Parses `distance`, `estimate`, `error`, `weight`, `row`, `column`, `frame`, or the name of a column.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        match text {
            "distance" | "ground_truth_m" => Self::Distance,
            "estimate" => Self::Estimate,
            "error" => Self::Error,
            "weight" => Self::Weight,
            "row" | "y" => Self::Row,
            "column" | "x" => Self::Column,
            "frame" => Self::Frame,
            name => Self::Named(name.to_owned()),
        }
    }
}

/// The pixel set of a query.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SampleSet {
    /// The valid pixels of each estimate.
    Valid,
    /// The pixels that are valid in all selected estimates with the same scoring.
    Common,
}

impl SampleSet {
    /// The name, as in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Valid => "valid",
            Self::Common => COMMON,
        }
    }
}

/// The unit of errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// `y - t`, metres.
    Metres,
    /// `(y - t) / t`.
    OfTruth,
}

/// The limit beyond which an error is an outlier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outlier {
    /// A limit in metres.
    Metres(f64),
    /// A limit as a share of the ground-truth distance.
    OfTruth(f64),
}

impl Outlier {
    /// Parses `3m` or `25%`.
    ///
    /// # Errors
    /// If the text is not a limit.
    pub fn parse(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|limit| limit.is_finite() && *limit > 0.0);
        let limit = match (text.strip_suffix('%'), text.strip_suffix('m')) {
            (Some(share), _) => number(share).map(|share| Self::OfTruth(share / 100.0)),
            (None, Some(metres)) => number(metres).map(Self::Metres),
            (None, None) => None,
        };
        limit.ok_or_else(|| format!("`{text}` is not a limit: use metres (`3m`) or a share of the distance (`25%`)"))
    }

    fn words(self) -> String {
        match self {
            Self::Metres(limit) => format!("beyond {limit} m"),
            Self::OfTruth(limit) => format!("beyond {} % of the ground-truth distance", 100.0 * limit),
        }
    }
}

/// Computes the query over samples files, each with the name of its run. Also returns the key of the run's plan, or a
/// combined key of all runs. `progress` is called with the number of samples read so far, and their total.
///
/// # Errors
/// [`AnalysisError::Request`] if the query names something that does not exist, or a file is not a samples file; if a
/// file cannot be read; [`AnalysisError::Stopped`] once `stop` returns true.
pub fn analyse(
    files: &[(String, PathBuf)],
    inquiry: &Inquiry,
    progress: &(dyn Fn(u64, u64) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Table, Key), AnalysisError> {
    analyse_frames(files, inquiry, progress, stop).map(|(grid, key, _)| (grid, key))
}

/// The same, with the number of frames.
pub(crate) fn analyse_frames(
    files: &[(String, PathBuf)],
    inquiry: &Inquiry,
    progress: &(dyn Fn(u64, u64) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Table, Key, usize), AnalysisError> {
    caught(|| {
        if let Some(percentile) = inquiry.percentiles.iter().find(|percentile| !(0.0..=100.0).contains(*percentile)) {
            let what = format!("percentile {percentile} is out of range");
            return Err(AnalysisError::request(what, "use numbers from 0 to 100".to_owned()));
        }
        let opened: Result<Vec<(&str, SamplesFile)>, AnalysisError> =
            files.iter().map(|(run, path)| Ok((run.as_str(), SamplesFile::open(path)?))).collect();
        let opened = opened?;
        let mut jobs = Vec::new();
        for (place, (run, file)) in opened.iter().enumerate() {
            let frames = inquiry.frames.as_ref().map(|frames| &frames[place]);
            jobs.extend(jobs_of(run, file, inquiry, frames)?);
        }
        if jobs.is_empty() {
            return Err(no_samples(&opened, inquiry));
        }
        let all: u64 = jobs.iter().map(Job::samples).sum();
        let mut results = Vec::new();
        let mut before = 0;
        for job in &jobs {
            results.push(job.compute(inquiry, &|done| progress(before + done, all), stop)?);
            before += job.samples();
        }
        let grid = rows::grid(&jobs, &results, inquiry, files.len() > 1);
        let runs: Vec<Key> = opened.iter().filter_map(|(_, file)| file.described.run()).collect();
        let run = match runs[..] {
            [one] => one,
            _ => runs.iter().fold(Key::digest("depthloom runs"), KeyBuilder::key).finish(),
        };
        // The stages of a run usually have the same frames.
        let frames_of_run = |run: &str| jobs.iter().filter(|job| job.run == run).map(Job::frames).max().unwrap_or(0);
        let frames = opened.iter().map(|(run, _)| frames_of_run(run)).sum();
        Ok((grid, run, frames))
    })
}

/// The jobs of a query: one per stage, scoring, pixel set and binning column.
fn jobs_of<'a>(
    run: &'a str,
    file: &'a SamplesFile,
    inquiry: &Inquiry,
    frames: Option<&FramesOfRun>,
) -> Result<Vec<Job<'a>>, AnalysisError> {
    let mut populations: Vec<(&str, &str, Vec<&Part>)> = Vec::new();
    for part in file.parts.iter().filter(|part| part.is_selected(frames)) {
        match populations.iter_mut().find(|(stage, scoring, _)| *stage == &*part.stage && *scoring == &*part.scoring) {
            Some((.., parts)) => parts.push(part),
            None => populations.push((&part.stage, &part.scoring, vec![part])),
        }
    }
    let mut jobs = Vec::new();
    for (stage, scoring, parts) in populations {
        let is_selected = |estimate: &&DescribedEstimate| {
            let matches = |patterns: &Option<String>, texts: &[&str]| {
                patterns.as_deref().is_none_or(|patterns| is_any(patterns, texts))
            };
            estimate.stage == stage
                && estimate.scoring == scoring
                && matches(&inquiry.stages, &[stage])
                && estimate.variant.as_deref().is_none_or(|variant| matches(&inquiry.variants, &[variant]))
                && matches(&inquiry.estimates, &[&estimate.label, &estimate.estimate])
        };
        let estimates: Vec<&DescribedEstimate> = file.described.estimates.iter().filter(is_selected).collect();
        // Estimates grouped by their binning column.
        let mut by_column: Vec<(Option<String>, Vec<usize>)> = Vec::new();
        for (place, estimate) in estimates.iter().enumerate() {
            let Some(column) = column_of(&inquiry.by, estimate, &file.described)? else { continue };
            match by_column.iter_mut().find(|(known, _)| *known == column) {
                Some((_, places)) => places.push(place),
                None => by_column.push((column, vec![place])),
            }
        }
        for &set in &inquiry.sets {
            for (column, places) in &by_column {
                jobs.push(Job {
                    run,
                    file,
                    parts: parts.clone(),
                    estimates: estimates.clone(),
                    reported: places.clone(),
                    by: column.clone(),
                    set,
                });
            }
        }
    }
    Ok(jobs)
}

/// Whether one of the patterns, separated by commas, matches one of the texts.
pub(crate) fn is_any(patterns: &str, texts: &[&str]) -> bool {
    patterns.split(',').any(|pattern| texts.iter().any(|text| glob(pattern.trim(), text)))
}

/// The binning column of an estimate. Binning by frame has no column (`Some(None)`); an estimate without a recorded
/// confidence is excluded (`None`).
fn column_of(
    by: &By,
    estimate: &DescribedEstimate,
    described: &Described,
) -> Result<Option<Option<String>>, AnalysisError> {
    Ok(Some(Some(match by {
        By::Frame => return Ok(Some(None)),
        By::Distance => "ground_truth_m".to_owned(),
        By::Row => "y".to_owned(),
        By::Column => "x".to_owned(),
        By::Estimate | By::Error => estimate.column.clone(),
        By::Named(name) => {
            let columns = || {
                let estimates = described.estimates.iter().map(|estimate| estimate.column.as_str());
                estimates.chain(described.weights.iter().map(|weight| weight.column.as_str()))
            };
            if !columns().any(|column| column == name) {
                let all: Vec<&str> = columns().collect();
                let what = format!("samples have no column `{name}`");
                let help = "available: distance, estimate, error, weight, row, column, frame";
                return Err(AnalysisError::request(what, format!("{help}, and {}", all.join(", "))));
            }
            name.clone()
        }
        By::Weight => {
            let stage_weights = || described.weights.iter().filter(|weight| weight.stage == estimate.stage);
            let own: Vec<&str> = stage_weights()
                .filter(|weight| weight.variant == estimate.variant)
                .map(|weight| weight.column.as_str())
                .collect();
            let shared =
                || stage_weights().filter(|weight| weight.variant.is_none()).map(|weight| weight.column.as_str());
            let candidates = if own.is_empty() { shared().collect() } else { own };
            match candidates[..] {
                [] => return Ok(None),
                [one] => one.to_owned(),
                _ => {
                    let what = format!("{} has several confidence columns: {}", estimate.label, candidates.join(", "));
                    return Err(AnalysisError::request(
                        what,
                        format!("choose one, for example `--by {}`", candidates[0]),
                    ));
                }
            }
        }
    })))
}

/// The error for a query without samples.
fn no_samples(files: &[(&str, SamplesFile)], inquiry: &Inquiry) -> AnalysisError {
    let labels =
        files.iter().flat_map(|(_, file)| file.described.estimates.iter().map(|estimate| estimate.label.as_str()));
    let mut labels: Vec<&str> = labels.collect();
    labels.sort_unstable();
    labels.dedup();
    let has_weights = files.iter().any(|(_, file)| !file.described.weights.is_empty());
    let (what, help) = if files.iter().all(|(_, file)| file.parts.is_empty()) {
        (
            "there are no samples: no frame has a scored pixel with ground truth".to_owned(),
            "`depthloom check --data` describes the ground truth of a source".to_owned(),
        )
    } else if inquiry.frames.is_some() {
        (
            "no selected frame has a sample of the selected estimates".to_owned(),
            "choose other frames with `--frames`".to_owned(),
        )
    } else if inquiry.by == By::Weight && !has_weights {
        (
            "no confidence was recorded, which `--by weight` needs".to_owned(),
            "add its node to `record:`, and run again".to_owned(),
        )
    } else {
        let (estimates, variants) = (&inquiry.estimates, &inquiry.variants);
        let options = [("estimate", estimates), ("variant", variants), ("stage", &inquiry.stages)];
        let selections =
            options.iter().filter_map(|(what, patterns)| Some(format!("{what} `{}`", patterns.as_deref()?)));
        let selections: Vec<String> = selections.collect();
        (format!("no samples match {}", selections.join(", ")), format!("available: {}", labels.join(", ")))
    };
    AnalysisError::request(what, help)
}

/// Whether a file contains the samples of a recording in its current state.
///
/// # Errors
/// If the file cannot be read.
pub fn samples_match(file: &Path, recording: &Recording) -> Result<bool, AnalysisError> {
    caught(|| match SamplesFile::open(file) {
        Ok(file) => Ok(file.described.matches(recording)),
        Err(AnalysisError::Request { .. } | AnalysisError::Compute { .. }) => Ok(false),
        Err(error) => Err(error),
    })
}
