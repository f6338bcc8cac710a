//! Scores asked for.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::{ArgValueCandidates, ArgValueCompleter};
use depthloom_analysis::{Mean, PixelSet, Resampling, Selection, Typesetting};
use depthloom_graphs::contracts::FrameSelection;

use super::export::parse_frames;
use super::{JsonArgs, RunArg, TableOutputArgs, compare::parse_confidence};
use crate::completion::{columns, metrics, runs};

/// Which pixels scores are over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SetOption {
    /// Every pixel with ground truth.
    All,
    /// The pixels with ground truth on which an estimate is valid.
    Valid,
    /// Of disparities: every pixel with ground truth, after the benchmark's filling of invalid pixels.
    Filled,
    /// Of depths, taken again from recorded maps: the pixels with ground truth that are valid in all selected
    /// estimates.
    Common,
}

impl SetOption {
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

/// How frames' scores become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MeanOption {
    /// The unweighted mean of the frames' scores.
    Frames,
    /// As if all frames were one image.
    Pixels,
}

/// What a table is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TableFormat {
    /// Aligned text, the best marked by `*`.
    Terminal,
    /// Markdown, as GitHub shows it.
    Md,
    /// Comma-separated values: all digits, no marks.
    Csv,
    /// Parquet, with the columns of csv; a terminal takes none: with --out, or into a pipe.
    Parquet,
    /// A LaTeX float for the package booktabs, in the type's own size.
    Latex,
    /// One JSON object.
    Json,
}

/// Which scores of a run, of what.
#[derive(Debug, Args)]
pub(crate) struct ScoresArgs {
    /// The pixels that scores are over; by default every pixel with ground truth, where those were scored.
    #[arg(long, value_enum)]
    pub set: Option<SetOption>,

    /// A zone that the experiment scored, e.g. `10..20`; by default the whole image.
    #[arg(long, value_name = "ZONE")]
    pub zone: Option<String>,

    /// The frames, by number: `3`, `3,7`, `0..4`, `1..=40`, or a text file with a frame id a line. Without it, all.
    #[arg(long, value_name = "FRAMES", value_parser = parse_frames)]
    pub frames: Option<FrameSelection>,

    /// What a score of all frames is taken over; by default what the experiment says, which is frames where it says
    /// nothing.
    #[arg(long, value_enum)]
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
        let (common, set) = (self.set == Some(SetOption::Common), self.set.and_then(SetOption::recorded));
        Selection { common, set, zone, frames, mean, ..Selection::default() }
    }
}

/// How a table is set.
#[derive(Clone, Debug, Args)]
pub(crate) struct TypesettingArgs {
    /// The caption in LaTeX, taken as LaTeX; by default what the numbers are.
    #[arg(long, value_name = "TEXT")]
    pub caption: Option<String>,

    /// The label in LaTeX, behind `tab:`; by default the experiment's name and what is asked for.
    #[arg(long, value_name = "NAME")]
    pub label: Option<String>,

    /// Decimals of scores and their intervals in text, Markdown and LaTeX; files have all digits.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=15))]
    pub digits: Option<u8>,
}

impl TypesettingArgs {
    /// The typesetting of the analysis.
    pub(crate) fn typesetting(&self) -> Typesetting {
        let Self { caption, label, digits } = self.clone();
        Typesetting { caption, label, decimals: digits.map(usize::from) }
    }
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "table RUN --sort d1 --top 10 --columns d1,epe,density,ms" => "the ten best settings",
    "table RUN --effects abs_rel" => "what each axis did, and how much of it",
    "table RUN --best-per-zone abs_rel" => "which setting is best where",
    "table RUN --effects ms" => "what each axis costs",
    "table RUN --pareto abs_rel,ms" => "what is worth its time",
    "table RUN --top 8 --format latex --out variants.tex" => "for a paper",
])]
pub(crate) struct TableArgs {
    /// A run: its folder, its recording, the beginning of its name in `runs`, or `@latest`. Of several runs one table,
    /// with the settings in which they differ.
    #[arg(required = true, value_name = "RUN", add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,

    #[command(flatten)]
    pub scores: ScoresArgs,

    /// Only estimates whose label or name this is; `*` stands for any run of characters, several have commas between:
    /// `fused`, `stereo,no_*/mono`.
    #[arg(long, value_name = "GLOB,...")]
    pub estimates: Option<String>,

    /// Sort by a score, `ms`, `density`, `frames` or `pixels`, best first, or by an axis, numbers by size and words in
    /// the file's order; by default `abs_rel`, or the first error that was scored.
    #[arg(long, value_name = "COLUMN", add = ArgValueCandidates::new(columns))]
    pub sort: Option<String>,

    /// Show so many rows at most.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub top: Option<u32>,

    /// What is in rows: variants, their axes in columns; or scores, as in the paper's Table I.
    #[arg(long, value_enum, default_value = "variant")]
    pub rows: RowsOption,

    /// The columns behind the axes, with commas between: scores, `density` (the share of pixels with ground truth that
    /// were valid), `ms` (core-milliseconds a frame: the processor time of all nodes that the estimate is computed
    /// from, as if it had been run alone; a node that several share counts for each; without reading, scoring,
    /// recording and learning), `frames`, `pixels`. Scores of depths and of disparities stand in one row where the
    /// depth is made of the disparity by `depth/from-disparity`; `disparity_density`, `disparity_frames` and
    /// `disparity_pixels` are then the disparity's.
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',', add = ArgValueCandidates::new(columns))]
    pub columns: Vec<String>,

    /// Show only what no other row that it can be compared with beats in all of these, e.g. `abs_rel,ms`.
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',', add = ArgValueCandidates::new(columns))]
    pub pareto: Vec<String>,

    /// Show what each axis did to a score or to `ms`: the mean of all rows with a level, and the share of the variance
    /// between rows that the axis explains alone (eta squared); what is left are interactions of axes.
    #[arg(long, value_name = "COLUMN", add = ArgValueCandidates::new(columns), conflicts_with_all = ["best_per_zone", "sort", "top", "columns", "pareto", "rows"])]
    pub effects: Option<String>,

    /// Show which row is best in each zone that the experiment scored.
    #[arg(long, value_name = "SCORE", add = ArgValueCandidates::new(columns), conflicts_with_all = ["zone", "sort", "top", "columns", "pareto", "rows"])]
    pub best_per_zone: Option<String>,

    /// An interval beside each score: of the mean over frames, or over pixels, by resampling frames (BCa bootstrap); 95
    /// %, or so many per cent. CSV and Parquet have its ends as `SCORE_low` and `SCORE_high`.
    #[arg(long, value_name = "PERCENT", num_args = 0..=1, require_equals = true, default_missing_value = "95", value_parser = parse_confidence, conflicts_with_all = ["effects", "best_per_zone"])]
    pub ci: Option<f64>,

    /// How often frames are resampled for `--ci`.
    #[arg(long, value_name = "N", default_value_t = Resampling::OF_SCORES, value_parser = clap::value_parser!(u32).range(100..=1_000_000), requires = "ci")]
    pub resamples: u32,

    /// The seed of the resamples of `--ci`: equal seeds give equal intervals, on any machine.
    #[arg(long, default_value_t = 1, requires = "ci")]
    pub seed: u64,

    #[command(flatten)]
    pub typesetting: TypesettingArgs,

    #[command(flatten)]
    pub output: TableOutputArgs,
}

/// What a table has in rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RowsOption {
    /// An estimate of a variant a row, or a depth and the disparity it is made of; its axes and scores in columns.
    Variant,
    /// A score a row, estimates in columns.
    Score,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "explain RUN abs_rel full/fused" => "formula, pixels, frames, source, the paper's convention",
    "explain RUN rmse fused --set valid --json" => "for programs",
])]
pub(crate) struct ExplainArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// The score, e.g. `abs_rel`.
    #[arg(add = ArgValueCandidates::new(metrics))]
    pub score: String,

    /// The estimate as tables name it: `fused`, `full/fused`.
    pub estimate: String,

    #[command(flatten)]
    pub scores: ScoresArgs,

    #[command(flatten)]
    pub output: JsonArgs,
}
