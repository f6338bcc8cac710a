//! Options of `compare`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::{ArgValueCandidates, ArgValueCompleter};
use depthloom_analysis::{Bins, Grouping, IntervalMethod, Resampling};

use super::{RunsFolder, ScoresArgs, TableOutputArgs, TypesettingArgs};
use crate::completion::{metrics, runs};

/// How intervals are computed.
#[derive(Clone, Debug, Args)]
pub(crate) struct IntervalArgs {
    /// Set the confidence level of intervals and tests, per cent.
    #[arg(long, value_name = "PERCENT", default_value = "95", value_parser = parse_confidence)]
    pub confidence: f64,

    /// Compute intervals with this bootstrap method.
    #[arg(long, value_enum, value_name = "METHOD", default_value = "bca")]
    pub interval: IntervalMethod,

    /// Resample frames N times (default: 100,000).
    ///
    /// The default for errors by distance is 10,000.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    pub resamples: Option<u32>,

    /// Seed the resampling: equal seeds give equal intervals.
    #[arg(long, value_name = "N", default_value_t = 1)]
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
    (50.0..100.0)
        .contains(&percent)
        .then_some(percent / 100.0)
        .ok_or_else(|| "it must be from 50 to below 100".to_owned())
}

/// What errors are compared by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum CompareBy {
    /// The ground-truth distance: absolute errors of the pixels that are valid in both, bin by bin, and the distance
    /// from which the other side is better.
    Distance,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "explanation/comparison.md",
    "compare @latest base small_blocks" => "one variant with another, all metrics",
    "compare @latest '*/fused' --metrics abs_rel --baseline best" => "which estimates are as good as the best, and which are not",
    "compare first/one first/two" => "is the second run better than the first?",
    "compare @latest base/stereo base/mono --by distance" => "at which distances each of the two is better",
    "compare @latest base small_blocks --group blocks:2" => "blocks of frames of a video are resampled together",
    "compare first/one first/two --fail-if 'fused.abs_rel > +1%'" => "for CI: exit code 3 if it is worse",
    "compare first/one:base/fused first/two:base/fused --json" => "for programs",
])]
pub(crate) struct CompareArgs {
    /// Compare these runs, variants or estimates with the first of them
    ///
    /// - runs: a folder, a recording, a unique prefix of a name, or `@latest`
    /// - a run, then variants or estimates of it: `base`, `base/fused`, `'*/fused'`
    /// - `RUN:NAME`: a variant or estimate of another run
    ///
    /// For a run alone, all of its variants are compared, or its estimates if it has one variant only.
    #[arg(required = true, value_name = "RUN|NAME", verbatim_doc_comment, add = ArgValueCompleter::new(runs))]
    pub sides: Vec<PathBuf>,

    /// Compare with this side, or with the `best` (default: the first).
    ///
    /// `best` is the side with the best value of the first metric.
    #[arg(long, value_name = "SIDE")]
    pub baseline: Option<String>,

    #[command(flatten)]
    pub scores: ScoresArgs,

    /// Compare absolute errors by this quantity (default: compare metrics).
    ///
    /// The table has the mean and the median of each bin, and the distance from which the other side is better.
    #[arg(long, value_enum, value_name = "QUANTITY", conflicts_with_all = ["metrics", "fail_if", "zone", "mean"])]
    pub by: Option<CompareBy>,

    /// Set the bins of `--by distance` (default: `width:5`).
    ///
    /// They are `width:2`, `linear:20`, `log:20`, `quantile:10` or `edges:0,5,10,20,80`, in metres.
    #[arg(long, value_name = "BINS", value_parser = Bins::parse, requires = "by")]
    pub bins: Option<Bins>,

    /// Compare only these metrics (default: all that both sides have).
    ///
    /// Tests are corrected for the number of metrics shown.
    #[arg(long, value_name = "METRIC,...", value_delimiter = ',', add = ArgValueCandidates::new(metrics))]
    pub metrics: Vec<String>,

    /// Use only these estimates, by label or name (default: all).
    ///
    /// `*` matches any characters, and commas separate several: `fused`, `stereo,no_*/mono`.
    #[arg(long, value_name = "GLOB,...")]
    pub estimates: Option<String>,

    #[command(flatten)]
    pub intervals: IntervalArgs,

    /// Resample and rank groups of frames, e.g. `sequence` (default: each frame).
    ///
    /// Use it for video, whose frames are correlated: intervals over single frames are then too narrow.
    ///
    /// - `sequence`: a group ends where the folder in the frame's id changes, or where ids stop rising
    /// - `blocks:N`: N of the compared frames, in their order
    /// - a CSV file with the columns `frame,group`
    #[arg(long, value_name = "GROUPS", value_parser = Grouping::parse, conflicts_with = "by", verbatim_doc_comment)]
    pub group: Option<Grouping>,

    /// Fail if this limit is exceeded, e.g. `fused.abs_rel > +1%`. Can be repeated.
    ///
    /// More examples: `d1 >= 0.002`, `no_*/fused.a1 < -0.5%`. The limit is a change in per cent of the baseline's
    /// value, or in the unit of the metric. It applies to the estimates of that name, or to all. `density` is the share
    /// of valid pixels. The exit code is then 3.
    #[arg(long, value_name = "LIMIT")]
    pub fail_if: Vec<String>,

    #[command(flatten)]
    pub typesetting: TypesettingArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    #[command(flatten)]
    pub output: TableOutputArgs,
}
