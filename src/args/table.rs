//! Options of `table` and `explain`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::{ArgValueCandidates, ArgValueCompleter};
use depthloom_analysis::{FrameChoice, Grouping, Mean, PixelSet, Resampling, Selection, Typesetting};

use super::{JsonArgs, RunArg, RunsFolder, TableOutputArgs, compare::parse_confidence};
use crate::completion::{columns, metrics, runs};

/// The pixel set that metrics are computed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelsOption {
    /// Every pixel with ground truth.
    All,
    /// The pixels with ground truth on which an estimate is valid.
    Valid,
    /// For disparities: every pixel with ground truth, after invalid pixels are filled as in the benchmark.
    Filled,
    /// For depths, recomputed from recorded maps: the pixels with ground truth that are valid in all selected
    /// estimates.
    Common,
}

impl PixelsOption {
    /// The recorded pixel set; `None` for the one that is computed from recorded maps.
    pub(crate) const fn recorded(self) -> Option<PixelSet> {
        match self {
            Self::All => Some(PixelSet::All),
            Self::Valid => Some(PixelSet::Valid),
            Self::Filled => Some(PixelSet::Filled),
            Self::Common => None,
        }
    }
}

/// How the metrics of all frames become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MeanOption {
    /// The unweighted mean over frames.
    Frames,
    /// The mean over pixels, as if all frames were one image.
    Pixels,
}

/// The format of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TableFormat {
    /// Aligned text; `*` marks the best values.
    Terminal,
    /// Markdown, as GitHub shows it.
    Md,
    /// Comma-separated values: all digits, no marks.
    Csv,
    /// Parquet, with the columns of csv; not to a terminal: use --out or a pipe.
    Parquet,
    /// A LaTeX float for the package booktabs, in the font size of the document.
    Latex,
    /// One JSON object.
    Json,
}

/// Which metrics of a run are read.
#[derive(Debug, Args)]
pub(crate) struct ScoresArgs {
    /// Use this pixel set (default: `all`, if it was scored).
    #[arg(long, value_enum, value_name = "PIXELS")]
    pub pixels: Option<PixelsOption>,

    /// Use a zone that was scored, e.g. `10..20` (default: the whole image).
    #[arg(long, value_name = "ZONE")]
    pub zone: Option<String>,

    /// Use only these frames (default: all).
    ///
    /// They are numbers (`3`, `3,7`, `0..4`, `1..=40`), ids (`000150_10`), or a text file with one frame id per line.
    #[arg(long, value_name = "FRAMES", value_parser = FrameChoice::parse)]
    pub frames: Option<FrameChoice>,

    /// Average over frames or pixels (default: the experiment's `mean`).
    ///
    /// An experiment without `mean` averages over frames.
    #[arg(long, value_enum, value_name = "OVER")]
    pub mean: Option<MeanOption>,
}

impl ScoresArgs {
    /// The selection of the analysis.
    pub(crate) fn selection(&self) -> Selection {
        let mean = self.mean.map(|mean| match mean {
            MeanOption::Frames => Mean::Frames,
            MeanOption::Pixels => Mean::Pixels,
        });
        let (zone, frames) = (self.zone.clone(), self.frames.clone());
        let (common, set) = (self.pixels == Some(PixelsOption::Common), self.pixels.and_then(PixelsOption::recorded));
        Selection { common, set, zone, frames, mean, ..Selection::default() }
    }
}

/// How a table is typeset.
#[derive(Clone, Debug, Args)]
pub(crate) struct TypesettingArgs {
    /// Set the caption, as LaTeX (default: describes the numbers).
    #[arg(long, value_name = "TEXT")]
    pub caption: Option<String>,

    /// Set the LaTeX label after `tab:` (default: from the experiment).
    ///
    /// The default is the experiment's name and the kind of table.
    #[arg(long, value_name = "NAME", value_parser = parse_label)]
    pub label: Option<String>,

    /// Print metrics with N decimals (default: depends on the metric).
    ///
    /// It applies to text, Markdown and LaTeX; CSV, Parquet and JSON have all digits.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=15))]
    pub digits: Option<u8>,
}

/// A LaTeX label, without `tab:`.
fn parse_label(text: &str) -> Result<String, String> {
    let label = text.strip_prefix("tab:").unwrap_or(text);
    let is_wrong = |letter: &char| letter.is_whitespace() || letter.is_control() || "\\{}%#~^&$,".contains(*letter);
    match label.chars().find(is_wrong) {
        _ if label.is_empty() => Err("a LaTeX label cannot be empty".to_owned()),
        Some(letter) => Err(format!("a LaTeX label cannot contain `{}`", letter.escape_debug())),
        None => Ok(label.to_owned()),
    }
}

impl TypesettingArgs {
    /// The typesetting of the analysis.
    pub(crate) fn typesetting(&self) -> Typesetting {
        let Self { caption, label, digits } = self.clone();
        Typesetting { caption, label, decimals: digits.map(usize::from) }
    }
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/ask-a-run.md",
    "table @latest --sort abs_rel --top 10 --columns abs_rel,rmse,density,ms" => "the ten best settings",
    "table @latest --effects abs_rel" => "the effect of each axis of a matrix",
    "table @latest --best-per-zone abs_rel" => "which setting is best in which zone",
    "table @latest --effects ms" => "what each axis costs",
    "table @latest --pareto abs_rel,ms" => "the best trade-offs between error and time",
    "table @latest --columns abs_rel --ci --group blocks:2" => "intervals that resample blocks of frames of a video",
    "table @latest --top 8 --format latex --out variants.tex" => "for a paper",
])]
pub(crate) struct TableArgs {
    /// Read these runs.
    ///
    /// Name a run's folder, its recording, a unique prefix of its name in the folder of runs, or `@latest`. Several
    /// runs give one table, with the settings in which they differ.
    #[arg(required = true, value_name = "RUN", add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,

    #[command(flatten)]
    pub scores: ScoresArgs,

    /// Use only these estimates, by label or name (default: all).
    ///
    /// `*` matches any characters, and commas separate several: `fused`, `stereo,no_*/mono`.
    #[arg(long, value_name = "GLOB,...")]
    pub estimates: Option<String>,

    /// Sort by this column, best first (default: `abs_rel`).
    ///
    /// It is a metric, `ms`, `density`, `frames`, `pixels`, or an axis: numbers by size, words in the order of the
    /// file. If `abs_rel` was not scored, the default is the first error metric that was.
    #[arg(long, value_name = "COLUMN", add = ArgValueCandidates::new(columns))]
    pub sort: Option<String>,

    /// Show at most N rows (default: all).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub top: Option<u32>,

    /// Put variants or metrics in rows.
    ///
    /// `score` has the layout of Table I of Martins et al. (2018).
    #[arg(long, value_enum, value_name = "ROWS", default_value = "variant")]
    pub rows: RowsOption,

    /// Show these columns after the axes (default: the usual ones)
    ///
    /// - metrics, e.g. `abs_rel`
    /// - `density`: the share of pixels with ground truth where the estimate is valid
    /// - `ms`: core-milliseconds per frame, the CPU time of all nodes that the estimate depends on, as if it ran alone.
    ///   A node that several estimates share counts for each. Reading, scoring, recording and learning do not count.
    /// - `frames`, `pixels`
    /// - `disparity_density`, `disparity_frames`, `disparity_pixels`: of the disparity, where a depth and its disparity
    ///   share a row. They do if `depth/from-disparity` computes the depth from the disparity.
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',', verbatim_doc_comment, add = ArgValueCandidates::new(columns))]
    pub columns: Vec<String>,

    /// Show only rows that no other row beats in all of these columns.
    ///
    /// For example `abs_rel,ms`. Rows are compared only if they are comparable: the same pixels and frames.
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',', add = ArgValueCandidates::new(columns))]
    pub pareto: Vec<String>,

    /// Show the effect of each axis on a metric or on `ms`.
    ///
    /// The table has the mean of all rows with each level, and the share of the variance between rows that the axis
    /// alone explains (eta squared). The rest are interactions of axes. It replaces the other kinds of table.
    #[arg(long, value_name = "COLUMN", add = ArgValueCandidates::new(columns), conflicts_with_all = ["best_per_zone", "sort", "top", "columns", "pareto", "rows"])]
    pub effects: Option<String>,

    /// Show which row is best in each zone that was scored.
    #[arg(long, value_name = "METRIC", add = ArgValueCandidates::new(columns), conflicts_with_all = ["zone", "sort", "top", "columns", "pareto", "rows"])]
    pub best_per_zone: Option<String>,

    /// Add a confidence interval to each metric (default: 95 per cent).
    ///
    /// The interval is that of the mean over frames, or over pixels, by resampling frames (BCa bootstrap). CSV and
    /// Parquet have its ends as `METRIC_low` and `METRIC_high`.
    #[arg(long, value_name = "PERCENT", num_args = 0..=1, require_equals = true, default_missing_value = "95", value_parser = parse_confidence, conflicts_with_all = ["effects", "best_per_zone"])]
    pub ci: Option<f64>,

    /// Resample frames N times, with `--ci`.
    #[arg(long, value_name = "N", default_value_t = Resampling::OF_SCORES, value_parser = clap::value_parser!(u32).range(100..=1_000_000), requires = "ci")]
    pub resamples: u32,

    /// Seed the resampling of `--ci`: equal seeds give equal intervals.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "ci")]
    pub seed: u64,

    /// Resample groups of frames with `--ci`, e.g. `sequence` (default: each frame).
    ///
    /// Use it for video, whose frames are correlated: intervals over single frames are then too narrow.
    ///
    /// - `sequence`: a group ends where the folder in the frame's id changes, or where ids stop rising
    /// - `blocks:N`: N of the scored frames, in their order
    /// - a CSV file with the columns `frame,group`
    #[arg(long, value_name = "GROUPS", value_parser = Grouping::parse, requires = "ci", verbatim_doc_comment)]
    pub group: Option<Grouping>,

    #[command(flatten)]
    pub typesetting: TypesettingArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    #[command(flatten)]
    pub output: TableOutputArgs,
}

/// The rows of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RowsOption {
    /// One row per estimate of a variant, with its axes and metrics in columns. A depth and the disparity that it is
    /// computed from share a row.
    Variant,
    /// One row per metric, with estimates in columns.
    Score,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "explanation/scores.md",
    "explain @latest abs_rel base/fused" => "formula, pixels, frames, source, the convention of the paper",
    "explain @latest rmse base/stereo --pixels valid --json" => "for programs",
])]
pub(crate) struct ExplainArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// Explain this metric, e.g. `abs_rel`.
    #[arg(add = ArgValueCandidates::new(metrics))]
    pub metric: String,

    /// Explain it for this estimate: `fused`, `base/fused`.
    pub estimate: String,

    #[command(flatten)]
    pub scores: ScoresArgs,

    #[command(flatten)]
    pub output: JsonArgs,
}
