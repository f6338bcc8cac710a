//! Errors against anything: distance, weight, row, frame, or a column of one's own choice, as queries over
//! [samples](crate::samples).
//!
//! polars reads the file; [sums](sums) and [percentiles](percentiles) are loops of our own, which a benchmark compares
//! with polars'. Both go through the file a row group at a time, so that memory depends on neither frames nor pixels.
//! The [error against distance](crate::distance) of a report takes its percentiles from here.

mod bins;
mod job;
mod numbers;
mod percentiles;
mod rows;
mod scan;
mod sums;

use std::path::{Path, PathBuf};

pub use bins::Bins;
pub(crate) use bins::Edges;
use clap::ValueEnum;
use depthloom_graphs::Key;
use depthloom_graphs::key::KeyBuilder;
use depthloom_graphs::language::glob;
pub(crate) use numbers::numbers;
pub(crate) use percentiles::{Memory, OUTSIDE, Pass, Tally, percentiles, place};
pub(crate) use scan::scan;

use crate::error::{AnalysisError, caught};
use crate::samples::{Described, DescribedEstimate, Part, SamplesFile};
use crate::tables::COMMON;
use crate::tables::Table;
use job::Job;

/// What the errors of samples are asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Inquiry {
    /// What they are put into bins by.
    pub by: By,
    /// The bins; `None` for those that suit what they are by.
    pub bins: Option<Bins>,
    /// Which percentiles, from 0 to 100.
    pub percentiles: Vec<f64>,
    /// Only estimates whose label or name this is; `*` stands for any run of characters, and commas stand between
    /// several.
    pub estimates: Option<String>,
    /// Only what these variants have, and what all share.
    pub variants: Option<String>,
    /// Only these stages.
    pub stages: Option<String>,
    /// Over which pixels, in this order.
    pub sets: Vec<SampleSet>,
    /// What an error is in.
    pub unit: Unit,
    /// From where on one is gross.
    pub gross: Gross,
}

impl Default for Inquiry {
    /// By distance, a metre a bin; the five percentiles of the paper's figure, over the valid pixels of each estimate,
    /// in metres; a quarter of the distance is gross.
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
            gross: Gross::OfTruth(0.25),
        }
    }
}

/// What samples are put into bins by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum By {
    /// The true distance, metres.
    Distance,
    /// The estimate's own answer, metres.
    Estimate,
    /// The estimate's own absolute error, in the inquiry's unit.
    Error,
    /// The weight recorded for the estimate's variant.
    Weight,
    /// The pixel's row, from the top.
    Row,
    /// The pixel's column, from the left.
    Column,
    /// The frame: a bin a frame.
    Frame,
    /// A column of the samples.
    Named(String),
}

impl By {
    /// Reads `distance`, `estimate`, `error`, `weight`, `row`, `column`, `frame`, or the name of a column.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        match text {
            "distance" | "truth_m" => Self::Distance,
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

/// The pixels that samples are of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SampleSet {
    /// Those valid in the estimate.
    Valid,
    /// Those valid in all selected estimates that were scored in the same way.
    Common,
}

impl SampleSet {
    /// As tables have it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Valid => "valid",
            Self::Common => COMMON,
        }
    }
}

/// What an error is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// `y - t`, metres.
    Metres,
    /// `(y - t) / t`.
    OfTruth,
}

/// From where on an error is gross.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gross {
    /// Beyond so many metres.
    Metres(f64),
    /// Beyond such a share of the truth.
    OfTruth(f64),
}

impl Gross {
    /// Reads `3m` or `25%`.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|limit| limit.is_finite() && *limit > 0.0);
        let limit = match (text.strip_suffix('%'), text.strip_suffix('m')) {
            (Some(share), _) => number(share).map(|share| Self::OfTruth(share / 100.0)),
            (None, Some(metres)) => number(metres).map(Self::Metres),
            (None, None) => None,
        };
        limit.ok_or_else(|| format!("`{text}` is no limit: give metres (`3m`) or a share of the distance (`25%`)"))
    }

    fn words(self) -> String {
        match self {
            Self::Metres(limit) => format!("beyond {limit} m"),
            Self::OfTruth(limit) => format!("beyond {} % of the true distance", 100.0 * limit),
        }
    }
}

/// Answers an inquiry about files of samples, each with its run's name; gives the key of the run's plan, too, or one of
/// all. `progress` is called with the samples read so far and all that will be.
///
/// # Errors
/// [`AnalysisError::Request`] if it names what is not there, or a file is none of samples; if a file cannot be read;
/// [`AnalysisError::Stopped`] once `stop` says so.
pub fn analyse(
    files: &[(String, PathBuf)],
    inquiry: &Inquiry,
    progress: &(dyn Fn(u64, u64) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Table, Key), AnalysisError> {
    valid(files, inquiry, progress, stop).map(|(grid, key, _)| (grid, key))
}

/// The same, and how many frames it is of.
pub(crate) fn valid(
    files: &[(String, PathBuf)],
    inquiry: &Inquiry,
    progress: &(dyn Fn(u64, u64) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Table, Key, usize), AnalysisError> {
    caught(|| {
        if let Some(percentile) = inquiry.percentiles.iter().find(|of| !(0.0..=100.0).contains(*of)) {
            let what = format!("there is no percentile {percentile}");
            return Err(AnalysisError::asked(what, "give numbers from 0 to 100".to_owned()));
        }
        let opened: Result<Vec<(&str, SamplesFile)>, AnalysisError> =
            files.iter().map(|(run, path)| Ok((run.as_str(), SamplesFile::open(path)?))).collect();
        let opened = opened?;
        let mut jobs = Vec::new();
        for (run, file) in &opened {
            jobs.extend(jobs_of(run, file, inquiry)?);
        }
        if jobs.is_empty() {
            return Err(nothing(&opened, inquiry));
        }
        let all: u64 = jobs.iter().map(Job::samples).sum();
        let mut found = Vec::new();
        let mut before = 0;
        for job in &jobs {
            found.push(job.answer(inquiry, &|done| progress(before + done, all), stop)?);
            before += job.samples();
        }
        let grid = rows::grid(&jobs, &found, inquiry, files.len() > 1);
        let runs: Vec<Key> = opened.iter().filter_map(|(_, file)| file.described.run()).collect();
        let run = match runs[..] {
            [one] => one,
            _ => runs.iter().fold(Key::digest("depthloom runs"), KeyBuilder::key).finish(),
        };
        // Stages of a run are of the same frames, as a rule.
        let of_run = |run: &str| jobs.iter().filter(|job| job.run == run).map(Job::frames).max().unwrap_or(0);
        let frames = opened.iter().map(|(run, _)| of_run(run)).sum();
        Ok((grid, run, frames))
    })
}

/// What is to be done: for each stage, way of scoring, pixel set and column that samples are put into bins by.
fn jobs_of<'a>(run: &'a str, file: &'a SamplesFile, inquiry: &Inquiry) -> Result<Vec<Job<'a>>, AnalysisError> {
    let mut populations: Vec<(&str, &str, Vec<&Part>)> = Vec::new();
    for part in &file.parts {
        match populations.iter_mut().find(|(stage, scoring, _)| *stage == &*part.stage && *scoring == &*part.scoring) {
            Some((.., parts)) => parts.push(part),
            None => populations.push((&part.stage, &part.scoring, vec![part])),
        }
    }
    let mut jobs = Vec::new();
    for (stage, scoring, parts) in populations {
        let asked = |of: &&DescribedEstimate| {
            let is = |patterns: &Option<String>, texts: &[&str]| {
                patterns.as_deref().is_none_or(|patterns| is_any(patterns, texts))
            };
            of.stage == stage
                && of.scoring == scoring
                && is(&inquiry.stages, &[stage])
                && of.variant.as_deref().is_none_or(|variant| is(&inquiry.variants, &[variant]))
                && is(&inquiry.estimates, &[&of.label, &of.estimate])
        };
        let estimates: Vec<&DescribedEstimate> = file.described.estimates.iter().filter(asked).collect();
        // Each estimate by its column.
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

/// Whether one of some texts is one of some patterns with commas between.
pub(crate) fn is_any(patterns: &str, texts: &[&str]) -> bool {
    patterns.split(',').any(|pattern| texts.iter().any(|text| glob(pattern.trim(), text)))
}

/// The column that an estimate's samples are put into bins by; of frames there is none (`Some(None)`), and an
/// estimate without a weight is left out (`None`).
fn column_of(
    by: &By,
    estimate: &DescribedEstimate,
    described: &Described,
) -> Result<Option<Option<String>>, AnalysisError> {
    Ok(Some(Some(match by {
        By::Frame => return Ok(Some(None)),
        By::Distance => "truth_m".to_owned(),
        By::Row => "y".to_owned(),
        By::Column => "x".to_owned(),
        By::Estimate | By::Error => estimate.column.clone(),
        By::Named(name) => {
            let columns = || {
                let of_estimates = described.estimates.iter().map(|of| of.column.as_str());
                of_estimates.chain(described.weights.iter().map(|of| of.column.as_str()))
            };
            if !columns().any(|column| column == name) {
                let all: Vec<&str> = columns().collect();
                let what = format!("samples have no column `{name}`");
                let help = "there are distance, estimate, error, weight, row, column, frame";
                return Err(AnalysisError::asked(what, format!("{help}, and {}", all.join(", "))));
            }
            name.clone()
        }
        By::Weight => {
            let of_stage = || described.weights.iter().filter(|weight| weight.stage == estimate.stage);
            let own: Vec<&str> = of_stage()
                .filter(|weight| weight.variant == estimate.variant)
                .map(|weight| weight.column.as_str())
                .collect();
            let shared = || of_stage().filter(|weight| weight.variant.is_none()).map(|weight| weight.column.as_str());
            let candidates = if own.is_empty() { shared().collect() } else { own };
            match candidates[..] {
                [] => return Ok(None),
                [one] => one.to_owned(),
                _ => {
                    let what = format!("{} has several weights: {}", estimate.label, candidates.join(", "));
                    return Err(AnalysisError::asked(what, format!("name one: `--by {}`", candidates[0])));
                }
            }
        }
    })))
}

/// Why there is nothing to be asked.
fn nothing(files: &[(&str, SamplesFile)], inquiry: &Inquiry) -> AnalysisError {
    let labels = files.iter().flat_map(|(_, file)| file.described.estimates.iter().map(|of| of.label.as_str()));
    let mut labels: Vec<&str> = labels.collect();
    labels.sort_unstable();
    labels.dedup();
    let has_weights = files.iter().any(|(_, file)| !file.described.weights.is_empty());
    let (what, help) = if files.iter().all(|(_, file)| file.parts.is_empty()) {
        (
            "there are no samples: no frame has a pixel with a truth that is scored".to_owned(),
            "`depthloom check --data` says what a source's truth looks like".to_owned(),
        )
    } else if inquiry.by == By::Weight && !has_weights {
        ("no weight was recorded".to_owned(), "add its node to `record:`, and run again".to_owned())
    } else {
        let asked = [("", &inquiry.estimates), (" of a variant", &inquiry.variants), (" of a stage", &inquiry.stages)];
        let asked = asked.iter().filter_map(|(what, asked)| Some(format!("{what} `{}`", asked.as_deref()?)));
        let asked: Vec<String> = asked.map(|of| of.trim_start().to_owned()).collect();
        (format!("no estimate is {}", asked.join(", ")), format!("there are {}", labels.join(", ")))
    };
    AnalysisError::asked(what, help)
}

/// Whether a file holds the samples of a recording as it is.
///
/// # Errors
/// If the file cannot be read.
pub fn samples_are_of(file: &Path, recording: &depthloom_recording::Recording) -> Result<bool, AnalysisError> {
    caught(|| match SamplesFile::open(file) {
        Ok(file) => Ok(file.described.is_of(recording)),
        Err(AnalysisError::Request { .. } | AnalysisError::Compute { .. }) => Ok(false),
        Err(error) => Err(error),
    })
}
