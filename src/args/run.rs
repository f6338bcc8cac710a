//! A run, and its reports.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;
use depthloom_runner::Audit;

use super::compare::parse_confidence;
use super::{ExecArgs, ExperimentArgs, JsonArgs, RunArg};
use crate::completion::folders;

#[derive(Debug, Args)]
#[command(after_help = examples![
    "run experiments/table1.yaml" => "into runs/table1/<UTC time>",
    "run first.yaml --out look --overwrite" => "into look, in place of the run there",
    "run first.yaml --set sources.street.with.frames=0..2" => "with something set otherwise",
    "run first.yaml --json | jq .report.table" => "for programs",
])]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// The folder to write; by default `runs/<experiment>/<UTC time>`.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Replace the output folder if it holds a run that is over.
    #[arg(long)]
    pub overwrite: bool,

    /// Make everything anew: take nothing from earlier runs, and do not go on with one that did not come to its end. So
    /// does DEPTHLOOM_FRESH=1 in the environment.
    #[arg(long)]
    pub fresh: bool,

    /// Recompute reused values and compare them: `sample` (default) recomputes one frame in fifty and at least one
    /// value of every reused node, `all` every reused value, trained networks included, `none` nothing. A difference
    /// fails the run.
    #[arg(
        long,
        value_enum,
        value_name = "WHAT",
        default_value = "sample",
        hide_default_value = true,
        hide_possible_values = true
    )]
    pub audit: AuditMode,

    /// Wait for the disk after every frame, so that a power cut costs no frame that was written either.
    #[arg(long)]
    pub durable: bool,

    /// Worker threads; by default one a core. Never changes a result.
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    /// Frames in flight at most; by default two more than workers. Bounds memory, never changes a result.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub window: Option<u16>,

    #[command(flatten)]
    pub exec: ExecArgs,

    /// Continue after a frame failed: what depends on it is left out, and means are taken over the frames common to
    /// all. An ordered node that failed is not run on later frames; one with aggregate outputs ends the run.
    #[arg(long)]
    pub keep_going: bool,

    /// Print the paper's Table I beside the table.
    #[arg(long)]
    pub paper: bool,

    /// Write `samples.parquet`, too: one row per scored pixel, for `depthloom analyse` and for programs.
    #[arg(long)]
    pub samples: bool,

    #[command(flatten)]
    pub page: PageArgs,

    /// Print the run's folder and nothing else.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    #[command(flatten)]
    pub output: JsonArgs,
}

/// How much of what is reused is recomputed.
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

impl RunArgs {
    /// Whether nothing is taken from earlier runs.
    pub(crate) fn is_fresh(&self) -> bool {
        self.fresh || std::env::var_os("DEPTHLOOM_FRESH").is_some_and(|told| !told.is_empty() && told != "0")
    }
}

/// What becomes of `report.html`.
#[derive(Debug, Args)]
pub(crate) struct PageArgs {
    /// Leave out `report.html`: table, figures, pictures of frames and the plan on one page, for a browser. It has at
    /// most 40 MB: of long runs fewer frames (200) and smaller pictures, of many variants the best, and says so.
    #[arg(long)]
    pub no_page: bool,

    /// Open `report.html` in the browser ($BROWSER, or the system's).
    #[arg(long, conflicts_with = "no_page")]
    pub open: bool,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "report runs/first/2026-11-21T08-30-05Z" => "its tables and plots again",
    "report look.partial --out salvaged" => "of a run that did not come to its end",
])]
pub(crate) struct ReportArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// The folder to write tables and plots to; by default the run's own.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Print the paper's Table I beside the table.
    #[arg(long)]
    pub paper: bool,

    /// An interval beside each score: of the mean over frames, or over pixels, by resampling frames (BCa bootstrap,
    /// 100,000 resamples); 95 %, or so many per cent. CSV and Parquet have its ends as `SCORE_low` and `SCORE_high`.
    #[arg(long, value_name = "PERCENT", num_args = 0..=1, require_equals = true, default_missing_value = "95", value_parser = parse_confidence)]
    pub ci: Option<f64>,

    #[command(flatten)]
    pub page: PageArgs,

    #[command(flatten)]
    pub output: JsonArgs,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "timings runs/first/2026-11-21T08-30-05Z" => "what to make faster",
])]
pub(crate) struct TimingsArgs {
    #[command(flatten)]
    pub run: RunArg,

    #[command(flatten)]
    pub output: JsonArgs,
}
