//! Options of `figure`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::{ArgValueCandidates, ArgValueCompleter};
use depthloom_analysis::{Bins, FigureKind, FrameChoice, Layout};

use super::{JsonArgs, PartArgs, PixelsOption, RunsFolder, compare::IntervalArgs};
use crate::completion::{folders, metrics, runs};

/// The file format of a figure.
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
    /// One panel per variant.
    Multiples,
    /// All on one panel.
    Overlaid,
}

impl LayoutOption {
    /// The layout of the analysis.
    pub(crate) const fn layout(self) -> Layout {
        match self {
            Self::Multiples => Layout::Multiples,
            Self::Overlaid => Layout::Overlaid,
        }
    }
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "figures.md",
    "figure @latest error-vs-distance --out error.pdf" => "the figure of the paper, two columns wide",
    "figure @latest difference --estimates base/stereo,base/mono --width one-column --out where.svg" => "at which distances each of the two is better",
    "figure @latest parameter --axes block,size --metric abs_rel --out sweep.png --dpi 600" => "a metric by two axes of a matrix",
    "figure @latest panels --frames 0,1 --out frames.png --csv frames.csv" => "images and maps of two frames, and their numbers",
])]
pub(crate) struct FigureArgs {
    /// Draw these runs.
    ///
    /// Name a run's folder, its recording, a unique prefix of its name in the folder of runs, or `@latest`. The kinds
    /// `error-vs-distance`, `histogram`, `cdf` and `reliability` take several runs.
    #[arg(required = true, value_name = "RUN", add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,

    /// Draw this kind of figure.
    #[arg(required = true, value_enum, value_name = "KIND")]
    pub kind: FigureKind,

    /// Write this file: `.svg`, `.png` or `.pdf`.
    #[arg(long, short, required = true, value_name = "FILE", add = ArgValueCompleter::new(folders()))]
    pub out: PathBuf,

    /// Write this format (default: that of the file's extension).
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub format: Option<FigureFormat>,

    /// Set the width: `one-column` (88 mm), `two-columns` (180 mm), or mm.
    #[arg(long, value_name = "MM", value_parser = parse_width, default_value = "two-columns")]
    pub width: f64,

    /// Set the height, millimetres (default: depends on the kind).
    #[arg(long, value_name = "MM", value_parser = parse_mm)]
    pub height: Option<f64>,

    /// Set the resolution of a PNG, pixels per inch.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(36..=2400))]
    pub dpi: u32,

    /// Also write the numbers of the figure to this CSV file.
    #[arg(long, value_name = "FILE", add = ArgValueCompleter::new(folders()))]
    pub csv: Option<PathBuf>,

    /// Write this title above it (default: none, for a paper has captions).
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    pub title: String,

    /// Use only these estimates, by label or name (default: all).
    ///
    /// `*` matches any characters, and commas separate several: `stereo,full/fused`. `difference` needs two: the second
    /// is compared with the first.
    #[arg(long, value_name = "GLOB,...")]
    pub estimates: Option<String>,

    #[command(flatten)]
    pub part: PartArgs,

    /// Use this pixel set (default: depends on the kind).
    ///
    /// Figures of errors take `common` (valid in all estimates) or `valid`; by default they show `common`, and `valid`
    /// as well if there is room. The default of `depthloom analyse` is `valid`. Figures of metrics take a pixel set
    /// that was scored.
    #[arg(long, value_enum, value_name = "PIXELS")]
    pub pixels: Option<PixelsOption>,

    /// Show errors by this quantity, as in `analyse --by`.
    ///
    /// The default is distance; for `reliability` it is the confidence.
    #[arg(long, value_name = "QUANTITY")]
    pub by: Option<String>,

    /// Set the bins, as in `analyse --bins` (default: those of `analyse`).
    ///
    /// They are `width:2`, `linear:20`, `log:20`, `quantile:10` or `edges:0,5,10,20,80`.
    #[arg(long, value_name = "BINS", value_parser = Bins::parse)]
    pub bins: Option<Bins>,

    /// Show errors as shares of the ground-truth distance (default: metres).
    #[arg(long)]
    pub relative: bool,

    /// Draw one panel per variant, or all on one panel.
    #[arg(long, value_enum, value_name = "LAYOUT", default_value = "multiples")]
    pub layout: LayoutOption,

    /// Draw bins with fewer pixels faint and dotted.
    ///
    /// They do not affect the axes either.
    #[arg(long, value_name = "PIXELS", default_value_t = 100)]
    pub min_count: u64,

    /// End the axis of errors at this value (default: fits the data).
    #[arg(long, value_name = "ERROR", value_parser = parse_mm)]
    pub y_max: Option<f64>,

    /// Draw this metric, for `frames` and `parameter`.
    ///
    /// The default is the first error metric that was scored.
    #[arg(long, value_name = "METRIC", add = ArgValueCandidates::new(metrics))]
    pub metric: Option<String>,

    /// Draw one or two axes of the matrix, for `parameter`.
    ///
    /// The values are means over the other axes.
    #[arg(long, value_name = "AXIS,...", value_delimiter = ',')]
    pub axes: Vec<String>,

    /// Draw these frames, for `panels` (default: five, evenly spaced).
    ///
    /// They are numbers (`3`, `3,7`, `0..4`, `1..=40`), ids (`000150_10`), or a text file with one frame id per line.
    #[arg(long, value_name = "FRAMES", value_parser = FrameChoice::parse)]
    pub frames: Option<FrameChoice>,

    #[command(flatten)]
    pub intervals: IntervalArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    #[command(flatten)]
    pub output: JsonArgs,
}

fn parse_width(text: &str) -> Result<f64, String> {
    match text {
        "one-column" => Ok(88.0),
        "two-columns" => Ok(180.0),
        other => parse_mm(other.trim_end_matches("mm")).and_then(|width| {
            let is_paper = (20.0..=2000.0).contains(&width);
            is_paper.then_some(width).ok_or_else(|| "expected `one-column`, `two-columns`, or 20 to 2000 mm".to_owned())
        }),
    }
}

fn parse_mm(text: &str) -> Result<f64, String> {
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| format!("`{text}` is not a number above 0"))
}
