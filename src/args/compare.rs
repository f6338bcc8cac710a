//! Scores held against each other.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::{ArgValueCandidates, ArgValueCompleter};
use depthloom_analysis::{Bins, IntervalMethod, Resampling};

use super::{ScoresArgs, TableOutputArgs, TypesettingArgs};
use crate::completion::{metrics, runs};

/// How sure an interval is, and how it is found.
#[derive(Clone, Debug, Args)]
pub(crate) struct IntervalArgs {
    /// How sure an interval is, in per cent; tests are held against what is left to 100.
    #[arg(long, value_name = "PERCENT", default_value = "95", value_parser = parse_confidence)]
    pub confidence: f64,

    /// How an interval is read off the resamples.
    #[arg(long, value_enum, value_name = "METHOD", default_value = "bca")]
    pub interval: IntervalMethod,

    /// How often frames are resampled; by default 100,000 times for scores, 10,000 times for errors by distance.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    pub resamples: Option<u32>,

    /// The seed of the resamples: equal seeds give equal intervals, on any machine.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

impl IntervalArgs {
    /// The resampling of the analysis; `resamples` is the default number.
    pub(crate) fn resampling(&self, resamples: u32) -> Resampling {
        let resamples = self.resamples.unwrap_or(resamples);
        Resampling { resamples, seed: self.seed, confidence: self.confidence, method: self.interval }
    }
}

/// Reads a confidence in per cent.
pub(super) fn parse_confidence(text: &str) -> Result<f64, String> {
    let percent: f64 = text.trim_end_matches('%').trim().parse().map_err(|_| "it is not a number".to_owned())?;
    (50.0..100.0).contains(&percent).then_some(percent / 100.0).ok_or_else(|| "it lies from 50 to below 100".to_owned())
}

/// What errors are compared by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum CompareBy {
    /// The true distance: absolute errors of the pixels that are valid in both, bin by bin, and where one should hand
    /// over to the other.
    Distance,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "compare RUN full no_scaling" => "a variant against another, all scores",
    "compare RUN '*/fused' --scores abs_rel --baseline best" => "which are as good as the best, and which are not",
    "compare table1/2026-11-20 @latest" => "is the newest run better than that of another day?",
    "compare RUN stereo full/mono --by distance" => "where each is better, and where one hands over to the other",
    "compare main pr --fail-if 'fused.abs_rel > +1%'" => "for CI: exit code 3 if it is worse",
    "compare A:full/fused B:fused --set valid --json" => "for programs",
])]
pub(crate) struct CompareArgs {
    /// What is compared, the first being what the others are held against: runs (folders, recordings, beginnings of
    /// names, `@latest`); or a run, and variants or estimates of it (`full`, `full/fused`, `'*/fused'`); or
    /// `RUN:NAME`, of several runs. A run alone: all of its variants, or where it has none, estimates.
    #[arg(required = true, value_name = "RUN|NAME", add = ArgValueCompleter::new(runs))]
    pub sides: Vec<PathBuf>,

    /// What the others are held against, in place of the first: a side, or `best`, the one with the best value of the
    /// first score.
    #[arg(long, value_name = "SIDE")]
    pub baseline: Option<String>,

    #[command(flatten)]
    pub pixels: ScoresArgs,

    /// In place of scores the absolute error, by the true distance: mean and median of each bin, and the distance at
    /// which one of the two should hand over to the other.
    #[arg(long, value_enum, value_name = "WHAT", conflicts_with_all = ["scores", "fail_if", "zone", "mean", "frames"])]
    pub by: Option<CompareBy>,

    /// The bins of `--by distance`: `width:2`, `linear:20`, `log:20`, `quantile:10` or `edges:0,5,10,20,80`; by default
    /// five metres wide.
    #[arg(long, value_name = "BINS", value_parser = Bins::parse, requires = "by")]
    pub bins: Option<Bins>,

    /// Only these scores, with commas between; by default all that both have. Tests are corrected for as many as are
    /// shown.
    #[arg(long, value_name = "SCORE,...", value_delimiter = ',', add = ArgValueCandidates::new(metrics))]
    pub scores: Vec<String>,

    /// Only estimates whose label or name this is; `*` stands for any run of characters, several have commas between:
    /// `fused`, `stereo,no_*/mono`.
    #[arg(long, value_name = "GLOB,...")]
    pub estimates: Option<String>,

    #[command(flatten)]
    pub intervals: IntervalArgs,

    /// End with exit code 3 if this is so, e.g. `fused.abs_rel > +1%`, `d1 >= 0.002`, `no_*/fused.a1 < -0.5%`: a change
    /// in per cent of the baseline's value or in the score's unit, of the estimates of that name, or of all. `density`
    /// is the share of valid pixels. Can be given several times.
    #[arg(long, value_name = "LIMIT")]
    pub fail_if: Vec<String>,

    #[command(flatten)]
    pub typesetting: TypesettingArgs,

    #[command(flatten)]
    pub output: TableOutputArgs,
}
