//! Options of `export`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;
use depthloom_analysis::FrameChoice;
use depthloom_export::ExportFormat;

use super::{JsonArgs, RunArg};
use crate::completion::folders;

/// The colours of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ColoursOption {
    /// Blue over green to red.
    Turbo,
    /// Violet over green to yellow.
    Viridis,
    /// Black over red to pale yellow.
    Magma,
    /// Black to white.
    Grey,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/export.md",
    "export @latest depth --out depths" => "the depth of each frame as 16-bit PNG, in KITTI's format",
    "export @latest depth/depth --format npy,pfm --frames 0,1 --out arrays" => "the floating-point values of two frames",
    "export @latest 'fused*' --colormap turbo --range 0..40 --out maps" => "in colours, for a figure",
    "export @latest depth --format ply --range 0..60 --out clouds" => "points up to 60 m, coloured by the image",
    "export @latest --out all --json | jq '.topics[]'" => "everything; for programs",
])]
pub(crate) struct ExportArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// Export these topics (default: all).
    ///
    /// Name a topic as `inspect RUN` lists it (`/look/depth/depth`), by its end (`depth/depth`) or by its node
    /// (`depth`). An output of the source can be named alone (`calibration`) if no node has that name. `*` matches any
    /// characters.
    #[arg(value_name = "TOPIC")]
    pub topics: Vec<String>,

    /// Write to this folder.
    ///
    /// The files are `DIR/<topic>/<frame>.<format>`, and `DIR/<topic>.<format>` for values that exist once per run. A
    /// file is complete or does not exist.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: PathBuf,

    /// Write these formats (default: png; onnx for networks, parquet for rows).
    ///
    /// Each topic is written in those of the formats that its type has.
    #[arg(long, value_enum, value_name = "FORMAT,...", value_delimiter = ',')]
    pub format: Vec<ExportFormat>,

    /// Export only these frames (default: all).
    ///
    /// They are numbers (`3`, `3,7`, `0..4`, `1..=40`), ids (`000150_10`), or a text file with one frame id per line.
    #[arg(long, value_name = "FRAMES", value_parser = FrameChoice::parse)]
    pub frames: Option<FrameChoice>,

    /// Colour disparities, depths and confidences written as PNG.
    ///
    /// Invalid pixels are black. The files are in `DIR/<topic>.<colours>/`.
    #[arg(long, value_enum, value_name = "COLOURS")]
    pub colormap: Option<ColoursOption>,

    /// Set the range of colours, or of depths of point clouds.
    ///
    /// The values of the first and the last colour; `80..0` reverses them. The defaults are `0..80` m, `0..128` px and
    /// `0..1` for confidences. For point clouds, only points in this range of depth are written. By default these are
    /// all points, except those at a depth where a node capped them.
    #[arg(long, value_name = "FROM..TO", value_parser = parse_range, allow_hyphen_values = true)]
    pub range: Option<(f64, f64)>,

    /// Replace files also in a folder that `export` did not create.
    #[arg(long)]
    pub overwrite: bool,

    /// Print only errors and warnings.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    #[command(flatten)]
    pub output: JsonArgs,
}

fn parse_range(text: &str) -> Result<(f64, f64), String> {
    let number = |text: &str| text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    let range = text.split_once("..").and_then(|(from, to)| Some((number(from)?, number(to)?)));
    range
        .filter(|(from, to)| from != to)
        .ok_or_else(|| "expected FROM..TO, two different numbers, e.g. 0..80".to_owned())
}
