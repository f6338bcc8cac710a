//! Options of `run` and `report`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;
use depthloom_analysis::PageOptions;
use depthloom_jobs::Fraction;
use depthloom_runner::Audit;

use super::compare::parse_confidence;
use super::{ExecArgs, ExperimentArgs, JsonArgs, RunArg, RunsFolder};
use crate::completion::folders;

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "tutorial/first-run.md",
    "run first.yaml" => "write runs/first/<UTC time>",
    "run first.yaml --out look --overwrite" => "write look, and replace the run there",
    "run first.yaml --set sources.street.with.frames=0..2" => "with another value",
    "run first.yaml --shard 1/2" => "one of two shards, for two machines",
    "run first.yaml --json | jq .report.table" => "for programs",
])]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// Write to this folder (default: `<runs>/<experiment>/<UTC time>`).
    ///
    /// `<runs>` is the folder of `--runs`. Repeat a command with the same folder to resume an interrupted run.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Replace the output folder if it holds a run, finished or not.
    #[arg(long)]
    pub overwrite: bool,

    /// Recompute everything: reuse nothing, resume nothing.
    ///
    /// DEPTHLOOM_FRESH=1 in the environment has the same effect.
    #[arg(long)]
    pub fresh: bool,

    /// Recompute and compare reused values: `sample` (default), `all`, `none`.
    ///
    /// `sample` recomputes one frame in fifty, and at least one value of every reused node. `all` recomputes every
    /// reused value, trained networks included. A difference fails the run.
    #[arg(
        long,
        value_enum,
        value_name = "VALUES",
        default_value = "sample",
        hide_default_value = true,
        hide_possible_values = true
    )]
    pub audit: AuditMode,

    /// Wait for the disk after every frame.
    ///
    /// After a power cut, no frame that was written is lost.
    #[arg(long)]
    pub durable: bool,

    /// Set the number of worker threads (default: number of cores).
    ///
    /// It never changes a result.
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    /// Limit the frames in flight (default: workers + 2).
    ///
    /// It bounds memory, and never changes a result.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub window: Option<u16>,

    #[command(flatten)]
    pub exec: ExecArgs,

    /// Continue after a frame failed.
    ///
    /// What depends on the frame is left out, and means use the frames common to all. An ordered node that failed does
    /// not run on later frames; one with aggregate outputs ends the run.
    #[arg(long)]
    pub keep_going: bool,

    /// Print Table I of Martins et al. (2018) next to the table.
    #[arg(long)]
    pub paper: bool,

    /// Also write `samples.parquet`: one row per scored pixel.
    ///
    /// `depthloom analyse` and other programs read it.
    #[arg(long)]
    pub samples: bool,

    /// Compute one of N shards of the run: 2/4.
    ///
    /// A shard computes the pure nodes of the K-th of N blocks of frames, and writes them to
    /// `<runs>/<experiment>/shards`. Start all shards, on any machines that share the folder of runs, then `run`
    /// without this option: it reuses them, computes what needs all frames, scores and reports. `submit` does all of
    /// this on a cluster.
    #[arg(long, value_name = "K/N", conflicts_with_all = ["out", "fresh", "samples", "paper", "no_page", "page_frames", "open", "json"])]
    pub shard: Option<Fraction>,

    /// Split by `frames` (default), or by `variants`, whose ordered and aggregate nodes run too.
    #[arg(
        long,
        value_enum,
        value_name = "WHAT",
        default_value = "frames",
        hide_default_value = true,
        hide_possible_values = true,
        requires = "shard"
    )]
    pub by: SplitBy,

    /// Fail if a shard of the run is missing or damaged, instead of computing it.
    #[arg(long, conflicts_with_all = ["shard", "fresh"])]
    pub require_shards: bool,

    #[command(flatten)]
    pub page: PageArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    /// Print only the run's folder.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    #[command(flatten)]
    pub output: JsonArgs,
}

/// What a run is split by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum SplitBy {
    /// Blocks of frames.
    #[default]
    Frames,
    /// Blocks of variants.
    Variants,
}

/// Which reused values are recomputed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum AuditMode {
    /// Every reused value, trained networks included.
    All,
    /// One frame in fifty, and at least one value of every reused node.
    #[default]
    Sample,
    /// Nothing.
    None,
}

impl From<AuditMode> for Audit {
    fn from(mode: AuditMode) -> Self {
        match mode {
            AuditMode::All => Self::All,
            AuditMode::Sample => Self::Sample,
            AuditMode::None => Self::None,
        }
    }
}

impl PageArgs {
    /// The options of the page.
    pub(crate) fn options(&self) -> PageOptions {
        PageOptions { frames: self.page_frames.map(|frames| frames as usize) }
    }
}

impl RunArgs {
    /// Whether nothing is reused from earlier runs.
    pub(crate) fn is_fresh(&self) -> bool {
        self.fresh || is_fresh_everywhere()
    }
}

/// Whether DEPTHLOOM_FRESH is set: nothing is reused from earlier runs.
pub(crate) fn is_fresh_everywhere() -> bool {
    std::env::var_os("DEPTHLOOM_FRESH").is_some_and(|value| !value.is_empty() && value != "0")
}

/// Options of `report.html`.
#[derive(Clone, Debug, Args)]
pub(crate) struct PageArgs {
    /// Do not write `report.html`.
    ///
    /// The page has the table, figures, images of frames and the plan, for a browser. It has at most 40 MB. A page of a
    /// long run shows some of the frames, a page of many variants has the best ones; it states this.
    #[arg(long)]
    pub no_page: bool,

    /// Show images of this many frames in `report.html` (default: 12, and a tenth of those beyond 12; at most 200).
    ///
    /// Half of them are the worst and the best frames of the estimates with images, by `abs_rel` or the metric that
    /// leads without it; the others are evenly spaced. The more frames, the smaller the images, so that the page has
    /// at most 40 MB.
    #[arg(long, value_name = "COUNT", conflicts_with = "no_page", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub page_frames: Option<u32>,

    /// Open `report.html` in the browser ($BROWSER, or the default one).
    #[arg(long, conflicts_with = "no_page")]
    pub open: bool,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "tutorial/reading-the-report.md",
    "report @latest" => "recreate its tables, plots and page",
    "report look.partial --out salvaged" => "report the complete frames of an interrupted run",
])]
pub(crate) struct ReportArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// Write tables and plots to this folder (default: that of the run).
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Print Table I of Martins et al. (2018) next to the table.
    #[arg(long)]
    pub paper: bool,

    /// Add a confidence interval to each metric (default: 95 per cent).
    ///
    /// The interval is that of the mean over frames, or over pixels, by resampling frames (BCa bootstrap, 100,000
    /// resamples). CSV and Parquet have its ends as `METRIC_low` and `METRIC_high`.
    #[arg(long, value_name = "PERCENT", num_args = 0..=1, require_equals = true, default_missing_value = "95", value_parser = parse_confidence)]
    pub ci: Option<f64>,

    #[command(flatten)]
    pub page: PageArgs,

    #[command(flatten)]
    pub output: JsonArgs,
}
