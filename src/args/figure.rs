//! Figures.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::{ArgValueCandidates, ArgValueCompleter};
use depthloom_analysis::{Bins, FigureKind, FrameChoice, Layout};

use super::{JsonArgs, PartArgs, SetOption, compare::IntervalArgs};
use crate::completion::{folders, metrics, runs};

/// What a figure is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FigureFormat {
    /// Scalable, for the web and for editing.
    Svg,
    /// Pixels.
    Png,
    /// One page, for LaTeX; its text can be searched.
    Pdf,
}

/// How variants are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LayoutOption {
    /// A panel a variant.
    Multiples,
    /// All on one panel.
    Overlaid,
}

impl LayoutOption {
    /// As the analysis has it.
    pub(crate) const fn layout(self) -> Layout {
        match self {
            Self::Multiples => Layout::Multiples,
            Self::Overlaid => Layout::Overlaid,
        }
    }
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "figure @latest error-vs-distance --out error.pdf" => "the paper's figure, two columns wide",
    "figure RUN difference --estimates stereo,full/mono --width one-column --out where.svg" => "where mono hands over to stereo",
    "figure RUN parameter --axes block,p1 --score abs_rel --out sweep.png --dpi 600" => "of a matrix",
    "figure RUN panels --frames 0,3 --out frames.png --data frames.csv" => "frames as the paper shows them",
])]
pub(crate) struct FigureArgs {
    /// Runs: their folders, recordings, the beginnings of their names in `runs`, or `@latest`. Several for
    /// `error-vs-distance`, `histogram`, `cdf` and `reliability`.
    #[arg(required = true, value_name = "RUN", add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,

    /// What the figure shows.
    #[arg(required = true, value_enum, value_name = "KIND")]
    pub kind: FigureKind,

    /// The file to write; its ending (`.svg`, `.png`, `.pdf`) says what it is written as.
    #[arg(long, short, required = true, value_name = "FILE", add = ArgValueCompleter::new(folders()))]
    pub out: PathBuf,

    /// What it is written as, where the file's ending does not say.
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub format: Option<FigureFormat>,

    /// Its width: `one-column` (88 mm), `two-columns` (180 mm), or millimetres.
    #[arg(long, value_name = "MM", value_parser = parse_width, default_value = "two-columns")]
    pub width: f64,

    /// Its height, millimetres; by default what suits it.
    #[arg(long, value_name = "MM", value_parser = parse_mm)]
    pub height: Option<f64>,

    /// Pixels an inch of a PNG.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(36..=2400))]
    pub dpi: u32,

    /// The numbers that the figure shows, as CSV.
    #[arg(long, value_name = "FILE", add = ArgValueCompleter::new(folders()))]
    pub data: Option<PathBuf>,

    /// Words above it; by default none, since a paper has a caption.
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    pub title: String,

    /// Only estimates whose label or name this is; `*` stands for any run of characters, several have commas between:
    /// `stereo,full/fused`. Of `difference` two: the second is held against the first.
    #[arg(long, value_name = "GLOB,...")]
    pub estimates: Option<String>,

    #[command(flatten)]
    pub part: PartArgs,

    /// Over which pixels: of errors `common` (valid in all) or `valid`, by default both where there is room
    /// for both; of scores those that were scored.
    #[arg(long, value_enum, value_name = "SET")]
    pub set: Option<SetOption>,

    /// What errors are by, in place of distance or weight: as `analyse --by`.
    #[arg(long, value_name = "WHAT")]
    pub by: Option<String>,

    /// The bins: `width:2`, `linear:20`, `log:20`, `quantile:10` or `edges:0,5,10,20,80`, as of `analyse`.
    #[arg(long, value_name = "BINS", value_parser = Bins::parse)]
    pub bins: Option<Bins>,

    /// Errors as shares of the true distance, in place of metres.
    #[arg(long)]
    pub relative: bool,

    /// A panel a variant, or all on one.
    #[arg(long, value_enum, value_name = "LAYOUT", default_value = "multiples")]
    pub layout: LayoutOption,

    /// A bin of fewer pixels is drawn faint and dotted, and sets no axis.
    #[arg(long, value_name = "PIXELS", default_value_t = 100)]
    pub thin: u64,

    /// Where the axis of errors ends.
    #[arg(long, value_name = "ERROR", value_parser = parse_mm)]
    pub most: Option<f64>,

    /// Which score, of `frames` and `parameter`; by default the first error that was scored.
    #[arg(long, value_name = "SCORE", add = ArgValueCandidates::new(metrics))]
    pub score: Option<String>,

    /// Which axes of the matrix, of `parameter`: one or two with commas between; others are averaged over.
    #[arg(long, value_name = "AXIS,...", value_delimiter = ',')]
    pub axes: Vec<String>,

    /// The frames of `panels`, as `export` takes them: numbers (`3`, `3,7`, `0..4`, `1..=40`), ids (`000150_10`), or a
    /// text file with a frame id per line. By default five, evenly apart.
    #[arg(long, value_name = "FRAMES", value_parser = FrameChoice::parse)]
    pub frames: Option<FrameChoice>,

    #[command(flatten)]
    pub intervals: IntervalArgs,

    #[command(flatten)]
    pub output: JsonArgs,
}

fn parse_width(text: &str) -> Result<f64, String> {
    match text {
        "one-column" => Ok(88.0),
        "two-columns" => Ok(180.0),
        other => parse_mm(other.trim_end_matches("mm")).and_then(|width| {
            let is_paper = (20.0..=2000.0).contains(&width);
            is_paper.then_some(width).ok_or_else(|| "give `one-column`, `two-columns`, or 20 to 2000 mm".to_owned())
        }),
    }
}

fn parse_mm(text: &str) -> Result<f64, String> {
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| format!("`{text}` is not a number above 0"))
}
